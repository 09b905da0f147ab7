"""CAN bus of a tool in one thread, which receives frames while it waits."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from canopen.lss import (
    CS_FAST_SCAN,
    CS_IDENTIFY_SLAVE,
    CS_STORE_CONFIGURATION,
    CS_SWITCH_STATE_SELECTIVE_RESPONSE,
    CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER,
    ListMessageNeedResponse,
    LssMaster,
)

from facade_manipulator.canopen import cob_ids, indices
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import (
    complete_answer,
    expedited_number,
    Result,
    SDO_FRAME_LENGTH,
    SdoChannel,
    Steps,
    upload_request,
)
from facade_manipulator.errors import DriveError, DriveStateError, DriveTimeoutError

NODE_IDS = range(1, cob_ids.MASTER_NODE_ID)
BOOT_TIMEOUT = 5.0  # s
_CONFIRMING_TIME = 0.5  # s, for the answer to a command that is not part of a scan
STORING_TIME = 3.0  # s; CiA 305 has no bound; drives needed more than 0.3 s
_LISTENING_TIME = 0.6  # s: several periods of a driver's heartbeat
_ASK_SERIAL_NUMBER = upload_request(indices.IDENTITY, 4)
_LOOK_PERIOD = 0.02  # s, between two checks of a condition on a quiet bus
_PACE = 0.002  # s between requests: a send queue of ten frames does not fill up
_ANSWER = 0.25  # s
_SCAN_ATTEMPTS = 2  # questions of fastscan before silence is an answer
_LATENCY_MARGIN = 1.5  # of the slowest answer, for which late answers are awaited
# command specifiers of the answers that differ from those of the requests
_ANSWERS = {
    CS_FAST_SCAN: CS_IDENTIFY_SLAVE,
    CS_SWITCH_STATE_SELECTIVE_SERIAL_NUMBER: CS_SWITCH_STATE_SELECTIVE_RESPONSE,
}
_SYNC = cob_ids.frames_of_masters(())[cob_ids.SYNC][0]
_MASTER_REMEDY = 'end the driver or the other tool'
_SYNC_REMEDY = (
    f'{_MASTER_REMEDY}; without one a drive sends SYNC itself: clear bit 30 of its 1005h '
    'with the tool of its maker'
)


class ToolBus:
    """Bus of a running command, which receives frames while the command waits."""

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
        Wait for a frame, and receive the frames that have arrived by then.

        If this process was interrupted, answers wait that arrived before their time-out.
        """
        frame = self._receive(_LOOK_PERIOD)
        now = self.monotonic()
        while frame is not None and frame.time < now:
            frame = self._receive(0.0)

    def _receive(self, timeout: float) -> Frame | None:
        """Receive a frame within a timeout [s], and pass it on."""
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
        Receive frames until a condition holds or a timeout [s]; return the condition.

        If this process was interrupted, frames wait that arrived before the timeout. They are
        received, too.
        """
        end = self.monotonic() + timeout
        while not condition():
            left = end - self.monotonic()
            frame = self._receive(min(max(left, 0.0), _LOOK_PERIOD))
            if left <= 0.0 and (frame is None or frame.time > end):
                break
        return bool(condition())

    def require_alone(self) -> None:
        """Raise a DriveStateError if frames of another master are received."""
        self.wait(_LISTENING_TIME)
        masters = cob_ids.frames_of_masters(NODE_IDS)
        if heard := [
            masters[one.cob_id][0] for one in self._received if one.cob_id in masters
        ]:
            raise DriveStateError(
                f'the bus {self.frames} is in use by another master: {heard[0]} was received; '
                f'next: {_SYNC_REMEDY if set(heard) == {_SYNC} else _MASTER_REMEDY}'
            )

    def serial_numbers(self, node_ids: Iterable[int]) -> dict[int, list[int]]:
        """Return every serial number received from each node id; all nodes are asked together."""
        self._received.clear()
        for node_id in node_ids:
            self.frames.send(cob_ids.SDO_REQUEST + node_id, _ASK_SERIAL_NUMBER)
            self.wait(_PACE)
        self.wait(_ANSWER)
        found: dict[int, list[int]] = defaultdict(list)
        for frame in self._received:
            node_id = frame.cob_id - cob_ids.SDO_RESPONSE
            answer = complete_answer(frame.data)
            if node_id in NODE_IDS and answer is not None:
                # 0 for a drive without a serial number
                found[node_id].append(expedited_number(answer) or 0)
        return found

    def number(self, node_id: int, index: int, subindex: int = 0) -> int | None:
        """Return the number in an object, None without a numeric answer."""
        with suppress(DriveError):
            objects = self.objects(node_id, f'node {node_id}')
            return self.run(objects.read_number(index, subindex))
        return None

    def objects(self, node_id: int, name: str, eds: Path | None = None) -> SdoChannel:
        """Return the objects of a node; `name` is the drive's name for the operator."""
        objects = SdoChannel(self.frames, node_id, name, eds, self._clock)
        self.receivers[cob_ids.SDO_RESPONSE + node_id] = objects.receive
        return objects

    def reset(self, node_id: int, boot_time: float = 0.0) -> None:
        """
        Reset a drive and wait for its boot-up message.

        `boot_time` is the time that it needs if longer than `BOOT_TIMEOUT` [s]. Raises a
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


class LssTransport:
    """
    Frames of a master of layer setting services, of which each answer belongs to its question.

    An answer to fastscan does not repeat its question, and several slaves answer at different
    times. Therefore the transport listens after an answer for as long as the slowest slave has
    needed. It asks again after silence, because a slave may have been slow for once.
    """

    def __init__(self, bus: ToolBus, master: LssMaster, timeout: float) -> None:
        self._bus, self._master, self._timeout = bus, master, timeout
        self._slowest: float | None = (
            None  # longest time from a question to an answer [s]
        )
        self._asked_at = self._sent_at = 0.0
        self._expected: int | None = None  # command specifier of the answer
        bus.receivers[LssMaster.LSS_RX_COBID] = self._receive

    def send_message(self, cob_id: int, data: bytes) -> None:
        """Send a request and wait for its answer."""
        command = data[0]
        is_scan = command == CS_FAST_SCAN
        is_first_scan = is_scan and self._slowest is None
        self._bus.wait(_PACE)
        self._master.responses.queue.clear()
        self._expected = _ANSWERS.get(command, command)
        self._asked_at = self._bus.monotonic()
        for _ in range(_SCAN_ATTEMPTS if is_scan else 1):
            self._sent_at = self._bus.monotonic()
            self._bus.frames.send(cob_id, bytes(data))
            if self._bus.wait_for(
                lambda: self._master.responses.queue, self._longest_wait(command)
            ):
                break
        if is_scan and self._master.responses.queue:
            self._await_other_answers(is_first_scan)

    def _longest_wait(self, command: int) -> float:
        """Return the time to wait for the answer to a command [s]."""
        if command == CS_STORE_CONFIGURATION:
            return STORING_TIME
        if command == CS_FAST_SCAN:
            return max(self._timeout, _LATENCY_MARGIN * (self._slowest or 0.0))
        if command in ListMessageNeedResponse:
            return max(self._timeout, _CONFIRMING_TIME)
        return self._timeout

    def _await_other_answers(self, is_first_scan: bool) -> None:
        """Listen until the slaves that answer later than the first have answered."""
        longest = _LATENCY_MARGIN * (self._slowest or 0.0)
        if is_first_scan:
            longest = max(longest, 2.0 * self._timeout)
        end = self._sent_at + longest
        self._bus.wait(max(0.0, end - self._bus.monotonic()))

    def _receive(self, frame: Frame) -> None:
        if not frame.data or frame.data[0] != self._expected:
            return
        if self._expected == CS_IDENTIFY_SLAVE:
            latency = self._bus.monotonic() - self._asked_at
            self._slowest = max(self._slowest or 0.0, latency)
        if not self._master.responses.queue:
            self._master.responses.put(frame.data.ljust(SDO_FRAME_LENGTH, b'\0'))


def lss_master(bus: ToolBus, timeout: float) -> LssMaster:
    """
    Return the canopen library's master of layer setting services, with a timeout [s].

    The timeout limits the wait for the answer to each request.
    """
    master = LssMaster()
    master.RESPONSE_TIMEOUT = 0.0  # the answer is there by then
    master.network = LssTransport(bus, master, timeout)  # type: ignore[assignment]
    return master
