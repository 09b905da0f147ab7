"""
Client of the control loop in the node: starts its process, sends requests, receives states.

Only the first start and `close` wait. The node reads the messages of the loop when it feeds the
loop or takes states. A thread that waited for these messages would take the interpreter from the
executor in each cycle. The node restarts a process that has ended only for the next `configure`,
because the drives have stopped and the operator must configure them again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import count
import math
import signal
import socket
import subprocess
import sys
import time
from typing import Any

from facade_manipulator.control_loop.loop_channel import (
    Channel,
    channel_ends,
    LoopSetup,
)
from facade_manipulator.drives.outcome import outcome_of
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
    Remedy,
)
from facade_manipulator.errors import DriveError, ManipulatorError, ParameterError
from facade_manipulator.motion.follower import StreamStatus
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.package_files import import_path
from facade_manipulator.timeouts import CLOSE_TIMEOUT

FEED_PERIOD = 0.05  # s; halt is answered within 0.1 s
START_CODE = (  # the new interpreter has the import path of this one
    'import sys; sys.path[:] = sys.argv[3:]; '
    'from facade_manipulator.control_loop import control_loop; '
    'sys.exit(control_loop.main(*map(int, sys.argv[1:3])))'
)


def start_process(*ends: socket.socket) -> subprocess.Popen[bytes]:
    """
    Start the loop in a separate process, which inherits both sockets of a channel end.

    The process is a new interpreter instead of a fork, without the threads, locks and libraries of
    this process. It has its own session, so that the signals of a terminal reach only the node,
    which then requests an orderly end. It is isolated, so that neither the working directory nor a
    user's folder of packages puts its own modules into the loop.
    """
    numbers = [end.fileno() for end in ends]
    return subprocess.Popen(
        [sys.executable, '-I', '-c', START_CODE, *map(str, numbers), *import_path()],
        pass_fds=numbers,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )


#: takes the reply to a request: its result, or the error with which it failed
OnReply = Callable[[Any], None]


class LoopClient:
    """
    Interface between the node and the control loop, used by a single thread.

    `on_rejection` takes reason and message of a setpoint that the loop has rejected. The method
    `read` calls it, and also calls the functions that take the replies to requests. The result of
    `launch` needs only `wait` and `kill` of a process. Raises a ManipulatorError if the process
    does not start, or if its settings contradict each other.
    """

    START_TIMEOUT = 30.0  # s
    # number of feeds in 3 s; without a bus the loop sends a state each second. The limit is not a
    # time, because a node that hung itself would find old states of a healthy loop.
    MAX_UNANSWERED = 60
    # number of feeds in 30 s: a process takes long to start, some interfaces take long to open,
    # and no drive runs then
    MAX_UNANSWERED_WITHOUT_BUS = {
        ControllerState.LOST: 600,  # the state until a restarted loop sends its own
        ControllerState.UNCONFIGURED: 600,
        ControllerState.BUS_LOST: 600,
    }
    # states in which the loop may open or close an interface, and read nothing for seconds
    MAY_BE_SILENT = frozenset(
        {
            *MAX_UNANSWERED_WITHOUT_BUS,
            ControllerState.CONFIGURING,
            ControllerState.CLEANING_UP,
        }
    )
    # feeds without an answer; a loop that opens an interface reads nothing, and its channel must
    # not become full
    MOST_FEEDS = 100
    MOST_STATES = 200  # waiting states: those of two seconds
    # exit status of a loop that the alarm of the kernel has ended
    HUNG = -signal.SIGALRM
    STOP_BY_HEARTBEAT = 'the drives stop because its heartbeat is missing'
    POWER_CONFIRMED_OFF = (
        'the drives that it had configured have confirmed that their power is off'
    )
    SILENT_REMEDY = 'wait until the control loop answers or is ended'
    LOST_REMEDY = 'read the cause in the log, then configure, home, activate'

    def __init__(
        self,
        setup: LoopSetup,
        on_rejection: Callable[[str, str], None],
        launch: Callable[..., subprocess.Popen[bytes]] = start_process,
    ) -> None:
        setup.stopping.check()
        self._setup = setup
        # Feeds without an answer after which the loop is shown as silent. The drives have missed
        # its heartbeat then.
        self._silent_after = (
            math.ceil(setup.controller.heartbeat_timeout / FEED_PERIOD) + 2
        )
        self._on_rejection = on_rejection
        self._launch = launch
        self._numbers = count()
        #: newest message of the loop
        self._state: tuple[ControllerSnapshot, StreamStatus]
        #: requests without a reply, by number
        self._pending: dict[int, OnReply] = {}
        #: received replies that were not passed on yet
        self._replies: deque[tuple[OnReply, Any]] = deque()
        # states that the node has not taken yet
        self._states: deque[ControllerSnapshot] = deque(maxlen=self.MOST_STATES)
        # cause for which power is forbidden, empty if it is allowed; next step for this cause, and
        # whether the cause lasts until clear_faults
        self._forbidden = ('', '', True)
        self._close_due = math.inf  #: end of the time for `shut_down` [s, monotonic]
        self._at_end: list[OnReply] = []
        self._last_reply: Any = None  #: to `shut_down`
        self.start()
        self._wait_for_start()

    def start(self) -> None:
        """
        Start a process, also after an earlier process has ended; `read` receives its first state.

        Raises a ManipulatorError if the system starts no process.
        """
        ours, theirs = channel_ends()
        self._channel = Channel(*ours)
        try:
            self._process = self._launch(*theirs)
        except OSError as error:
            self._channel.close()
            raise ManipulatorError(
                f'the process of the control loop did not start: {error}; next: '
                'end other programs on this computer'
            ) from error
        finally:
            for end in theirs:
                end.close()
        self._unanswered = 0
        self._is_lost = False
        self._command('setup', self._setup)
        self._command('forbid', *self._forbidden)

    def _wait_for_start(self) -> None:
        """Wait until the loop sends its first message."""
        message = None
        self._channel.wait(self.START_TIMEOUT)
        with suppress(ConnectionError):
            message = next(self._channel.commands(), None)
        kind, content = message or ('', ())
        if kind == 'started':
            self._state = content
            return
        _end(self._process)
        self._channel.close()
        if kind == 'failed':
            raise ParameterError(*content)
        raise ManipulatorError(
            'the process of the control loop did not start; next: read its output above'
        )

    # --- to the loop

    def request(self, name: str, on_reply: OnReply) -> None:
        """Request a transition or a test; `read` later passes the reply to `on_reply`."""
        number = next(self._numbers)
        self._pending[number] = on_reply
        if self._is_lost:
            self._reject_pending(self.snapshot().cause or 'the control loop is closed')
        else:
            self._command('request', number, name)

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Send a setpoint to the loop; a rejection is passed to `on_rejection`."""
        self._channel.send('setpoint', *setpoint)

    def feed(self) -> None:
        """
        Prove that the node is alive, read the loop's messages, and end a loop that hangs.

        The loop runs only while this method is called. The node calls it last in its cycle, so
        that an earlier exception ends the loop.
        """
        if self._unanswered < self.MOST_FEEDS:
            self._command('feed')
        self.read()
        if self._is_lost:
            return
        self._unanswered += 1
        if self._unanswered == self._silent_after:
            self._show_silence()
        bound = self.MAX_UNANSWERED_WITHOUT_BUS.get(
            self.snapshot().state, self.MAX_UNANSWERED
        )
        if self._unanswered > bound:
            _end(self._process)  # its drives miss the master's heartbeat and stop
            self._lose(
                f'the control loop has sent no state while it was fed '
                f'{self._unanswered} times, above the limit {bound}, and was ended; '
                f'{self.STOP_BY_HEARTBEAT}'
            )
        elif time.monotonic() > self._close_due:
            self._end_closed(0.0)

    def stop(self, cause: str) -> None:
        """Quick-stop all axes at once."""
        self._command('stop', cause)

    def forbid_power(
        self, cause: str, remedy: str = '', is_latched: bool = True
    ) -> None:
        """Forbid power, also for a loop started later, until a call with the cause ``''``."""
        forbidden = (cause, remedy, is_latched)
        if forbidden != self._forbidden:
            self._forbidden = forbidden
            self._command('forbid', *forbidden)

    def check(self, limits: MotionLimits) -> None:
        """Raise a ParameterError if the carriages could touch with these limits."""
        replace(self._setup, limits=limits).stopping.check()

    def change(self, limits: MotionLimits) -> None:
        """Replace the motion limits, which are already checked, from the next cycle."""
        self._setup = replace(self._setup, limits=limits)
        self._command('limits', limits)

    def apply_forces(self, forces: Sequence[float]) -> None:
        """Apply forces along the rail [N] to the carriages of simulated drives."""
        self._channel.send('forces', *forces)

    def _command(self, kind: str, *content: Any) -> None:
        """Send a command; end a loop that has not read the previous commands."""
        if self._is_lost or self._channel.send(kind, *content):
            return
        _end(self._process)
        self._lose(
            f'the control loop has not read its messages, and was ended; {self.STOP_BY_HEARTBEAT}'
        )

    # --- from the loop

    def snapshot(self) -> ControllerSnapshot:
        """Return the newest state of controller and axes."""
        return self._state[0]

    def stream_status(self) -> StreamStatus:
        """Return the status of the setpoint stream."""
        return self._state[1]

    def take_states(self) -> list[ControllerSnapshot]:
        """Return the states received since the last call, at most 100 states per second."""
        self.read()
        states = [*self._states]
        self._states.clear()
        return states

    def read(self) -> None:
        """Receive the loop's messages, then call the functions for its replies."""
        if not self._is_lost:
            self._receive()
        while self._replies:  # after an exception, the next call continues
            on_reply, reply = self._replies.popleft()
            on_reply(reply)

    def _receive(self) -> None:
        """Handle all waiting messages; states are newer than the replies sent before them."""
        try:
            for message in self._channel.commands():
                self._handle(*message)
            for message in self._channel.stream(self.MOST_STATES):
                self._handle(*message)
        except ConnectionError:
            status = _end(self._process, 1.0)
            end = 'has hung' if status == self.HUNG else 'has ended by itself'
            self._lose(
                f'the control loop {end}, exit status {status}; '
                f'{self.POWER_CONFIRMED_OFF if status == 0 else self.STOP_BY_HEARTBEAT}'
            )

    def _handle(self, kind: str, content: tuple[Any, ...]) -> None:
        """Handle a message of the loop, which also proves that the loop is running."""
        self._unanswered = 0
        if kind == 'started':
            self._state = content
        elif kind == 'state':
            self._state = content
            self._states.append(content[0])
        elif kind == 'rejected':
            self._on_rejection(*content)
        elif kind == 'reply':
            number, succeeded, answer = content
            reply = answer if succeeded else DriveError(answer)
            self._replies.append((self._pending.pop(number), reply))
        elif kind == 'failed':  # from a restarted loop
            _end(self._process, 1.0)
            self._lose(f'the control loop did not start: {content[0]}')

    def _show_silence(self) -> None:
        """Replace the state of a loop that does not answer, until it sends its next state."""
        snapshot, status = self._state
        if snapshot.state in self.MAY_BE_SILENT or self._is_closing:
            return
        cause = Cause(
            'the control loop does not answer: it has sent no state while it was fed '
            f'{self._unanswered} times; {self.STOP_BY_HEARTBEAT}',
            self.SILENT_REMEDY,
        )
        silent = snapshot._replace(
            state=ControllerState.SILENT,
            axes=tuple(one._replace(is_silent=True) for one in snapshot.axes),
            causes=(cause, *snapshot.causes),
            next_step=self.SILENT_REMEDY,
        )
        self._state = (silent, status)

    def _lose(self, reason: str) -> None:
        """Record the end of the process, and reject all unanswered requests."""
        if self._is_lost:
            return
        snapshot, status = self._state
        lost = ControllerSnapshot(
            ControllerState.CLOSED,
            None,
            tuple(AxisSnapshot(one.name, one.node_id) for one in snapshot.axes),
            next_step=Remedy.START_DRIVER,
        )
        if not self._is_closing:
            lost = lost._replace(
                state=ControllerState.LOST,
                next_step=self.LOST_REMEDY,
                causes=(Cause(reason, self.LOST_REMEDY),),
            )
        self._is_lost = True
        self._state = (lost, status)
        self._channel.close()
        self._reject_pending(reason)

    def _reject_pending(self, reason: str) -> None:
        """Reject all unanswered requests, because the loop has ended."""
        reason = outcome_of(self.snapshot()).with_next_step(reason)
        for on_reply in self._pending.values():
            self._replies.append((on_reply, DriveError(reason)))
        self._pending.clear()

    # --- the end

    @property
    def _is_closing(self) -> bool:
        return self._close_due < math.inf

    def shut_down(self, on_reply: OnReply) -> None:
        """
        Ramp down, power off, close the bus and end the process.

        The reply is a DriveError if the power of a drive is not confirmed off.
        """
        if self._last_reply is not None:
            self._replies.append((on_reply, self._last_reply))
            return
        self._at_end.append(on_reply)
        if not self._is_closing:  # a signal may come while the node shuts down
            extra_time = self._setup.extra_time
            self._close_due = time.monotonic() + CLOSE_TIMEOUT + extra_time
            self.request('close', self._finish)

    def _finish(self, reply: Any) -> None:
        """End the process after its last reply."""
        self._end_closed(max(0.0, self._close_due - time.monotonic()))
        self._last_reply = reply
        self._replies += [(on_reply, reply) for on_reply in self._at_end]

    def close(self) -> Any:
        """
        Shut down, wait until the process has ended, and return the last reply.

        Raises a DriveError with the drives whose power is not confirmed off.
        """
        replies: list[Any] = []
        self.shut_down(replies.append)
        self.feed()
        while not replies:
            time.sleep(FEED_PERIOD)
            self.feed()
        if isinstance(replies[0], Exception):
            raise replies[0]
        return replies[0]

    def _end_closed(self, timeout: float) -> None:
        """End a loop that was shut down, unless it exits by itself within a timeout [s]."""
        if self._is_lost:
            return
        self._command('close')
        _end(self._process, timeout)
        self._lose(
            'the control loop has not confirmed that the power of the drives is off'
        )


def _end(process: subprocess.Popen[bytes], timeout: float = 0.0) -> int | str:
    """Wait for a process to end, and kill it after a timeout [s]; return its exit status."""
    with suppress(subprocess.TimeoutExpired):
        return process.wait(timeout)
    process.kill()
    with suppress(subprocess.TimeoutExpired):
        process.wait(1.0)  # collect the exit status, so that no zombie stays
    return 'unknown, killed'
