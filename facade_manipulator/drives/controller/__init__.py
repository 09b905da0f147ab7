"""
The drive controller: one control thread that owns the bus.

In: an axis configuration, access to the bus, the mechanism that is moved, and an operator's
requests. Out: targets on the bus once per SYNC, and a snapshot of one cycle for whoever asks.
"""

from facade_manipulator.drives.controller.commissioning import Finding
from facade_manipulator.drives.controller.configuration import drive_writes, write_objects
from facade_manipulator.drives.controller.controller import DriveController
from facade_manipulator.drives.controller.cycle import CycleStatistics, LATENESS_BOUNDS
from facade_manipulator.drives.controller.exchange import CyclicExchange
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.session import BusAccess, Session
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import (
    ACTIVE_STATES,
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
    POWERED_STATES,
)
from facade_manipulator.drives.controller.targets import MechanismChecks

__all__ = [
    'ACTIVE_STATES',
    'AxisMonitor',
    'AxisSnapshot',
    'BusAccess',
    'ControllerSettings',
    'ControllerSnapshot',
    'ControllerState',
    'CycleStatistics',
    'CyclicExchange',
    'drive_writes',
    'DriveController',
    'Finding',
    'LATENESS_BOUNDS',
    'MechanismChecks',
    'POWERED_STATES',
    'Session',
    'write_objects',
]
