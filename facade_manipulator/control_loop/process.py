"""
Node's side of the control loop: start of its process, requests, setpoints and states.

Only `start` and `close` wait. The node reads the states when it feeds the loop or takes states. A
thread that waits for them would take the interpreter from the executor in each cycle. The node
does not restart a process that has ended: the drives have stopped, and the operator configures
again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import count
import socket
import subprocess
import sys
from threading import Lock
import time
from typing import Any

from facade_manipulator.control_loop.channel import Channel, LoopSetup
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.errors import DriveError, ManipulatorError, ParameterError
from facade_manipulator.motion.follower import StreamStatus
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.resources import import_path

CLOSE_TIMEOUT = (
    8.0  # s: more than the loop takes to ramp down, power off and close the bus
)
# feeds, 3 s: without a bus the loop sends a state each second. The bound is not a time, because a
# node that hung itself finds old states of a healthy loop.
MAX_UNANSWERED = 60
# 30 s: some interfaces take long to open, and nothing runs then
MAX_UNANSWERED_WITHOUT_BUS = {
    ControllerState.UNCONFIGURED: 600,
    ControllerState.BUS_LOST: 600,
}
FEED_PERIOD = 0.05  # s; halt is answered within 0.1 s
STOP = 'the drives stop because its heartbeat is missing'
POWER_OFF = 'the drives that it had configured have confirmed that their power is off'
LOST_REMEDY = 'read the cause in the log, then configure, home, activate'
START = (  # the new interpreter imports from where this one does
    'import sys; sys.path[:] = sys.argv[2:]; '
    'from facade_manipulator.control_loop import control_loop; '
    'sys.exit(control_loop.main(int(sys.argv[1])))'
)


def start_process(end: socket.socket) -> subprocess.Popen[bytes]:
    """
    Start the loop in a separate process that inherits one end of a channel.

    It is a new interpreter instead of a fork, without the threads, locks and libraries of this
    process. It has its own session, so that the signals of a terminal reach only the node, which
    then asks for an orderly end. It is isolated, so that neither the working directory nor a
    user's folder of packages puts its own modules into the loop.
    """
    number = str(end.fileno())
    return subprocess.Popen(
        [sys.executable, '-I', '-c', START, number, *import_path()],
        pass_fds=(end.fileno(),),
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )


class LoopClient:
    """
    Interface of the node to the control loop.

    A loop that is started again receives the present limits. `on_rejection` takes reason and
    message of a setpoint that the loop has rejected, and is called by `read`. The result of
    `launch` needs only `wait` and `kill` of a process. Raises a ManipulatorError if the process
    does not start, or its settings contradict each other.
    """

    def __init__(
        self,
        setup: LoopSetup,
        on_rejection: Callable[[str, str], None],
        launch: Callable[[socket.socket], subprocess.Popen[bytes]] = start_process,
    ) -> None:
        self._setup = setup
        self._on_rejection = on_rejection
        self._launch = launch
        self._numbers = count()
        self._reading = Lock()
        self._ending = Lock()
        # held while the state of a loop changes that a loop started later must also have
        self._changing = Lock()
        self._forbidden = self._remedy = ''
        self._closing = False
        self.start()

    def start(self) -> None:
        """
        Start the process and wait until it is ready, without a change of the drives.

        Raises a ManipulatorError if the process does not start, or `close` was called.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        channel = Channel(ours)
        with theirs:
            process = self._launch(theirs)
        kind, content = '', None  # type: str, Any
        channel.send('setup', self._setup)
        with suppress(ConnectionError):
            kind, content = channel.receive(30.0) or (kind, content)  # s
        if kind != 'state':
            _end(process)
            channel.close()
            if kind == 'failed':
                raise ParameterError(*content)
            raise ManipulatorError(
                'the process of the control loop did not start; next: read its output above'
            )
        with self._changing:
            if self._closing:
                _end(process)
                channel.close()
                raise ManipulatorError('the control loop is closed')
            self._connect(process, channel, content)

    def _connect(
        self,
        process: subprocess.Popen[bytes],
        channel: Channel,
        state: tuple[ControllerSnapshot, StreamStatus],
    ) -> None:
        """Use a loop that is ready, and send the state that it must have."""
        self._jobs: dict[int, Future[Any]] = {}
        self._unanswered = 0
        self._state = state
        # states that the node has not taken yet, at most those of two seconds
        self._states: deque[ControllerSnapshot] = deque(maxlen=200)
        self._process = process
        self._channel = channel
        # not before: `feed` would read the closed channel of the last loop
        self._is_lost = False
        # the limits may have changed after the setup was sent
        self._channel.send('forbid', self._forbidden, self._remedy)
        self._channel.send('limits', self._setup.limits)

    # --- to the loop

    def request(self, name: str) -> Future[Any]:
        """Request a transition or a test; return a future of the reply or its error."""
        job: Future[Any] = Future()
        job.set_running_or_notify_cancel()  # now it can no longer be cancelled
        number = next(self._numbers)
        self._jobs[number] = job
        self._channel.send('request', number, name)
        if self._is_lost:
            self._fail_jobs(self.snapshot().cause or 'the control loop is closed')
        return job

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Pass a setpoint to the loop; `on_rejection` receives its rejection."""
        self._channel.send('setpoint', *setpoint)

    def feed(self) -> None:
        """
        Show that the node is alive, read the messages of the loop, and end a loop that hangs.

        The loop runs only while this method is called. The node calls it last in its cycle, so
        that an earlier exception ends the loop.
        """
        self._channel.send('feed')
        self.read()
        self._unanswered += 1
        bound = MAX_UNANSWERED_WITHOUT_BUS.get(self.snapshot().state, MAX_UNANSWERED)
        if self._unanswered > bound and not self._is_lost:
            _end(self._process)  # its drives miss the master's heartbeat and stop
            self._lose(
                f'the control loop has sent no state while it was fed '
                f'{self._unanswered} times, bound {bound}, and was ended; {STOP}'
            )

    def stop(self, cause: str) -> None:
        """Quick stop all axes at once."""
        self._channel.send('stop', cause)

    def forbid_power(self, cause: str, remedy: str = '') -> None:
        """Forbid power, also to a loop that is started later, until a call with ``''``."""
        with self._changing:
            if (cause, remedy) != (self._forbidden, self._remedy):
                self._forbidden = cause
                self._remedy = remedy
                self._channel.send('forbid', cause, remedy)

    def change(self, limits: MotionLimits) -> None:
        """Replace the limits of motion from the next cycle."""
        with self._changing:
            self._setup = replace(self._setup, limits=limits)
            self._channel.send('limits', limits)

    def apply_forces(self, forces: Sequence[float]) -> None:
        """Apply forces along the rail [N] to the carriages of simulated drives."""
        self._channel.send('forces', *forces)

    # --- from the loop

    def snapshot(self) -> ControllerSnapshot:
        """Return the newest state of controller and axes."""
        return self._state[0]

    def stream_status(self) -> StreamStatus:
        """Return the status of the setpoint stream."""
        return self._state[1]

    def take_states(self) -> list[ControllerSnapshot]:
        """Return the states received since the last call, at most 100 per second."""
        self.read()
        return [self._states.popleft() for _ in range(len(self._states))]

    def read(self) -> None:
        """Receive the messages that the loop has sent."""
        if self._is_lost or not self._reading.acquire(blocking=False):
            return  # no message arrives any longer, or another thread receives just now
        try:
            while message := self._channel.receive(0.0):
                self._unanswered = 0
                kind, content = message
                if kind == 'state':
                    self._state = content
                    self._states.append(content[0])
                elif kind == 'rejected':
                    self._on_rejection(*content)
                elif kind == 'reply':
                    number, succeeded, answer = content
                    job = self._jobs.pop(number)
                    if succeeded:
                        job.set_result(answer)
                    else:
                        job.set_exception(DriveError(answer))
        except ConnectionError:
            status = _end(self._process, 1.0)
            self._lose(
                f'the control loop has ended by itself, exit status {status}; '
                f'{POWER_OFF if status == 0 else STOP}'
            )
        finally:
            self._reading.release()

    def _lose(self, reason: str) -> None:
        if self._is_lost:
            return
        snapshot, status = self._state
        lost = ControllerSnapshot(
            ControllerState.CLOSED,
            None,
            tuple(AxisSnapshot(one.name, one.node_id) for one in snapshot.axes),
        )
        if not self._closing:
            lost = lost._replace(
                state=ControllerState.LOST,
                next_step=LOST_REMEDY,
                causes=(Cause(reason, LOST_REMEDY),),
            )
        self._is_lost, self._state = True, (lost, status)
        self._channel.close()
        self._fail_jobs(reason)

    def _fail_jobs(self, reason: str) -> None:
        if next_step := self.snapshot().next_step:
            reason = f'{reason}; next: {next_step}'
        for number in [*self._jobs]:
            if job := self._jobs.pop(number, None):
                job.set_exception(DriveError(reason))

    def close(self) -> Any:
        """
        Ramp down, power off, close the bus, end the process; wait for the end.

        Raises a DriveError with the drives whose power is not confirmed off.
        """
        with self._ending:  # a signal may come during a lifecycle shutdown
            return self._farewell.result()

    @cached_property
    def _farewell(self) -> Future[Any]:
        """Return the reply to the last request, which ends the process."""
        with self._changing:  # a loop that is being started ends without a request
            self._closing = True
        end = time.monotonic() + CLOSE_TIMEOUT + self._setup.extra_time
        job = self.request('close')
        while not job.done() and time.monotonic() < end:
            self.feed()
            time.sleep(FEED_PERIOD)
        self._channel.send('close')
        _end(self._process, max(0.0, end - time.monotonic()) if job.done() else 0.0)
        self._lose(
            'the control loop has not confirmed that the power of the drives is off'
        )
        return job


def _end(process: subprocess.Popen[bytes], timeout: float = 0.0) -> int | str:
    """Wait for the end of a process, kill it after a timeout [s]; return its exit status."""
    with suppress(subprocess.TimeoutExpired):
        return process.wait(timeout)
    process.kill()
    with suppress(subprocess.TimeoutExpired):
        process.wait(1.0)  # collect the exit status, so that no zombie stays
    return 'unknown, killed'
