"""
CAN frames as they are kept, and as messages can_msgs/Frame, which readers of MCAP know.

They are kept in batches of what the kernel gives: a stamp and a frame each, 32 bytes.

References
----------
struct can_frame and the flags of its identifier, linux/can.h.

"""

from __future__ import annotations

from collections.abc import Iterator
import struct

from facade_manipulator.blackbox.mcap_file import RecordedTopic
from facade_manipulator.blackbox.ring import Kept

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
_STAMP, _CAN_FRAME = struct.Struct('@ll'), struct.Struct('=IB3x8s')
STAMP_SIZE, FRAME_SIZE = _STAMP.size, _CAN_FRAME.size
IS_EXTENDED, IS_RTR, IS_ERROR, IDENTIFIER = 1 << 31, 1 << 30, 1 << 29, (1 << 29) - 1


def stamp_of(record: bytes) -> float:
    """Return the stamp of a kept frame [s, system's clock]."""
    seconds, nanoseconds = _STAMP.unpack_from(record)
    return seconds + nanoseconds / _NANOSECONDS


def messages_of(batch: Kept) -> Iterator[Kept]:
    """Yield the frames of a batch, whose time is that of its newest, each as a message."""
    size = STAMP_SIZE + FRAME_SIZE
    newest = stamp_of(batch.data[-size:])
    for begin in range(0, len(batch.data), size):
        record = batch.data[begin:begin + size]
        stamp = stamp_of(record)
        flagged, length, data = _CAN_FRAME.unpack_from(record, STAMP_SIZE)
        yield Kept(batch.time - (newest - stamp), batch.topic, frame_bytes(
            stamp, flagged & IDENTIFIER, data[:length], is_rtr=bool(flagged & IS_RTR),
            is_extended=bool(flagged & IS_EXTENDED), is_error=bool(flagged & IS_ERROR)))


def frame_bytes(
    stamp: float, cob_id: int, data: bytes, *, is_rtr: bool = False, is_extended: bool = False,
    is_error: bool = False,
) -> bytes:
    """Return a frame as a serialised message; `stamp` is the system's time [s]."""
    seconds, nanoseconds = divmod(round(stamp * _NANOSECONDS), _NANOSECONDS)
    return _FRAME.pack(_LITTLE_ENDIAN, seconds, nanoseconds, 1, b'\0', cob_id,
                       is_rtr, is_extended, is_error, len(data), data)
