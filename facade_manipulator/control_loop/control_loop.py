"""
Process of the control loop: drives, bus and mechanism, and the messages that they receive.

Two threads do the work. The control thread of `DriveController` runs the cycle and sends its
states; the node cannot make it wait. The thread that calls `serve` receives the node's messages
and supervises the node. There are two for two reasons:

- python-can waits for frames inside its interfaces. Most of them offer nothing that could be
  waited for together with the channel.
- Any message is then decoded without real-time priority (18 us of processor for a setpoint). It
  delays the cycle by the interpreter's switch interval at most, unless another program displaces
  it just then: the interpreter's lock lends no priority. With 100 setpoints a second and 8 to 19
  programs that wanted to run, the cycle was late by 1 to 8 ms at most, and no less when this
  thread had a priority as well.

This process imports no ROS: a middleware may hold the interpreter's lock, but only in its own
process.
"""

from __future__ import annotations

import atexit
from collections.abc import Callable
from concurrent.futures import Future
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
from facade_manipulator.control_loop.channel import Channel, LoopSetup
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.realtime import take_over_collector
from facade_manipulator.drives.snapshot import ControllerSnapshot, ControllerState
from facade_manipulator.drives.targets import MechanismChecks
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.motion.braking import fastest_near
from facade_manipulator.motion.follower import SetpointFollower
from facade_manipulator.motion.guard import homing_guard, measured_guard, path_guard
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint

CLOSE_TIMEOUT = (
    6.5  # s: more than the loop takes to ramp down, power off and close the bus
)
END_TIMEOUT = 7  # s, after which the kernel ends the process
_log = logging.getLogger(__name__)


def checked_follower(setup: LoopSetup) -> tuple[SetpointFollower, MechanismChecks]:
    """
    Return the follower of setpoints, and the checks of the mechanism.

    Raises the ParameterErrors of `StoppingAnalysis.check`.
    """
    guard = path_guard(setup.geometry)
    follower = SetpointFollower(
        setup.stream,
        setup.limits,
        setup.controller.period,
        guard,
        fastest_near(setup.geometry, setup.stopping(setup.limits).separation),
    )
    return follower, MechanismChecks(
        follower,
        guard,
        homing_guard(setup.geometry),
        measured_guard(setup.geometry, max(axis.limit_margin for axis in setup.axes)),
    )


