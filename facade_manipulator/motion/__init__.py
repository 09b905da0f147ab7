"""
Motion inside limits: poses in, setpoints and carriage targets out.

For compensator and ik_service: `ReferencePath` (jerk-limited path of the head). For ik_service:
`SetpointStream` (certified poses to setpoints). For the driver: `SetpointFollower` (setpoints to
targets within speed, acceleration and jerk) and the guards that check the mechanism.
"""
