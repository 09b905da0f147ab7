"""
The node's side of the control loop: start its process, ask, publish setpoints, read its state.

Only `start` and `close` wait. The node reads the states when it feeds the watchdog or takes them:
a thread that waits for them would take the interpreter from the executor in each cycle. A process
that has ended is not started again by itself: the drives have stopped, and the operator
configures again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from itertools import count
import socket
import subprocess
import sys
from threading import Lock
import time
from typing import Any

from facade_manipulator.control_loop.channel import (
    Channel,
    ChannelClosedError,
    Message,
    socket_pair,
)
from facade_manipulator.control_loop.control_loop import LoopSetup, LoopState, StreamStatus
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.snapshot import AxisSnapshot, ControllerSnapshot
from facade_manipulator.errors import DriveError, ManipulatorError, ParameterError
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.resources import import_path

START_TIMEOUT = 30.0  # s
CLOSE_TIMEOUT = 8.0  # s: more than the loop takes to ramp down, power off and close the bus
# feeds, 3 s of them: without a bus the loop sends a state each second. Not a time, since a node
# that stood still itself finds old states, and a loop that is well.
MAX_UNANSWERED = 150
MAX_UNANSWERED_WITHOUT_BUS = 1500  # 30 s: some interfaces take long to open, and nothing runs then
WITHOUT_BUS = frozenset({ControllerState.UNCONFIGURED, ControllerState.BUS_LOST})
FEED_PERIOD = 0.02  # s, while it ends
MAX_STATES = 1000  # that nobody has taken: two seconds of the shortest cycle
MAY_GET_LOST = frozenset({'feed', 'setpoint', 'forces'})  # the next ones say more
LOST_REMEDY = 'find out why in the log, then configure, home, activate'
START = (  # the new interpreter imports from where this one does
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from facade_manipulator.control_loop.__main__ import main; sys.exit(main(int(sys.argv[1])))')


def start_process(end: socket.socket) -> subprocess.Popen[bytes]:
    """
    Start the loop in a process of its own that inherits one end of a channel.

    A new interpreter rather than a fork: no thread, lock or library of this one is in it. In a
    session of its own, so that the signals of a terminal reach the node alone, which then asks
    for an orderly end. Isolated, so that neither the working directory nor a user's folder of
    packages puts its own modules into the loop.
    """
    number = str(end.fileno())
    return subprocess.Popen(
        [sys.executable, '-I', '-c', START, number, *import_path()], pass_fds=(end.fileno(),),
        stdin=subprocess.DEVNULL, start_new_session=True)


class LoopClient:
    """
    The control loop as the node sees it.

    Limits and stream of the setup are kept up to date, should the loop be started again.
    `on_rejection` takes reason and message of a setpoint that the loop has rejected, and is
    called by `read`; of what `launch` starts, `wait` and `kill` are used. Raises a
    ManipulatorError if the process does not start, or its settings contradict each other.
    """

    def __init__(
        self, setup: LoopSetup, on_rejection: Callable[[str, str], None],
        launch: Callable[[socket.socket], subprocess.Popen[bytes]] = start_process,
    ) -> None:
        self._setup = setup
        self._on_rejection = on_rejection
        self._launch = launch
        self._numbers = count()
        self._reading = Lock()
        self._forbidden = ''
        self.start()

    def start(self) -> None:
        """Start the process, waits until it is ready; the drives stay as they are."""
        setup, (ours, theirs) = self._setup, socket_pair()
        channel = Channel(ours)
        with theirs:
            process = self._launch(theirs)
        try:
            channel.send('setup', setup)
            first = _receive_ready(channel)
        except ManipulatorError:
            _kill(process)
            channel.close()
            raise
        # only now does anybody else send: the setup has to be first
        self._jobs: dict[int, Future[Any]] = {}
        self._unanswered = 0
        self._closing = False
        self._farewell: Future[Any] | None = None
        self._state: LoopState = first
        self._received = 0
        self._states: deque[tuple[int, ControllerSnapshot]] = deque(maxlen=MAX_STATES)
        self._process, self._channel = process, channel
        self._is_lost = False
        if self._forbidden:
            self._send('forbid', self._forbidden)
        if self._setup is not setup:  # changed meanwhile
            self.change(limits=self._setup.limits)
            self.change(stream=self._setup.stream)

    # --- what the node asks for

    def request(self, name: str) -> Future[Any]:
        """Ask for a transition or a test; the future ends with the reply or with its error."""
        job: Future[Any] = Future()
        job.set_running_or_notify_cancel()  # from here on nobody can cancel it
        number = next(self._numbers)
        self._jobs[number] = job
        try:
            if self._is_lost:
                raise ChannelClosedError(self.snapshot().cause)
            self._channel.send('request', number, name, must_arrive=True)
        except ChannelClosedError as error:
            if self._jobs.pop(number, None) is not None:
                job.set_exception(DriveError(str(error)))
        return job

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Pass a setpoint on; a rejection comes back by `on_rejection`."""
        self._send('setpoint', *setpoint)

    def feed(self) -> None:
        """
        Show that the node is alive, read what the loop has sent, and end a loop that hangs.

        Only this keeps the loop going: it is called last in a cycle of the node, so that an
        exception before ends it.
        """
        self._send('feed')
        self.read()
        self._unanswered += 1
        bound = (MAX_UNANSWERED_WITHOUT_BUS if self.snapshot().state in WITHOUT_BUS
                 else MAX_UNANSWERED)
        if self._unanswered > bound and not self._is_lost:
            _kill(self._process)  # its drives miss the master's heartbeat and stop
            self._lose(f'the control loop has sent no state while it was fed '
                       f'{self._unanswered} times, bound {bound}, and was ended')

    def stop(self, cause: str) -> None:
        """Quick stop all axes at once."""
        self._send('stop', cause)

    def forbid_power(self, cause: str) -> None:
        """Let no drive have power, also of a loop that is started later, until ``''`` comes."""
        if cause != self._forbidden:
            self._forbidden = cause
            self._send('forbid', cause)

    def change(self, **part: Any) -> None:
        """Go on with another `limits` or `stream` of the setup, from the next cycle on."""
        (kind, settings), = part.items()
        self._setup = replace(self._setup, **{kind: settings})
        self._send(kind, settings)

    def disturb(self, number: int, method: str, *arguments: Any) -> None:
        """Inject a fault into a simulated drive, for tests and training."""
        self._send('disturb', number, method, *arguments)

    def apply_forces(self, forces: Sequence[float]) -> None:
        """Let forces along the rail [N] pull at the carriages of simulated drives."""
        self._send('forces', *forces)

    def _send(self, kind: str, *content: Any) -> None:
        try:
            self._channel.send(kind, *content, must_arrive=kind not in MAY_GET_LOST)
        except ChannelClosedError:
            pass  # `read` meets the same and reports it

    # --- what the loop says

    @property
    def is_lost(self) -> bool:
        """Return whether the process has ended without being asked to."""
        return self._is_lost and not self._closing

    def snapshot(self) -> ControllerSnapshot:
        """Return the newest state of controller and axes."""
        return self._state[0]

    def stream_status(self) -> StreamStatus:
        """Return how the setpoints are followed."""
        return self._state[1]

    def take_states(self, every: int) -> list[ControllerSnapshot]:
        """Read what the loop has sent; return one in `every` of its states, each only once."""
        self.read()
        taken = []
        while self._states:
            number, snapshot = self._states.popleft()
            if number % every == 0:
                taken.append(snapshot)
        return taken

    def read(self) -> None:
        """Take what the loop has sent meanwhile."""
        if self._is_lost or not self._reading.acquire(blocking=False):
            return  # nothing comes any more, or another thread takes it just now
        try:
            while (message := self._channel.receive(0.0)) is not None:
                self._handle(message)
        except ChannelClosedError:
            status = _exit_status(self._process)
            self._lose(f'the control loop has ended by itself, exit status {status}')
        finally:
            self._reading.release()

    def _handle(self, message: Message) -> None:
        self._unanswered = 0
        if message.kind == 'state':
            self._state = message.content
            self._received += 1
            self._states.append((self._received, self._state[0]))
        elif message.kind == 'rejected':
            self._on_rejection(*message.content)
        elif message.kind == 'reply':
            number, succeeded, answer = message.content
            job = self._jobs.pop(number)
            if succeeded:
                job.set_result(answer)
            else:
                job.set_exception(DriveError(answer))

    def _lose(self, reason: str) -> None:
        if self._is_lost:
            return
        snapshot, status = self._state
        cause = Cause(f'{reason}; the drives stop because its heartbeat is missing', LOST_REMEDY)
        state = ControllerState.CLOSED if self._closing else ControllerState.LOST
        self._is_lost, self._state = True, (ControllerSnapshot(
            state, None, tuple(AxisSnapshot(one.name, one.node_id) for one in snapshot.axes),
            () if self._closing else (cause,), '' if self._closing else LOST_REMEDY), status)
        self._channel.close()
        for number in list(self._jobs):
            job = self._jobs.pop(number, None)
            if job is not None:
                job.set_exception(DriveError(reason))

    def close(self) -> str:
        """
        Ramp down, power off, close the bus, end the process; waits for it.

        Raises a DriveError with the drives whose power is not confirmed off.
        """
        if self._farewell is None:
            self._farewell = self._end()
        return self._farewell.result()

    def _end(self) -> Future[Any]:
        self._closing = True
        job, end = self.request('close'), time.monotonic() + (
            CLOSE_TIMEOUT + self._setup.extra_time)
        while not job.done() and time.monotonic() < end:
            self.feed()
            time.sleep(FEED_PERIOD)
        self._send('close')
        try:
            self._process.wait(max(0.0, end - time.monotonic()) if job.done() else 0.0)
        except subprocess.TimeoutExpired:
            _kill(self._process)
        self._lose('the control loop has not said that the power of the drives is off')
        return job


def _receive_ready(channel: Channel) -> LoopState:
    """Wait until a new loop is ready; return its first state."""
    try:
        message = channel.receive(START_TIMEOUT)
    except ChannelClosedError:
        message = None
    kind: str = message.kind if message else ''
    content: Any = message.content if message else ()
    if kind == 'failed':
        raise ParameterError(*content)
    if kind != 'ready':
        raise ManipulatorError(
            'the process of the control loop did not start: see its output above')
    return content


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and collect its exit status, so that no zombie stays."""
    process.kill()
    _exit_status(process)


def _exit_status(process: subprocess.Popen[bytes]) -> int | str:
    try:
        return process.wait(1.0)
    except subprocess.TimeoutExpired:
        return 'unknown'