class ControlLoop:
    """
    Controller of the drives, and the messages between controller and node.

    A test may pass its clock and its machine: follower and controller on a bus of the test.
    Raises the ParameterErrors of `StoppingAnalysis.check` and `DriveController`.
    """

    def __init__(
        self,
        setup: LoopSetup,
        channel: Channel,
        clock: Clock | None = None,
        machine: tuple[SetpointFollower, DriveController] | None = None,
    ) -> None:
        self._clock = clock or Clock()
        self._steady_time = SteadyTime(self._clock)
        if machine is None:
            follower, mechanism = checked_follower(setup)
            machine = (
                follower,
                DriveController(
                    setup.controller,
                    setup.axes,
                    lambda: CanBus(open_bus(setup.bus)),
                    mechanism,
                ),
            )
        self.follower, self.controller = machine
        self.controller.start()
        self.simulator: Any = setup.simulate and resolve_name(setup.simulate)(
            setup.bus, setup.axes
        )
        self._setup = setup
        self._channel = channel
        self._ends = False
        self._handlers: dict[str, Callable[..., None]] = {
            'feed': self._feed,
            'setpoint': self._add_setpoint,
            'request': self._start_request,
            'stop': self.controller.stop,
            'forbid': self.controller.forbid_power,
            'limits': self._change_limits,
            'close': self.end,
            'forces': lambda *forces: self.simulator.apply_forces(
                forces
            ),  # of simulated drives
        }

    def end(self) -> None:
        """End `serve`, from any thread; call `close` afterwards."""
        self._ends = True

    def serve(self) -> None:
        """Serve the node until it closes, ends, or is silent while the drives may have power."""
        self._feed()
        self._send_state(self.controller.snapshot())  # the node waits for it
        self.controller.observe = self._send_state
        bound = self._setup.controller.watchdog_timeout
        try:
            while not self._ends:
                if message := self._channel.receive(
                    0.05
                ):  # s, maximum delay of a signal
                    kind, content = message
                    try:
                        self._handlers[kind](*content)
                    except Exception:  # a message that fails must not end the loop
                        _log.exception('message %r rejected; next: report this', kind)
                silence = self._clock.monotonic() - self._fed
                if silence > bound and self._may_have_power:
                    raise ConnectionError(
                        f'the driver node has been silent for {silence:.2f} s, '
                        f'above the limit {bound:g} s'
                    )
        except ConnectionError as loss:
            if self._may_have_power:
                _log.error('%s: the carriages ramp down and the power goes off', loss)

    def close(self) -> bool:
        """Ramp down, power off, close bus and channel; return whether power off is confirmed."""
        is_off = False
        try:
            if self.controller.snapshot().state is not ControllerState.CLOSED:
                _log.info(self.controller.close(CLOSE_TIMEOUT + self._setup.extra_time))
            is_off = True
        except ManipulatorError as error:
            _log.error(str(error))
        if self.simulator:
            self.simulator.stop()
        self._channel.close()
        return is_off

    # --- from the node

    def _feed(self) -> None:
        """Record the time [s, monotonic] of a feed, which shows that the node is alive."""
        self._fed = self._clock.monotonic()

    def _add_setpoint(self, stamp: float, *motion: Any) -> None:
        """Add a setpoint by its stamp on the system clock [s], which may have been set."""
        time = self._steady_time.from_stamp(stamp)
        try:
            self.follower.add(Setpoint(time, *motion), self._clock.monotonic())
        except ManipulatorError as error:
            self._channel.send(
                'rejected', getattr(error, 'reason', 'other'), str(error)
            )

    def _start_request(self, number: int, name: str) -> None:
        def reply(job: Future[Any]) -> None:
            error = job.exception()
            self._channel.send(
                'reply', number, error is None, str(error) if error else job.result()
            )

        self.controller.request(name).add_done_callback(reply)

    def _change_limits(self, limits: MotionLimits) -> None:
        self._setup.stopping(limits)
        self.follower.change_limits(limits)

    @property
    def _may_have_power(self) -> bool:
        """Return whether drives may have power, which stopped drives keep until a reset."""
        state = self.controller.snapshot().state
        return state.has_power or state is ControllerState.STOPPED

    # --- to the node

    def _send_state(self, snapshot: ControllerSnapshot) -> None:
        """Send a new state, in the control thread."""
        self._channel.send('state', snapshot, self.follower.status)


def main(descriptor: int) -> int:
    """Receive the setup, run the loop until the node ends it; return the exit status."""
    # a terminal's signals concern the node, which asks for an orderly end; SIGTERM asks by itself
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    take_over_collector()
    _start_logging()
    channel = Channel(socket.socket(fileno=descriptor))
    try:
        message = channel.receive(10.0)  # s, that the node has for sending the setup
        if message is None:
            return 1
        (setup,) = message[1]
        logging.getLogger('facade_manipulator').setLevel(setup.log_level)
        loop = ControlLoop(setup, channel)
    except (ManipulatorError, ConnectionError) as error:
        channel.send('failed', str(error))
        return 1
    signal.signal(signal.SIGTERM, lambda *_: loop.end())
    try:
        loop.serve()
    finally:
        # if anything hangs after this, the kernel ends the process
        signal.alarm(END_TIMEOUT + math.ceil(setup.extra_time))
        is_off = loop.close()
    return 0 if is_off else 1


def _start_logging() -> None:
    """
    Write the log in the format of ROS.

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
    logging.getLogger('canopen').setLevel(
        logging.CRITICAL
    )  # its errors are messages of ours
    listener.start()
    atexit.register(listener.stop)
