"""CAN bus of a tool, which receives frames while the only thread waits."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from facade_manipulator.canopen import cob_ids, indices
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.lss import REQUEST_PACE
from facade_manipulator.canopen.sdo import (
    complete_answer,
    expedited_number,
    Result,
    SdoChannel,
    Steps,
    upload_request,
)
from facade_manipulator.errors import DriveError, DriveStateError, DriveTimeoutError

NODE_IDS = range(1, cob_ids.MASTER_NODE_ID)
BOOT_TIMEOUT = 5.0  # s


class ToolBus:
    """Bus of a command, which receives frames while the command waits."""

    _LISTENING_TIME = 0.6  # s, several periods of a driver's heartbeat
    _ASK_SERIAL_NUMBER = upload_request(indices.IDENTITY, 4)
    _LOOK_PERIOD = 0.02  # s, between two checks of a condition on a quiet bus
    _ANSWER = 0.25  # s
    _SYNC = cob_ids.frames_of_masters(())[cob_ids.SYNC][0]
    _MASTER_REMEDY = 'end the driver or the other tool'
    _SYNC_REMEDY = (
        f'{_MASTER_REMEDY}; without another master, a drive sends SYNC itself: clear bit 30 of '
        'its 1005h with the tool of its maker'
    )

    def __init__(self, frames: CanBus, clock: Clock) -> None:
        self.monotonic = clock.monotonic
        self.frames = frames
        self._clock = clock
        #: receivers of answers by COB-ID
        self.receivers: dict[int, Callable[[Frame], None]] = {}
        self._received: list[Frame] = []

    def run(self, steps: Steps[Result]) -> Result:
        """Run the steps of a drive while receiving frames; return their result."""
        while True:
            try:
                next(steps)
            except StopIteration as end:
                return end.value
            self._receive_waiting()

    def _receive_waiting(self) -> None:
        """
        Wait for a frame, then receive all frames that have arrived.

        If this process was interrupted, answers that arrived before their time-out are waiting.
        """
        frame = self._receive(self._LOOK_PERIOD)
        now = self.monotonic()
        while frame is not None and frame.time < now:
            frame = self._receive(0.0)

    def _receive(self, timeout: float) -> Frame | None:
        """Receive a frame within a timeout [s], and pass it to its receiver."""
        frame = self.frames.receive(timeout)
        if frame is not None:
            self._received.append(frame)
            if frame.cob_id in self.receivers:
                self.receivers[frame.cob_id](frame)
        return frame

    def wait(self, seconds: float) -> None:
        """Receive frames for a time [s]."""
        self.wait_for(lambda: False, seconds)

    def wait_for(self, condition: Callable[[], object], timeout: float) -> bool:
        """
        Receive frames until a condition holds or a timeout [s] expires; return the condition.

        If this process was interrupted, frames that arrived before the timeout are waiting, and
        are also received. A condition may send a request to a drive; the wait can then exceed the
        timeout. An exception from the condition ends the wait.
        """
        end = self.monotonic() + timeout
        while not condition():
            left = end - self.monotonic()
            frame = self._receive(min(max(left, 0.0), self._LOOK_PERIOD))
            if left <= 0.0 and (frame is None or frame.time > end):
                break
        return bool(condition())

    def require_alone(self) -> None:
        """Raise a DriveStateError if another master sends frames."""
        self.wait(self._LISTENING_TIME)
        masters = cob_ids.frames_of_masters(NODE_IDS)
        if heard := [
            masters[one.cob_id][0] for one in self._received if one.cob_id in masters
        ]:
            raise DriveStateError(
                f'the bus {self.frames} is in use by another master: {heard[0]} was received; '
                f'next: {self._SYNC_REMEDY if set(heard) == {self._SYNC} else self._MASTER_REMEDY}'
            )

    def serial_numbers(self, node_ids: Iterable[int]) -> dict[int, list[int]]:
        """Return every serial number received from each node id; ask all nodes together."""
        self._received.clear()
        for node_id in node_ids:
            self.frames.send(cob_ids.SDO_REQUEST + node_id, self._ASK_SERIAL_NUMBER)
            self.wait(REQUEST_PACE)
        self.wait(self._ANSWER)
        found: dict[int, list[int]] = defaultdict(list)
        for frame in self._received:
            node_id = frame.cob_id - cob_ids.SDO_RESPONSE
            answer = complete_answer(frame.data)
            if node_id in NODE_IDS and answer is not None:
                # 0 for a drive without a serial number
                found[node_id].append(expedited_number(answer) or 0)
        return found

    def number(self, node_id: int, index: int, subindex: int = 0) -> int | None:
        """Return the number read from an object; None without a numeric answer."""
        with suppress(DriveError):
            objects = self.objects(node_id, f'node {node_id}')
            return self.run(objects.read_number(index, subindex))
        return None

    def objects(self, node_id: int, name: str, eds: Path | None = None) -> SdoChannel:
        """Return the objects of a node; `name` is the drive's name in messages."""
        objects = SdoChannel(self.frames, node_id, name, eds, self._clock)
        self.receivers[cob_ids.SDO_RESPONSE + node_id] = objects.receive
        return objects

    def reset(self, node_id: int, boot_time: float = 0.0) -> None:
        """
        Reset a drive and wait for its boot-up message.

        `boot_time` is the time that the drive needs if longer than `BOOT_TIMEOUT` [s]. Raises a
        DriveTimeoutError.
        """
        timeout = max(boot_time, BOOT_TIMEOUT)
        self._received.clear()
        self.frames.command('RESET', node_id)
        boot_up = cob_ids.HEARTBEAT + node_id
        if not self.wait_for(
            lambda: any(one.cob_id == boot_up for one in self._received), timeout
        ):
            raise DriveTimeoutError(
                f'node {node_id} sent no boot-up message in {timeout:g} '
                's; next: switch its power off and on, then scan'
            )
