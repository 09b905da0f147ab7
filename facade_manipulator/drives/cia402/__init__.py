"""
Drives after CiA 402: state tables, units, profiles, homing, and three axes as one group.

In: what a drive has sent (statusword, mode, position, age). Out: controlwords, modes and targets
of the next cycle, and causes of stops. Knows no bus and no clock: time and feedback are
arguments.
"""

from facade_manipulator.drives.cia402.axis import Feedback
from facade_manipulator.drives.cia402.cause import (
    BUS_REMEDY,
    Cause,
    CLEAR_REMEDY,
    COMPUTER_REMEDY,
    CONFIGURE_REMEDY,
    TARGET_REMEDY,
    TRACKING_REMEDY,
)
from facade_manipulator.drives.cia402.group import AxisCommand, Group, GroupSettings
from facade_manipulator.drives.cia402.homing import AxisHoming, home_error, HomingSequence
from facade_manipulator.drives.cia402.plans import FOLLOWING_PHASES, Phase, STOPPED_PHASES
from facade_manipulator.drives.cia402.profile import (
    DriveProfile,
    fitting_profile,
    load_profile,
    Quirks,
)
from facade_manipulator.drives.cia402.settings import (
    axis_defaults,
    AXIS_NAMES,
    AxisSettings,
    check_axes,
    DEFAULT_AXES,
    Triple,
)
from facade_manipulator.drives.cia402.states import (
    AUTOMATIC_TRANSITIONS,
    Controlword,
    decode_command,
    decode_state,
    DeviceCommand,
    Mode,
    POWERED_STATES,
    State,
    Status,
    STATUSWORDS,
    TRANSITIONS,
)
from facade_manipulator.drives.cia402.units import AxisScale, INT32_MAX, INT32_MIN, Measured

__all__ = [
    'AUTOMATIC_TRANSITIONS',
    'AXIS_NAMES',
    'AxisHoming',
    'AxisScale',
    'axis_defaults',
    'AxisSettings',
    'BUS_REMEDY',
    'Cause',
    'check_axes',
    'CLEAR_REMEDY',
    'AxisCommand',
    'DeviceCommand',
    'COMPUTER_REMEDY',
    'CONFIGURE_REMEDY',
    'Controlword',
    'decode_command',
    'decode_state',
    'DEFAULT_AXES',
    'DriveProfile',
    'Feedback',
    'fitting_profile',
    'FOLLOWING_PHASES',
    'Group',
    'GroupSettings',
    'home_error',
    'HomingSequence',
    'INT32_MAX',
    'INT32_MIN',
    'load_profile',
    'Measured',
    'Mode',
    'Phase',
    'POWERED_STATES',
    'Quirks',
    'State',
    'Status',
    'STATUSWORDS',
    'STOPPED_PHASES',
    'TARGET_REMEDY',
    'TRACKING_REMEDY',
    'TRANSITIONS',
    'Triple',
]
