"""
CANopen (CiA 301) on a python-can bus: frames, SYNC, NMT, SDO, PDO and EMCY as tables and codecs.

In: an open interface and bytes. Out: frames, decoded messages, and errors that name object,
value and next step. Knows nothing of motors.
"""

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.canopen.bus import (
    BusCongestedError,
    BusStatistics,
    can_bus,
    CanBus,
    Condition,
    Frame,
)
from facade_manipulator.drives.canopen.emergency import (
    decode_emergency,
    describe,
    Emergency,
    encode_emergency,
    fault,
    is_error_reset,
)
from facade_manipulator.drives.canopen.link import BusSettings, open_bus
from facade_manipulator.drives.canopen.nmt import NMT_TRANSITIONS, NmtCommand, NmtState
from facade_manipulator.drives.canopen.pdo import Pdo
from facade_manipulator.drives.canopen.sdo import (
    Patience,
    PumpedNetwork,
    SDO_FRAME_LENGTH,
    SdoAbortError,
    SdoChannel,
)

__all__ = [
    'BusCongestedError',
    'BusSettings',
    'BusStatistics',
    'can_bus',
    'CanBus',
    'Condition',
    'decode_emergency',
    'describe',
    'Emergency',
    'encode_emergency',
    'fault',
    'Frame',
    'is_error_reset',
    'NMT_TRANSITIONS',
    'NmtCommand',
    'NmtState',
    'open_bus',
    'Patience',
    'Pdo',
    'pdo',
    'PumpedNetwork',
    'SDO_FRAME_LENGTH',
    'SdoAbortError',
    'SdoChannel',
]
