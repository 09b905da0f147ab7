"""CAN frames as messages can_msgs/Frame, which Foxglove and other readers of MCAP know."""

from __future__ import annotations

import struct

from facade_manipulator.blackbox.mcap_file import RecordedTopic

CAN_TOPIC = RecordedTopic('can_frames', 'can_msgs/msg/Frame', """\
std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
""")
_FRAME = struct.Struct('<4siIIs3xI???B8s')  # an empty frame_id; CDR, little endian
_LITTLE_ENDIAN = b'\0\1\0\0'
_NANOSECONDS = 1_000_000_000


def frame_bytes(
    stamp: float, cob_id: int, data: bytes, *, is_rtr: bool = False, is_extended: bool = False,
    is_error: bool = False,
) -> bytes:
    """Return a frame as a serialised message; `stamp` is the system's time [s]."""
    seconds, nanoseconds = divmod(round(stamp * _NANOSECONDS), _NANOSECONDS)
    return _FRAME.pack(_LITTLE_ENDIAN, seconds, nanoseconds, 1, b'\0', cob_id,
                       is_rtr, is_extended, is_error, len(data), data)
