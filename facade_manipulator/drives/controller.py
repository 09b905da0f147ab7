"""
Drive controller: owns the three axes and the bus, and executes the operator's requests.

One thread uses the controller. The thread waits for frames until the step of a cycle is due, and
then executes the step. A request, one of `REQUESTS`, begins at once. Its reply is a message for
the operator, or an error with such a message.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
import logging
from typing import Any, NamedTuple

from facade_manipulator.canopen import emcy
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import Steps
from facade_manipulator.drives import realtime
from facade_manipulator.drives.axis import Axis, make_axes
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.drive_bus import DriveBus
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.guard import Guard, Unguarded
from facade_manipulator.drives.outcome import outcome_of
from facade_manipulator.drives.publication import Publication
from facade_manipulator.drives.requests import Request, REQUESTS
from facade_manipulator.drives.snapshot import Cause, ControllerSnapshot, Remedy
from facade_manipulator.drives.targets import TargetSupervisor
from facade_manipulator.errors import BusError, DriveStateError, ManipulatorError

_log = logging.getLogger(__name__)


class ForbiddenPower(NamedTuple):
    """Reason why all drives must be without power."""

    cause: str = ''  #: ``''`` if the drives may have power
    remedy: str = ''  #: action of the operator before the requests, ``''`` for none
    is_latched: bool = True  #: whether the reason lasts until clear_faults


@dataclass
class RunningRequest:
    """Running request of the operator, with the function that receives the reply."""

    name: str
    steps: Steps[Any]
    on_reply: Callable[[Any], None]
    is_done: bool = False

    @property
    def request(self) -> Request:
        """Return the row of `REQUESTS` for this request."""
        return REQUESTS[self.name]

    def reply(self, result: Any) -> None:
        """Reply to the request with its result, or with the error that ended it."""
        self.is_done = True
        self.on_reply(result)


class DriveController:
    """
    Controller of three drives on one CAN bus, used by a single thread.

    The controller owns the axes q1, q2, q3 with their group and targets, the bus, and the request
    in progress. Axes, group and targets are replaced after each closing of the bus. `request`,
    `stop` and `forbid_power` act before they return. The owner ends the controller with `close`.
    Without this request, the drives stop because the master's heartbeat is missing. Raises a
    ParameterError if settings contradict each other or a drive profile is missing.

    Each `configure` opens a new bus with `open_bus`. `source` supplies the targets
    (`TargetSupervisor.source`), and `guard` checks them.
    """

    def __init__(
        self,
        settings: ControllerSettings,
        axes: tuple[AxisSettings, ...],
        open_bus: Callable[[], CanBus],
        source: Any,
        guard: Guard | Unguarded,
        clock: Clock | None = None,
    ) -> None:
        longest_stop = max(axis.stop_time for axis in axes)
        self.settings = replace(  # a step may be a stop
            settings, step_timeout=settings.step_timeout + longest_stop
        )
        emcy.read_faults()  # the first fault must not wait for this table
        self.clock = clock or Clock()
        self.bus = DriveBus(open_bus, self.settings, self.clock)
        self._use(make_axes(axes, self.settings), source, guard)
        self.forbidden = ForbiddenPower()
        self.is_closed = False
        self.running: RunningRequest | None = None
        #: takes each new snapshot; must not wait
        self.observe: Callable[[ControllerSnapshot], None] | None = None
        self._publication = Publication(self.settings)
        self._publish()

    def _use(
        self, axes: tuple[Axis, ...], source: Any, guard: Guard | Unguarded
    ) -> None:
        """Replace axes, source and guard; the new axes have no states or positions yet."""
        self.axes = axes
        self.group = Group(axes, self.settings)
        self.targets = TargetSupervisor(self.group, self.settings, source, guard)

    @property
    def now(self) -> float:
        """Return the time on the monotonic clock [s]."""
        return self.clock.monotonic()

    @property
    def unhomed(self) -> list[str]:
        """Return the names of the axes that must be homed."""
        return [axis.name for axis in self.axes if not axis.encoder.homed]

    def snapshot(self) -> ControllerSnapshot:
        """Return the newest state of controller and axes, renewed up to 100 times a second."""
        return self._publication.newest

    def publish_to(self, observe: Callable[[ControllerSnapshot], None]) -> None:
        """Pass each new snapshot to a function, which must return without waiting."""
        self.observe = observe

    def request_realtime(self) -> None:
        """Apply the scheduling settings to this process; log each setting that is rejected."""
        rejected = realtime.request_realtime(self.settings)
        priority = realtime.realtime_priority()
        self._publication.take_scheduling(rejected, priority)
        missing = [*rejected]
        if not missing and not priority:
            missing = [realtime.NO_PRIORITY]
        for line in missing:
            _log.info(line)
        self._publish()

    # --- inputs

    def request(self, name: str, on_reply: Callable[[Any], None]) -> None:
        """
        Start a request from `REQUESTS`.

        `on_reply` takes its result, or the error with which it failed, and must not wait.
        """
        steps = REQUESTS[name].run(self)
        self._accept(partial(self._begin, RunningRequest(name, steps, on_reply)))

    def stop(self, cause: str) -> None:
        """
        Quick-stop all axes at once; they stay stopped until clear_faults.

        The method has no effect before the cycle has started, because no drive has power then.
        """
        self._accept(partial(self._stop_for, Cause(cause)))

    def forbid_power(
        self, cause: str, remedy: str = '', is_latched: bool = True
    ) -> None:
        """
        Stop and power off all drives, and forbid power until a call with the cause ``''``.

        The drives stop even if the call with ``''`` follows at once. The remedy is the action of
        the operator before the requests, ``''`` for none. Drives that have stopped always need
        clear_faults. Other drives need clear_faults if the cause is latched.
        """
        forbidden = ForbiddenPower(cause, remedy, is_latched)
        self._accept(partial(self._forbid_power, forbidden))

    def _accept(self, act: Callable[[], None]) -> None:
        """Process an input; if it stops the drives, the running request fails at once."""

        def handle() -> None:
            act()
            if self.running is not None and self.group.is_stopped:
                self._resume(self.running)

        self._attempt(handle)

    # --- turns

    def turn(self) -> None:
        """Wait until a cycle step is due, execute it, and resume the request."""
        self.wait()
        self.step()

    def wait(self) -> None:
        """
        Handle frames until the cycle step is due, for at most 20 ms; never raise.

        The method returns at once without a bus, and after each frame before the start of the
        cycle.
        """
        exchange = self.bus.exchange
        if exchange is None:
            return
        if not self._attempt(exchange.wait):
            self.clock.sleep(self.settings.period)  # a lasting error uses no CPU

    def step(self) -> None:
        """Execute the cycle step if it is due, and resume the request; never raise."""
        self._attempt(self._step)

    def _attempt(self, act: Callable[[], object]) -> bool:
        """Execute a call; stop the drives after an error. Return whether the call succeeded."""
        try:
            act()
        except BusError as error:
            self.lose(error)
            running = self.running
            if running is not None and running.request.needs_bus:
                self._reply(running, error)
            self._publish()
            return False
        except Exception as error:  # the drives depend on the loop, which must continue
            self._recover(error)
            return False
        return True

    def _step(self) -> None:
        """Execute the cycle step, resume the request, and publish a snapshot if due."""
        exchange = self.bus.exchange
        has_stepped = exchange is not None and exchange.step()
        self._cut_forbidden_power()
        if self.running is not None:
            self._resume(self.running)
        if self._publication.is_due(self):
            self._publish()
        if has_stepped and self.bus.is_configured:
            self._collect_garbage()

    def _collect_garbage(self) -> None:
        """Collect garbage once a second, after the cycle has sent its commands."""
        exchange = self.bus.exchange
        cycles = 0 if exchange is None else exchange.clock.statistics.cycles
        if cycles % self.settings.rate == 0:
            realtime.collect_garbage()

    def _publish(self) -> None:
        snapshot = self._publication.renew(self)
        if self.observe is not None:
            self.observe(snapshot)

    # --- the running request

    def _begin(self, new: RunningRequest) -> None:
        """Start or reject a request; a started request cancels the running request."""
        if self.is_closed:
            new.reply(DriveStateError('the drive controller is closed'))
            return
        reason = self._obstacle(new)
        if reason:
            error = DriveStateError(f'{new.name} is not possible {reason}')
            self._reply(new, error)
            return
        running = self.running
        self._resume(new)
        if running is not None and (self.is_closed or not new.is_done):
            self._reply(running, DriveStateError(f'cancelled by {new.name}'))
        if not new.is_done:
            self.running = new

    def _obstacle(self, new: RunningRequest) -> str:
        """Return the reason why a request is impossible now, ``''`` if it is possible."""
        running = self.running
        if running is not None:
            may_interrupt = new.request.interrupts
            if running.name == 'close' and new.name != 'close':
                may_interrupt = False
            if not may_interrupt:
                return f'while {running.name} is under way'
        is_configured = self.bus.is_configured
        if new.request.needs_configured not in (None, is_configured):
            negation = '' if is_configured else 'not '
            return f'while the drives are {negation}configured'
        return ''

    def _resume(self, running: RunningRequest) -> None:
        """Start or resume a request; reply when it has ended."""
        try:
            next(running.steps)
        except StopIteration as end:
            self._reply(running, end.value)
        except Exception as error:
            self._reply(running, error)
            if not isinstance(error, ManipulatorError):
                raise

    def _reply(self, ended: RunningRequest, result: Any) -> None:
        """Reply to a request with its result or error, the power state and the next step."""
        if self.running is ended:
            self.running = None
        ended.steps.close()
        if self.running is None and not self.bus.is_configured:
            self.close_bus(self.without_power())
        self._publish()
        if isinstance(result, Exception):
            result.args = (self._explained(str(result)),)
        elif isinstance(result, str):
            result = self._explained(result)
        ended.reply(result)

    def _explained(self, message: str) -> str:
        """Return a reply with the present power state and next step added."""
        if self.is_closed:  # the process ends, which an operator may have requested
            return message.rstrip('.')
        outcome = outcome_of(self.snapshot())
        power = f'power: {outcome.power}' if self.bus.is_configured else ''
        return outcome.with_next_step(message.rstrip('.'), power)

    # --- power

    def _stop_for(self, cause: Cause) -> None:
        """Stop the drives for a cause if a bus is open."""
        if self.bus.exchange is not None:  # before its cycle starts, no drive has power
            self.bus.exchange.stop_for(cause)

    def _forbid_power(self, forbidden: ForbiddenPower) -> None:
        self.forbidden = forbidden
        self._cut_forbidden_power()
        self._publish()  # without a bus, the next snapshot may be due in a second

    def _cut_forbidden_power(self) -> None:
        cause = self.forbidden.cause
        if cause and (self.group.state.has_power or self.group.is_stopped):
            self._stop_for(Cause(cause, cut_power=True, is_requested=True))

    def require_power_allowed(self, request: str) -> None:
        """
        Raise a DriveStateError if power is forbidden.

        The error is also raised if a drive would continue to move after this master falls silent.
        """
        reason = self.forbidden.cause
        unstopped = []
        for axis in self.axes:
            if not axis.sdo.stops_without_master:
                unstopped.append(axis.title)
        if unstopped:
            reason = (
                f'{" and ".join(unstopped)} would continue to move if this computer were silent '
                '(no 1016h, or no reaction such as 6007h): correct the profile'
            )
        if reason:
            raise DriveStateError(f'{request} is not possible: {reason}')

    def without_power(self) -> list[Axis]:
        """Return the used axes whose drives confirm power off, or have just booted."""
        exchange = self.bus.exchange
        if exchange is None or not exchange.transmitter.sends_heartbeats:
            return []
        if not exchange.has_started:  # nothing has switched them on since their reset
            return [axis for axis in self.axes if axis.node.boot_ups]
        return [axis for axis in self.axes if axis.has_confirmed_off(self.now)]

    # --- the end of the bus

    def close_bus(self, without_power: Collection[Axis]) -> None:
        """
        Close the bus, and discard the state of all drives.

        Axes without power no longer monitor this master, so that no drive reports its loss.
        """
        self.bus.close(self.axes, without_power)
        renewed = [
            Axis(axis.name, axis.settings, axis.profile, self.settings)
            for axis in self.axes
        ]
        self._use(tuple(renewed), self.targets.source, self.targets.guard)

    def lose(self, error: BusError) -> None:
        """Stop sending, so that the drives stop by themselves; discard their positions."""
        self.bus.lose(error.problem)
        for axis in self.axes:  # a drive may restart, and its carriage move, unnoticed
            axis.encoder.distrust()
        if self.bus.is_configured:
            remedy = error.remedy or Remedy.BUS
            cause = Cause(self.bus.lost, remedy, configure_again=True)
            self.group.stop(cause, self.now)

    def refuse_requests(self) -> None:
        """Reject all requests after `close`."""
        self.is_closed = True

    def _recover(self, error: Exception) -> None:
        """Stop the drives after an unexpected error; the loop continues."""
        cause = Cause(
            f'the control loop failed: {type(error).__name__}: {error}', 'report this'
        )
        if self.bus.exchange is not None:
            with suppress(BusError):
                self.bus.exchange.stop_for(cause)
        if self.bus.is_configured:
            self.group.stop(cause, self.now)
        # after the stop, because the traceback reads source files
        _log.error('the control loop failed', exc_info=error)
