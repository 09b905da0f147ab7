"""
Motion inside limits: poses in, setpoints and carriage targets out.

For ik_service: `Approach` and `ReferencePath` (jerk-limited paths of the head), `SetpointStream`
(certified poses to setpoints). For the driver: `SetpointFollower` (setpoints to targets within
speed, acceleration and jerk) and the guards that check the mechanism before a target is sent.
"""
