"""
The black box: messages of the last minutes in, one MCAP file per stop, fault or request out.

`BlackBox` is the whole: its `Stream` keeps them on the disk, `RecordTrigger` says when a file is
due, `Shelf` writes it whole and bounds what the files take of the disk.
"""

from .black_box import BlackBox as BlackBox
from .can_frames import CAN_TOPIC as CAN_TOPIC
from .can_frames import CanListener as CanListener
from .can_frames import frame_bytes as frame_bytes
from .can_frames import messages_of as messages_of
from .messages import Kept as Kept
from .messages import RecordedTopic as RecordedTopic
from .recording import read_recording as read_recording
from .recording import Received as Received
from .recording import RecordedRun as RecordedRun
from .recording import write_mcap as write_mcap
from .recording import write_recording as write_recording
from .settings import BlackBoxSettings as BlackBoxSettings
from .shelf import RESERVE as RESERVE
from .shelf import Shelf as Shelf
from .stream import Stream as Stream
from .trigger import RecordTrigger as RecordTrigger
