"""
The compensation: a goal on the wall and the disturbance in, the pose to send to the rail out.

In: goals in frame `facade`, estimates of the disturbance, wrench and lateral offset of the
contact, the head's measured pose, each with its time. Out: `CorrectedPose` in frame `rail`,
within the workspace and the limits of motion, for the instant it is meant for. Knows no ROS,
clock or I/O.
"""

from facade_manipulator.compensation.compensator import (
    Compensator,
    CompensatorSettings,
    CorrectedPose,
    DEFAULTS,
)
from facade_manipulator.compensation.contact_estimate import contact_wrench, FrictionSettings
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import (
    ArrivalSettings,
    ArrivalWatch,
    GoalProgress,
    GoalState,
    HeldBack,
)
from facade_manipulator.compensation.limits import WorkspaceLimit
from facade_manipulator.compensation.pressing import PressMode
from facade_manipulator.compensation.suspension import GRAVITY, SuspensionSettings

__all__ = [
    'WorkspaceLimit',
    'ArrivalSettings',
    'ArrivalWatch',
    'Compensator',
    'CompensatorSettings',
    'contact_wrench',
    'CorrectedPose',
    'CorrectionMode',
    'DEFAULTS',
    'FrictionSettings',
    'GRAVITY',
    'GoalProgress',
    'GoalState',
    'HeldBack',
    'PressMode',
    'SuspensionSettings',
]
