"""
The compensation: a goal on the wall and the disturbance in, the pose to send to the rail out.

In: goals in frame `facade`, estimates of the disturbance, wrench and lateral offset of the
contact, the head's measured pose, each with its time. Out: `CorrectedPose` in frame `rail`,
within the workspace and the limits of motion, for the instant it is meant for. Knows no ROS,
clock or I/O.
"""

from .compensator import CompensationSettings as CompensationSettings
from .compensator import Compensator as Compensator
from .compensator import CompensatorSettings as CompensatorSettings
from .compensator import CorrectedPose as CorrectedPose
from .compensator import DEFAULTS as DEFAULTS
from .contact_estimate import contact_wrench as contact_wrench
from .contact_estimate import FrictionSettings as FrictionSettings
from .correction import CorrectionMode as CorrectionMode
from .following import ArrivalSettings as ArrivalSettings
from .following import ArrivalWatch as ArrivalWatch
from .following import GoalProgress as GoalProgress
from .following import GoalState as GoalState
from .following import HeldBack as HeldBack
from .limits import WorkspaceLimit as WorkspaceLimit
from .pressing import Pressing as Pressing
from .suspension import SuspensionSettings as SuspensionSettings
