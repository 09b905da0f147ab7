"""
Drives after CiA 402: state tables, units, profiles, homing, and three axes as one group.

In: what a drive has sent (statusword, mode, position, age). Out: controlwords, modes and targets
of the next cycle, and causes of stops. Knows no bus and no clock: time and feedback are
arguments.
"""

from .axis import Feedback as Feedback
from .cause import Cause as Cause
from .cause import Remedy as Remedy
from .controller_state import ControllerState as ControllerState
from .group import AxisCommand as AxisCommand
from .group import Group as Group
from .group import GroupSettings as GroupSettings
from .homing import AxisHoming as AxisHoming
from .homing import home_error as home_error
from .homing import HomingSequence as HomingSequence
from .profile import DriveProfile as DriveProfile
from .profile import fitting_profile as fitting_profile
from .profile import load_profile as load_profile
from .profile import profile_checksums as profile_checksums
from .profile import profile_files as profile_files
from .profile import ProfileObject as ProfileObject
from .profile import Quirks as Quirks
from .settings import axis_defaults as axis_defaults
from .settings import AXIS_NAMES as AXIS_NAMES
from .settings import AxisSettings as AxisSettings
from .settings import check_axes as check_axes
from .settings import DEFAULT_AXES as DEFAULT_AXES
from .settings import Triple as Triple
from .states import Controlword as Controlword
from .states import decode_state as decode_state
from .states import Mode as Mode
from .states import Power as Power
from .states import POWERED_STATES as POWERED_STATES
from .states import State as State
from .states import Status as Status
from .states import STATUSWORDS as STATUSWORDS
from .states import UNPOWERED_STATES as UNPOWERED_STATES
from .units import AxisScale as AxisScale
from .units import COUNTS as COUNTS
from .units import INT32_MAX as INT32_MAX
from .units import INT32_MIN as INT32_MIN
from .units import Measured as Measured
from .units import VELOCITY_UNITS as VELOCITY_UNITS
