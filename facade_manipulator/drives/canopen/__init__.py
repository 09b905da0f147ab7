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
from facade_manipulator.drives.canopen.pdo import (
    DISABLED,
    emergency_cob_id,
    heartbeat_cob_id,
    KNOWN_OBJECTS,
    make_pdo,
    MappedObject,
    MASTER_NODE_ID,
    NMT_COB_ID,
    NO_REMOTE,
    Pdo,
    PDO_MAP,
    sdo_request_cob_id,
    sdo_response_cob_id,
    SYNC_COB_ID,
    unused_pdos,
)
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
    'DISABLED',
    'Emergency',
    'emergency_cob_id',
    'encode_emergency',
    'fault',
    'Frame',
    'heartbeat_cob_id',
    'is_error_reset',
    'KNOWN_OBJECTS',
    'make_pdo',
    'MappedObject',
    'MASTER_NODE_ID',
    'NMT_COB_ID',
    'NMT_TRANSITIONS',
    'NmtCommand',
    'NmtState',
    'NO_REMOTE',
    'open_bus',
    'Patience',
    'Pdo',
    'pdo',
    'PDO_MAP',
    'PumpedNetwork',
    'SDO_FRAME_LENGTH',
    'sdo_request_cob_id',
    'sdo_response_cob_id',
    'SdoAbortError',
    'SdoChannel',
    'SYNC_COB_ID',
    'unused_pdos',
]
