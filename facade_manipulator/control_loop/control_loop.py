"""
Process of the control loop: drives, bus, mechanism, and the messages from the node.

One thread does the work, turn by turn:

1. It handles the frames of the drives until the step of the cycle is due, for 20 ms at most. While
   no bus is open, it waits for the node instead.
2. It reads all commands of the node, then the newest messages of the stream. A setpoint is
   therefore used by the next step after its arrival. A stop acts when it is read.
3. It executes the step if the step is due: supervise the drives, choose and send their targets.
4. It sends states and replies, without waiting.

The kernel ends a process that hangs in a turn (`HangAlarm`). A second thread writes the log. This
process imports no ROS: a middleware may hold the interpreter's lock, but only in its own process.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable
from dataclasses import replace
import logging
from logging.handlers import QueueHandler, QueueListener
import math
from pkgutil import resolve_name
from queue import SimpleQueue
import signal
import socket
from typing import Any

from facade_manipulator.canopen.bus import CanBus, open_bus
from facade_manipulator.canopen.clock import Clock, SteadyTime
from facade_manipulator.control_loop.loop_channel import Channel, LoopSetup
from facade_manipulator.drives.bus_load import check_bus_load
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.guard import Guard
from facade_manipulator.drives.realtime import take_over_collector
from facade_manipulator.drives.snapshot import ControllerSnapshot, ControllerState
from facade_manipulator.errors import compared, ManipulatorError
from facade_manipulator.motion.follower import SetpointFollower
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.timeouts import CLOSE_REQUEST_TIMEOUT, END_TIMEOUT

HANG_TIMEOUT = 5.0  # s of one turn, after which the kernel ends the process
_log = logging.getLogger(__name__)


def guarded_follower(setup: LoopSetup) -> tuple[SetpointFollower, Guard]:
    """Return the follower of setpoints and the guard of the mechanism."""
    guard = Guard(
        setup.geometry,
        setup.stopping.separation,
        max(axis.limit_margin for axis in setup.axes),
    )
    follower = SetpointFollower(
        setup.stream,
        setup.limits,
        setup.controller.period,
        guard.check_targets,
        guard.allowed_speed,
    )
    return follower, guard


class HangAlarm:
    """Kernel alarm that ends this process if the process does not renew the alarm in time."""

    RENEWAL_PERIOD = 1.0  # s

    def __init__(self) -> None:
        self._renewal = -math.inf  # time at which it is due [s, monotonic]

    def renew(self, now: float) -> None:
        """Postpone the alarm at a time [s, monotonic], at most once a second."""
        if now >= self._renewal:
            self._renewal = now + self.RENEWAL_PERIOD
            self.set(HANG_TIMEOUT)

    def set(self, timeout: float) -> None:
        """Set the alarm to end the process after a timeout [s]; 0 switches the alarm off."""
        signal.setitimer(signal.ITIMER_REAL, timeout)


class ControlLoop:
    """
    Owner of the drive controller, which exchanges messages with the node.

    A test may pass its own clock and its own machine, that is, follower and controller on a bus of
    the test. `alarm` ends the process of the loop if the process hangs. Raises the ParameterErrors
    of `DriveController` and `check_bus_load`.
    """

    IDLE_WAIT = 0.05  # s without a bus; maximum delay of a signal
    MOST_STREAM_MESSAGES = 8  # messages of the stream that a turn handles
    READING_SHARE = 0.1  # of the period: a flood of the stream delays the step by less
    NOT_CLOSED = (
        'the control loop does not end, so that the power of the drives is unknown; next: switch '
        'the supply of the drives off'
    )

    def __init__(
        self,
        setup: LoopSetup,
        channel: Channel,
        clock: Clock | None = None,
        machine: tuple[SetpointFollower, DriveController] | None = None,
        alarm: HangAlarm | None = None,
    ) -> None:
        self._clock = clock or Clock()
        self._steady_time = SteadyTime(self._clock)
        self._setup = setup
        self._channel = channel
        self._alarm = alarm
        if machine is None:
            follower, guard = guarded_follower(setup)
            controller = DriveController(
                setup.controller, setup.axes, self._open_bus, follower, guard
            )
            profiles = [axis.profile for axis in controller.axes]
            check_bus_load(setup.controller, setup.bus.bitrate, profiles)
            machine = (follower, controller)
        self.follower, self.controller = machine
        self.simulator: Any = setup.simulate and resolve_name(setup.simulate)(
            setup.bus, setup.axes
        )
        self._ends = False
        self._handlers: dict[str, Callable[..., None]] = {
            'feed': self._feed,
            'setpoint': self._add_setpoint,
            'request': self._start_request,
            'stop': self.controller.stop,
            'forbid': self.controller.forbid_power,
            'limits': self._change_limits,
            'close': self.end,
            'forces': self._apply_forces,
        }

    def _open_bus(self) -> CanBus:
        """
        Open the bus without the alarm, because some interfaces need 10 s.

        No drive has power yet.
        """
        if self._alarm is not None:
            self._alarm.set(0.0)
        try:
            return CanBus(open_bus(self._setup.bus))
        finally:
            if self._alarm is not None:
                self._alarm.set(HANG_TIMEOUT)

    def run(self) -> None:
        """Serve the node until it closes or ends, or is silent while the drives may have power."""
        self._feed()
        self._channel.send('started', self.controller.snapshot(), self.follower.status)
        self.controller.publish_to(self._send_state)
        try:
            while not self._ends:
                self._turn()
        except ConnectionError as loss:
            if self._may_have_power:
                _log.error('the carriages ramp down and the drives power off: %s', loss)

    def end(self) -> None:
        """End `run` after the present turn; the caller then calls `close`."""
        self._ends = True

    def _turn(self) -> None:
        """Wait for frames or messages and handle them; execute the cycle step if it is due."""
        if self._alarm is not None:
            self._alarm.renew(self._clock.monotonic())
        if self.controller.bus.exchange is None:
            self._channel.wait(self.IDLE_WAIT)
        else:
            self.controller.wait()
        self._read()
        self._require_node()
        self.controller.step()

    def _read(self) -> None:
        """Handle all commands of the node, then the newest stream messages."""
        for message in self._channel.commands():
            self._handle(*message)
        end = (
            self._clock.monotonic() + self.READING_SHARE * self._setup.controller.period
        )
        for message in self._channel.stream(
            self.MOST_STREAM_MESSAGES, lambda: self._clock.monotonic() < end
        ):
            self._handle(*message)

    def _handle(self, kind: str, content: tuple[Any, ...]) -> None:
        try:
            self._handlers[kind](*content)
        except Exception:  # a message that fails must not end the loop
            _log.exception('message %r rejected; next: report this', kind)

    def _require_node(self) -> None:
        """Raise a ConnectionError if the node is silent while the drives may have power."""
        silence = self._clock.monotonic() - self._fed
        bound = self._setup.controller.watchdog_timeout
        if silence > bound and self._may_have_power:
            silence_text, limit = compared(silence, bound, '.2f')
            raise ConnectionError(
                f'the driver node has been silent for {silence_text} s, above the limit '
                f'{limit} s; next: end other programs on this computer'
            )

    def close(self) -> bool:
        """Ramp down, power off, close bus and channel; return whether power off is confirmed."""
        is_off = True
        if not self.controller.is_closed:
            is_off = self._close_controller()
        if self.simulator:
            self.simulator.stop()
        self._channel.close()
        return is_off

    def _close_controller(self) -> bool:
        """
        Run the request close until it replies; return whether it succeeded.

        Without a reply in time, or with an error, the drives may have power.
        """
        replies: list[Any] = []
        end = self._clock.monotonic() + CLOSE_REQUEST_TIMEOUT + self._setup.extra_time
        self.controller.request('close', replies.append)
        while not replies and self._clock.monotonic() < end:
            self.controller.turn()
        if not replies:
            _log.error(self.NOT_CLOSED)
            return False
        if isinstance(replies[0], ManipulatorError):
            _log.error(str(replies[0]))
            return False
        _log.info(replies[0])
        return True

    # --- from the node

    def _feed(self) -> None:
        """Record the time [s, monotonic] of a feed, which proves that the node is alive."""
        self._fed = self._clock.monotonic()

    def _add_setpoint(self, stamp: float, *motion: Any) -> None:
        """Add a setpoint; convert its stamp [s] from the system clock to the monotonic clock."""
        time = self._steady_time.from_stamp(stamp)
        try:
            self.follower.add(Setpoint(time, *motion), self._clock.monotonic())
        except ManipulatorError as error:
            self._channel.send(
                'rejected', getattr(error, 'reason', 'other'), str(error)
            )

    def _apply_forces(self, *forces: float) -> None:
        """Apply forces along the rail [N] to the carriages of simulated drives."""
        self.simulator.apply_forces(forces)

    def _start_request(self, number: int, name: str) -> None:
        """Start a request by name; its reply is sent with the number of the request."""

        def send_reply(reply: Any) -> None:
            failed = isinstance(reply, Exception)
            answer = str(reply) if failed else reply
            self._channel.send('reply', number, not failed, answer)

        self.controller.request(name, send_reply)

    def _change_limits(self, limits: MotionLimits) -> None:
        """
        Apply limits, and check only their ranges.

        The node has already run the stopping analysis, which takes 5 ms.
        """
        self.follower.change_limits(replace(limits))

    @property
    def _may_have_power(self) -> bool:
        """Return whether drives may have power; stopped drives keep power until a reset."""
        state = self.controller.snapshot().state
        return state.has_power or state is ControllerState.STOPPED

    # --- to the node

    def _send_state(self, snapshot: ControllerSnapshot) -> None:
        """Send a new snapshot to the node."""
        self._channel.send('state', snapshot, self.follower.status)


SETUP_TIMEOUT = 10.0  # s, maximum time until the node has sent the setup


def main(commands: int, stream: int) -> int:
    """
    Receive the setup, and run the loop until the node ends it; return the exit status.

    The arguments are the file descriptors of the channel's sockets.
    """
    # signals of a terminal are for the node, which requests an orderly end; SIGTERM requests an
    # end directly
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    take_over_collector()
    _start_logging()
    channel = Channel(socket.socket(fileno=commands), socket.socket(fileno=stream))
    alarm = HangAlarm()
    try:
        channel.wait(SETUP_TIMEOUT)
        message = next(channel.commands(), None)
        if message is None:
            return 1
        (setup,) = message[1]
        logging.getLogger('facade_manipulator').setLevel(setup.log_level)
        loop = ControlLoop(setup, channel, alarm=alarm)
    except (ManipulatorError, ConnectionError) as error:
        channel.send('failed', str(error))
        return 1
    signal.signal(signal.SIGTERM, lambda *_: loop.end())
    loop.controller.request_realtime()
    try:
        loop.run()
    finally:
        alarm.set(END_TIMEOUT + setup.extra_time)
        is_off = loop.close()
    return 0 if is_off else 1


def _start_logging() -> None:
    """
    Configure logging in the format of ROS.

    A separate thread writes, because a terminal may block the output.
    """
    logging.addLevelName(logging.WARNING, 'WARN')
    logging.addLevelName(logging.CRITICAL, 'FATAL')
    output = logging.StreamHandler()
    output.setFormatter(
        logging.Formatter('[%(levelname)s] [%(created).9f] [control loop]: %(message)s')
    )
    listener = QueueListener(SimpleQueue[Any](), output)
    logging.getLogger().addHandler(QueueHandler(listener.queue))
    logging.getLogger('facade_manipulator').setLevel(logging.INFO)
    # the controller reports errors of this library in its own messages
    logging.getLogger('canopen').setLevel(logging.CRITICAL)
    listener.start()
    atexit.register(listener.stop)
