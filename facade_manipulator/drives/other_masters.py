"""Detection of another master on the bus from the frames that only a master sends."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from facade_manipulator.canopen import cob_ids
from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.sdo import is_write
from facade_manipulator.drives.snapshot import Cause, Remedy
from facade_manipulator.errors import BusError

_SYNC_NAME, _ = cob_ids.frames_of_masters(())[cob_ids.SYNC]
#: takes a frame; returns the cause of a stop, if any
Receiver = Callable[[Frame], Cause | None]


class OtherMasters:
    """
    Detector of other masters; the exchange passes frames of a master to the detector.

    This master does not receive its own frames, except the SYNC of its kernel. Until the cycle
    starts, a frame of a master raises a BusError. Afterwards a frame that commands drives is the
    cause of a stop. A drive may send SYNC itself until configure disables it.
    """

    def __init__(self) -> None:
        self._has_received_sync = False  # whether SYNC was received before the start
        self._accepts_sync = True  # whether a SYNC before the start may be of a drive
        self._has_started = False  # whether the cycle has started
        self._has_local_sync = False  # whether our SYNC returns marked as sent here

    def receivers(self, node_ids: Iterable[int]) -> dict[int, Receiver]:
        """Return the function that receives each frame of a master, by COB-ID."""
        nodes = tuple(node_ids)
        found: dict[int, Receiver] = {}
        for cob_id, (name, commands_drives) in cob_ids.frames_of_masters(nodes).items():
            found[cob_id] = partial(self._receive, name, commands_drives)
        for node in nodes:
            request = cob_ids.SDO_REQUEST + node
            found[request] = partial(self._receive_sdo_request, node)
        found[cob_ids.SYNC] = self._receive_sync
        return found

    def start(self) -> None:
        """Treat frames of another master as causes of a stop from now on."""
        self._has_started = True

    def _receive(self, name: str, commands_drives: bool, _: Frame) -> Cause | None:
        """
        Return the cause of a stop for a frame of another master; None if the frame is harmless.

        Raises a BusError before the start of the cycle.
        """
        if not self._has_started:
            raise _in_use_error(name)
        if not commands_drives:
            return None
        message = f'another master is on the bus: {name} was received'
        return Cause(message, Remedy.OTHER_MASTER)

    def _receive_sdo_request(self, node: int, frame: Frame) -> Cause | None:
        """Return the cause of a stop if an SDO request of another master writes."""
        writes = is_write(frame.data)
        name = f'an SDO {"write" if writes else "request"} to node {node}'
        return self._receive(name, writes, frame)

    # --- SYNC

    def _receive_sync(self, frame: Frame) -> Cause | None:
        """Record a SYNC received before the start; a drive may have sent it."""
        if not self._has_started:
            self._has_received_sync = True
            if self._accepts_sync:
                return None
        return self.receive_foreign_sync(frame)

    def receive_foreign_sync(self, frame: Frame) -> Cause | None:
        """Return the cause of a stop if this master did not send the SYNC."""
        return self._receive(_SYNC_NAME, True, frame)

    def expect_sync(self, is_expected: bool) -> None:
        """
        Set whether a drive is expected to send SYNC before the start.

        Raises a BusError if SYNC was received that no drive has sent.
        """
        self._accepts_sync = is_expected
        if self._has_received_sync and not is_expected:
            raise _in_use_error(_SYNC_NAME)

    def forget_sync(self) -> None:
        """Forget the SYNCs that drives sent before configure disabled them."""
        self._has_received_sync = False

    def note_own_sync(self, frame: Frame) -> None:
        """Record that SocketCAN marks our SYNC messages, once a marked SYNC is received."""
        self._has_local_sync = self._has_local_sync or frame.is_local

    def is_foreign_sync(self, frame: Frame) -> bool:
        """
        Return whether another node has sent a SYNC.

        Our SYNC has no data. Where SocketCAN marks it as sent on this computer, a SYNC without
        this mark is foreign. On other interfaces the clock counts surplus SYNCs.
        """
        is_unmarked = self._has_local_sync and not frame.is_local
        return bool(frame.data) or is_unmarked


def _in_use_error(name: str) -> BusError:
    """Return the error for a bus on which another master has sent a frame."""
    return BusError(
        f'another master uses this bus: {name} was received; next: end that master (a '
        'second driver, a configuration tool), or open another bus'
    )
