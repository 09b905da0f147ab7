"""
COB-IDs of the predefined connection set, and of the frames that only a master sends.

The module imports no CAN library, because the driver node has no bus.

References
----------
CiA 301: predefined connection set. CiA 305: COB-IDs of layer setting services.

"""

from __future__ import annotations

from collections.abc import Iterable

MASTER_NODE_ID = 127

NMT = 0x000
SYNC = 0x080
# of node 0: the node id is added
EMERGENCY = 0x080
SDO_RESPONSE = 0x580
SDO_REQUEST = 0x600
HEARTBEAT = 0x700
# of PDO 1 of node 0: a further PDO adds `PDO_STEP`
TPDO = 0x180
RPDO = 0x200
PDO_STEP = 0x100
PDO_NUMBERS = range(1, 5)

LSS_RESPONSE = 0x7E4
LSS_REQUEST = 0x7E5

REMOTE_FRAME = 1 << 30  # marks the COB-ID of a received remote frame, as in SocketCAN

# bits of a COB-ID in an object
NOT_VALID = 1 << 31
RTR_NOT_ALLOWED = 1 << 30
EXTENDED_FRAME = 1 << 29
COB_ID_BITS = 0x7FF


def frames_of_masters(node_ids: Iterable[int]) -> dict[int, tuple[str, bool]]:
    """Return, by COB-ID, the name of each master frame and whether the frame commands drives."""
    frames = {
        HEARTBEAT + MASTER_NODE_ID: ('its heartbeat (77Fh)', True),
        SYNC: ('SYNC (080h)', True),
        NMT: ('an NMT command', False),
        LSS_REQUEST: ('an LSS request (7E5h)', False),
    }
    for node in node_ids:
        for number in PDO_NUMBERS:
            offset = PDO_STEP * (number - 1) + node
            request = f'a remote request to node {node}'
            frames[REMOTE_FRAME | (TPDO + offset)] = request, False
            frames[RPDO + offset] = f'process data for node {node}', True
        frames[SDO_REQUEST + node] = f'an SDO request to node {node}', False
        guarding = f'node guarding of node {node} (RTR to {HEARTBEAT + node:03X}h)'
        frames[REMOTE_FRAME | (HEARTBEAT + node)] = guarding, False
    return frames
