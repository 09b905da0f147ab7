"""
The drive controller: one control thread that owns the bus.

In: an axis configuration, a function that opens the bus, a `TargetSource`, and an operator's
requests. Out: targets on the bus once per SYNC, and a snapshot of one cycle for whoever asks.
"""

from facade_manipulator.drives.controller.commissioning import Finding
from facade_manipulator.drives.controller.controller import DriveController
from facade_manipulator.drives.controller.cycle import LATENESS_BOUNDS
from facade_manipulator.drives.controller.recorder import FaultRecorder, RecorderSettings
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
)

__all__ = [
    'AxisSnapshot',
    'ControllerSettings',
    'ControllerSnapshot',
    'ControllerState',
    'DriveController',
    'FaultRecorder',
    'Finding',
    'LATENESS_BOUNDS',
    'RecorderSettings',
]
