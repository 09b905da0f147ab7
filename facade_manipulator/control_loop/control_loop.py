"""
The control loop's process: drives, bus and mechanism, and the messages that reach them.

Two threads do the work. The control thread of `DriveController` turns the cycle and sends one
state a cycle; nothing that the node does or fails to do can make it wait. The thread that calls
`serve` receives the node's messages and watches that the node is alive. They are two because
python-can waits for frames inside its interfaces, most of which offer nothing that could be waited
for together with the channel; and because a message, whatever is in it, is then decoded without
real-time priority (18 us of processor for a setpoint) and delays the cycle by the interpreter's
switch interval at most, unless another program displaces it just then: the interpreter's lock
lends no priority. With 100 setpoints a second and 8 to 19 programs that wanted to run the cycle
was late by 1 to 8 ms at most, and no less when this thread had a priority, too. No ROS in here:
whatever a middleware does with that lock, it does in another process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager
from dataclasses import dataclass
import logging
from typing import Any, NamedTuple, Protocol

from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.link import BusSettings, open_bus
from facade_manipulator.control_loop.channel import Channel, ChannelClosedError, Message
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.session import BusAccess, Session
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.drives.stopping import StoppingAnalysis
from facade_manipulator.drives.targets import MechanismChecks
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import SetpointFollower, StreamSettings
from facade_manipulator.motion.guard import homing_guard, measured_guard, mechanism_guard
from facade_manipulator.motion.limits import fastest_near, MotionLimits
from facade_manipulator.motion.setpoints import Setpoint

LOOK_PERIOD = 0.05  # s: how often the node's silence and a signal are looked at
MARGINS_PERIOD = 1.0  # s: sorting a thousand of them at every cycle would be a waste
_log = logging.getLogger(__name__)


class Simulator(Protocol):
    """Simulated drives that run; `facade_manipulator.simulation.drives` has them."""

    def apply_forces(self, forces: Sequence[float]) -> None:
        """Let forces along the rail [N] pull at the carriages."""

    def access(self) -> AbstractContextManager[Sequence[Any]]:
        """Give the drives to one thread."""

    def stop(self) -> None:
        """Take the drives off the bus."""


@dataclass(frozen=True)
class LoopSetup:
    """All that the loop is made of; sent once, when it starts."""

    geometry: Geometry
    controller: ControllerSettings
    axes: tuple[AxisSettings, ...]
    bus: BusSettings = BusSettings()
    stream: StreamSettings = StreamSettings()
    limits: MotionLimits = MotionLimits()
    #: starts simulated drives on the bus, where there are no others
    simulate: Callable[[BusSettings, Sequence[AxisSettings]], Simulator] | None = None

    @property
    def extra_time(self) -> float:
        """What slow brakes add to the time in which the loop ends: to stop, and to cut power."""
        return 2.0 * max(axis.stop_time for axis in self.axes)

    def stopping(self, limits: MotionLimits) -> StoppingAnalysis:
        """Return how the carriages stop from limits; raises what `StoppingAnalysis.check` does."""
        analysis = StoppingAnalysis(self.geometry, limits, self.axes, self.controller)
        analysis.check()
        return analysis


class StreamStatus(NamedTuple):
    """How the setpoints are followed; see `facade_manipulator.motion.SetpointFollower`."""

    activity: str = 'holding'
    limited_cycles: int = 0
    brakes: int = 0
    last_brake: str = ''
    #: 1st and 50th percentile of how early setpoints come [s]; empty before the first
    margins: tuple[float, ...] = ()


LoopState = tuple[ControllerSnapshot, StreamStatus]


def checked_follower(setup: LoopSetup) -> tuple[SetpointFollower, MechanismChecks]:
    """
    Return what follows setpoints, and all that is checked of the mechanism meanwhile.

    Raises a ParameterError as `StoppingAnalysis.check` does.
    """
    guard = mechanism_guard(setup.geometry)
    follower = SetpointFollower(
        setup.stream, setup.limits, setup.controller.period, guard,
        fastest_near(setup.geometry, setup.stopping(setup.limits).separation))
    return follower, MechanismChecks(
        follower, guard, homing_guard(setup.geometry),
        measured_guard(setup.geometry, max(axis.limit_margin for axis in setup.axes)))


def _assemble(setup: LoopSetup) -> tuple[SetpointFollower, DriveController]:
    """Return the follower of setpoints, and the controller that drives the carriages."""
    follower, mechanism = checked_follower(setup)
    bus = BusAccess(
        lambda: CanBus(open_bus(setup.bus)), setup.bus.bitrate, str(setup.bus))
    return follower, DriveController(Session(setup.controller, setup.axes, bus, mechanism))


class ControlLoop:
    """
    Everything that keeps the drives moving, and the node's messages to it by the channel.

    A test may hand in its clock, and the machine: follower and controller on a bus of the test.
    Raises a ParameterError as `StoppingAnalysis.check` and `Session` do.
    """

    def __init__(
        self, setup: LoopSetup, channel: Channel, clock: Clock | None = None,
        machine: tuple[SetpointFollower, DriveController] | None = None,
    ) -> None:
        self._clock = clock or Clock()
        self.follower, self.controller = machine or _assemble(setup)
        self.controller.start()
        self.simulator = setup.simulate(setup.bus, setup.axes) if setup.simulate else None
        self._setup = setup
        self._channel = channel
        self._watchdog_timeout = setup.controller.watchdog_timeout
        self._margins: tuple[float, ...] = ()
        self._margins_due = 0.0
        self._fed: float | None = None
        self._handlers: dict[str, Callable[..., None]] = {
            'feed': self._feed,
            'setpoint': self._add_setpoint,
            'request': self._start_request,
            'stop': self.controller.stop,
            'forbid': self.controller.forbid_power,
            'limits': self._change_limits,
            'stream': self._change_stream,
            'disturb': self._disturb,
            'forces': self._apply_forces,
            'close': self.end,
        }
        self._ends = False

    def end(self) -> None:
        """Let `serve` return, from any thread; `close` is to follow."""
        self._ends = True

    def serve(self) -> None:
        """Do what the node says until it closes, has ended, or is silent while there is power."""
        begin = self._clock.monotonic()
        try:
            self._channel.send('ready', *self._state(self.controller.snapshot()))
            self.controller.observe = self._send_state
            while not self._ends:
                self._handle(self._channel.receive(LOOK_PERIOD))
                self._watch_node(begin, self._clock.monotonic())
        except ChannelClosedError as error:
            self._lose_node(error, self.controller.snapshot())

    def _lose_node(self, error: ChannelClosedError, snapshot: ControllerSnapshot) -> None:
        """End, whichever thread sees first that the node is gone."""
        if not self._ends and snapshot.state.has_power:
            _log.error('%s: the carriages ramp down and the power goes off', error)
        self._ends = True

    def close(self) -> None:
        """Ramp down, power off, close bus and channel; waits for it."""
        try:
            if self.controller.snapshot().state is not ControllerState.CLOSED:
                _log.info(self.controller.close())
        except ManipulatorError as error:
            _log.error(str(error))
        if self.simulator is not None:
            self.simulator.stop()
        self._channel.close()

    # --- from the node

    def _handle(self, message: Message | None) -> None:
        if message is None:
            return
        try:
            self._handlers[message.kind](*message.content)
        except ChannelClosedError:
            raise
        except Exception:  # a message that fails must not end the loop
            _log.exception('a message of the kind %r failed', message.kind)

    def _feed(self) -> None:
        """Note that the node is alive: it feeds last in its own cycle."""
        self._fed = self._clock.monotonic()

    def _add_setpoint(self, *setpoint: Any) -> None:
        try:
            self.follower.add(Setpoint(*setpoint), self._clock.time())
        except ManipulatorError as error:
            self._channel.send('rejected', getattr(error, 'reason', 'other'), str(error))

    def _start_request(self, number: int, name: str) -> None:
        job = self.controller.request(name)
        job.add_done_callback(lambda job: self._reply(number, job))

    def _change_limits(self, limits: MotionLimits) -> None:
        self._setup.stopping(limits)
        self.follower.change_limits(limits)

    def _change_stream(self, settings: StreamSettings) -> None:
        self.follower.settings = settings

    def _disturb(self, number: int, method: str, *arguments: Any) -> None:
        """Inject a fault into a simulated drive."""
        if self.simulator is not None:
            with self.simulator.access() as drives:
                getattr(drives[number], method)(*arguments)

    def _apply_forces(self, *forces: float) -> None:
        if self.simulator is not None:
            self.simulator.apply_forces(forces)

    def _watch_node(self, begin: float, now: float) -> None:
        """End if the node is silent while there may be power; times in s."""
        if now >= self._margins_due:
            self._margins_due = now + MARGINS_PERIOD
            self._margins = _percentiles(tuple(self.follower.margins))
        silence, state = now - max(begin, self._fed or begin), self.controller.snapshot().state
        # drives that were stopped hold with power, too, until they are reset or cleaned up
        if silence > self._watchdog_timeout and (
                state.has_power or state is ControllerState.STOPPED):
            _log.error(
                'the driver node has been silent for %.2f s, bound %g s: the carriages ramp down '
                'and the power goes off', silence, self._watchdog_timeout)
            self.end()

    # --- to the node

    def _reply(self, number: int, job: Future[Any]) -> None:
        error = job.exception()
        try:
            self._channel.send(
                'reply', number, error is None, str(error) if error else job.result(),
                must_arrive=True)
        except ChannelClosedError:
            self.end()

    def _send_state(self, snapshot: ControllerSnapshot) -> None:
        """Send the state of a cycle, in the control thread."""
        try:
            self._channel.send('state', *self._state(snapshot))
        except ChannelClosedError as error:
            self._lose_node(error, snapshot)

    def _state(self, snapshot: ControllerSnapshot) -> LoopState:
        follower = self.follower
        return snapshot, StreamStatus(
            follower.activity.value, follower.limited_cycles, follower.brakes,
            follower.last_rejection, self._margins)


def _percentiles(values: tuple[float, ...]) -> tuple[float, ...]:
    """Return the 1st and the 50th percentile."""
    ordered = sorted(values)
    return tuple(ordered[int(share * len(ordered))] for share in (0.01, 0.5)) if ordered else ()
