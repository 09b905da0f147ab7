"""
The drive controller: one control thread that owns the bus.

In: an axis configuration, access to the bus, the mechanism that is moved, and an operator's
requests. Out: targets on the bus once per SYNC, and a snapshot of one cycle for whoever asks.
"""

from ..cia402 import ControllerState as ControllerState
from .commissioning import Finding as Finding
from .configuration import check_identity as check_identity
from .configuration import compare_objects as compare_objects
from .configuration import drive_writes as drive_writes
from .configuration import object_writes as object_writes
from .configuration import read_identity as read_identity
from .configuration import read_optional as read_optional
from .configuration import unit_conflicts as unit_conflicts
from .configuration import write_drive as write_drive
from .controller import DriveController as DriveController
from .cycle import CycleClock as CycleClock
from .cycle import CycleStatistics as CycleStatistics
from .cycle import LATE_WINDOW as LATE_WINDOW
from .cycle import LATENESS_BOUNDS as LATENESS_BOUNDS
from .exchange import CyclicExchange as CyclicExchange
from .monitor import AxisMonitor as AxisMonitor
from .monitor import require_dead_master_stop as require_dead_master_stop
from .realtime import describe_scheduling as describe_scheduling
from .realtime import request_realtime as request_realtime
from .session import BusAccess as BusAccess
from .session import Session as Session
from .settings import ControllerSettings as ControllerSettings
from .snapshot import AxisSnapshot as AxisSnapshot
from .snapshot import ControllerSnapshot as ControllerSnapshot
from .targets import MechanismChecks as MechanismChecks
