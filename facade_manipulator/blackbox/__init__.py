"""
The black box: messages of the last minutes in, one MCAP file per stop, fault or request out.

`MessageRing` keeps them, `RecordTrigger` says when a file is due, `Shelf` writes it whole and
bounds what the files take of the disk.
"""

from facade_manipulator.blackbox.arrivals import Arrivals
from facade_manipulator.blackbox.can_frames import (
    CAN_TOPIC,
    CanListener,
    frame_bytes,
    messages_of,
)
from facade_manipulator.blackbox.recording import (
    read_recording,
    Received,
    RecordedRun,
    write_mcap,
    write_recording,
)
from facade_manipulator.blackbox.ring import Kept, MessageRing, RecordedTopic
from facade_manipulator.blackbox.settings import BlackBoxSettings
from facade_manipulator.blackbox.shelf import Shelf
from facade_manipulator.blackbox.trigger import RecordTrigger

__all__ = [
    'Arrivals',
    'BlackBoxSettings',
    'CAN_TOPIC',
    'CanListener',
    'RecordedTopic',
    'frame_bytes',
    'Kept',
    'MessageRing',
    'messages_of',
    'read_recording',
    'Received',
    'RecordedRun',
    'RecordTrigger',
    'Shelf',
    'write_mcap',
    'write_recording',
]
