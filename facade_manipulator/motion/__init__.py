"""
Motion inside limits: poses in, setpoints and carriage targets out.

For ik_service: `Approach` and `ReferencePath` (jerk-limited paths of the head), `SetpointStream`
(certified poses to setpoints). For the driver: `SetpointFollower` (setpoints to targets within
speed, acceleration and jerk) and the guards that check the mechanism before a target is sent.
"""

from facade_manipulator.motion.follower import SetpointFollower, StreamSettings
from facade_manipulator.motion.guard import (
    HomingGuard,
    measured_guard,
    MEASURED_SHARE,
    mechanism_guard,
)
from facade_manipulator.motion.limits import fastest_near, MotionLimits, Separation, Triple
from facade_manipulator.motion.reference import (
    Approach,
    HeadMotion,
    ReferencePath,
    ReferenceSettings,
)
from facade_manipulator.motion.setpoints import (
    certified_path,
    GoalSettings,
    Setpoint,
    SetpointStream,
    STREAM_GAP,
)
from facade_manipulator.motion.stopping import (
    Brake,
    highest_speed,
    least_distance,
    overshoot,
)
from facade_manipulator.motion.timed_buffer import TimedBuffer

__all__ = [
    'Approach',
    'Brake',
    'certified_path',
    'fastest_near',
    'GoalSettings',
    'HeadMotion',
    'highest_speed',
    'HomingGuard',
    'least_distance',
    'measured_guard',
    'MEASURED_SHARE',
    'mechanism_guard',
    'MotionLimits',
    'overshoot',
    'ReferencePath',
    'ReferenceSettings',
    'Separation',
    'Setpoint',
    'SetpointFollower',
    'SetpointStream',
    'STREAM_GAP',
    'StreamSettings',
    'TimedBuffer',
    'Triple',
]
