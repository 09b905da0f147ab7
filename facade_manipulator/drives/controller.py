"""
Drive controller: it owns the bus, and runs the requests of an operator.

One thread uses it: it waits for frames until the step of a cycle is due, and then does the step.
A request, one of `REQUESTS`, begins at once; its reply is a message for the operator, or an error
with one.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
import logging
from math import ceil
from typing import Any

from facade_manipulator.drives import realtime
from facade_manipulator.drives.controller_settings import STATES_RATE
from facade_manipulator.drives.outcome import outcome_of
from facade_manipulator.drives.requests import REQUESTS, Session
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.drives.targets import allow_anything
from facade_manipulator.errors import BusError, DriveStateError, ManipulatorError

IDLE_PERIOD = 1.0  # s between two states without a bus
NEXT_STEPS = {
    ControllerState.UNCONFIGURED: 'configure, home, activate',
    ControllerState.INACTIVE: 'activate',
    ControllerState.HALTED: 'clear_faults',
    ControllerState.ACTIVE: '',
    ControllerState.CLOSED: '',
}
_log = logging.getLogger(__name__)


class Operation:
    """Request of the operator in progress: its generator and its reply."""

    def __init__(
        self, name: str, session: Session, on_reply: Callable[[Any], None]
    ) -> None:
        self.name = name
        self.request = REQUESTS[name]
        self.steps = self.request.run(session)
        self.on_reply = on_reply
        self.is_done = False


class DriveController(Session):
    """
    Controller of three drives on one CAN bus, which one thread uses.

    `request`, `stop` and `forbid_power` act before they return. The owner ends with the request
    `close`; without it the drives stop because the master's heartbeat is missing.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        #: takes each new snapshot; must not wait
        self.observe: Callable[[ControllerSnapshot], None] = allow_anything
        self._operation: Operation | None = None
        self._rejected: tuple[str, ...] = ()
        self._remedy = ''  # of a forbidden power
        self._every = ceil(
            self.settings.rate / STATES_RATE
        )  # cycles from state to state
        self._priority: int | None = None
        self._publish()

    def request_realtime(self) -> None:
        """Request the scheduling of the settings for this process; log what is missing."""
        self._rejected = tuple(realtime.request_realtime(self.settings))
        self._priority = realtime.realtime_priority()
        missing = self._rejected
        if not missing and not self._priority:
            missing = (realtime.NO_PRIORITY,)
        for line in missing:
            _log.info(line)
        self._publish()

    # --- inputs

    def request(self, name: str, on_reply: Callable[[Any], None]) -> None:
        """
        Begin one of `REQUESTS`.

        `on_reply` takes its result, or the error with which it failed, and must not wait.
        """
        self._accept(partial(self._begin, Operation(name, self, on_reply)))

    def stop(self, cause: str) -> None:
        """Quick stop all axes at once; they stay stopped until the faults are cleared."""
        self._accept(partial(self._stop_for, Cause(cause)))

    def forbid_power(self, cause: str, remedy: str = '') -> None:
        """
        Stop and power off all drives, which get no power until a call with ``''``.

        The drives stop even if the call with ``''`` follows at once. The remedy is the action of
        the operator before clear_faults, ``''`` for none.
        """
        self._accept(partial(self._forbid_power, cause, remedy))

    def _accept(self, act: Callable[[], None]) -> None:
        """Do an input, and answer a request that it has stopped before the next input."""

        def handle() -> None:
            act()
            if self._operation is not None and self.group.is_stopped:
                self._resume(self._operation)

        self._guard(handle)

    def snapshot(self) -> ControllerSnapshot:
        """Return the newest state of controller and axes, renewed up to 100 times a second."""
        return self._snapshot

    # --- turns

    def turn(self) -> None:
        """Wait for the step of a cycle, and do it; without a bus resume a request at once."""
        self.wait()
        self.step()

    def wait(self) -> None:
        """Handle frames until the step of the cycle is due, for 20 ms at most; never raise."""
        if self.exchange is None:
            return
        if not self._guard(self.exchange.wait):
            self.clock.sleep(self.settings.period)  # a lasting error takes no CPU

    def step(self) -> None:
        """Do the step of the cycle if it is due, and resume the request; never raise."""
        self._guard(self._step)

    def _guard(self, act: Callable[[], object]) -> bool:
        """Return whether a call succeeds; stop the drives after any error."""
        try:
            act()
        except BusError as error:
            self.lose(error)
            operation = self._operation
            if operation is not None and operation.request.needs_bus:
                self._reply(operation, error)
            self._publish()
            return False
        except Exception as error:  # the drives depend on the loop, which must continue
            self._recover(error)
            return False
        return True

    def _step(self) -> None:
        has_stepped = self.exchange is not None and self.exchange.step()
        self._cut_forbidden_power()
        if self._operation is not None:
            self._resume(self._operation)
        if self._is_due() or self._present_state() is not self._snapshot.state:
            self._publish()
        cycles = self.exchange.clock.statistics.cycles if self.exchange else 0
        if has_stepped and self.is_configured and cycles % self.settings.rate == 0:
            realtime.collect_garbage()

    def _stop_for(self, cause: Cause) -> None:
        if self.exchange is not None:  # else no drive has power
            self.exchange.stop_for(cause)

    def _forbid_power(self, cause: str, remedy: str) -> None:
        self.forbidden = cause
        self._remedy = remedy
        self._cut_forbidden_power()

    def _cut_forbidden_power(self) -> None:
        if self.forbidden and (self.group.state.has_power or self.group.is_stopped):
            self._stop_for(Cause(self.forbidden, cut_power=True, is_requested=True))

    def _begin(self, operation: Operation) -> None:
        if self.is_closed:
            operation.on_reply(DriveStateError('the drive controller is closed'))
            return
        running, request = self._operation, operation.request
        reason = ''
        is_closing = running is not None and running.name == 'close'
        may_interrupt = request.interrupts and (
            not is_closing or operation.name == 'close'
        )
        if running is not None and not may_interrupt:
            reason = f'while {running.name} is under way'
        elif request.needs_drives not in (None, self.is_configured):
            reason = (
                f'while the drives are {"" if self.is_configured else "not "}configured'
            )
        if reason:
            self._reply(
                operation, DriveStateError(f'{operation.name} is not possible {reason}')
            )
            return
        self._resume(operation)
        if running is not None and (self.is_closed or not operation.is_done):
            self._reply(running, DriveStateError(f'cancelled by {operation.name}'))
        if not operation.is_done:
            self._operation = operation

    def _resume(self, operation: Operation) -> None:
        """Resume a request, or start it; reply when it has ended."""
        try:
            next(operation.steps)
        except StopIteration as end:
            self._reply(operation, end.value)
        except Exception as error:
            self._reply(operation, error)
            if not isinstance(error, ManipulatorError):
                raise

    def _reply(self, operation: Operation, result: Any) -> None:
        """Reply to a request with its result or error, and with power and next step."""
        if self._operation is operation:
            self._operation = None
        operation.steps.close()
        if self._operation is None and not self.is_configured:
            self.close_bus(self.without_power())
        self._publish()
        if isinstance(result, Exception):
            result.args = (self._explained(str(result)),)
        elif isinstance(result, str):
            result = self._explained(result)
        operation.is_done = True
        operation.on_reply(result)

    def _explained(self, message: str) -> str:
        """Return a reply with the present power and next step."""
        outcome = outcome_of(self._snapshot)
        power = f'power: {outcome.power}' if self.is_configured else ''
        return outcome.with_next_step(message.rstrip('.'), power)

    def _recover(self, error: Exception) -> None:
        """Stop the drives for an unexpected error; the loop continues."""
        cause = Cause(
            f'the control loop failed: {type(error).__name__}: {error}', 'report this'
        )
        if self.exchange is not None:
            with suppress(BusError):
                self.exchange.stop_for(cause)
        if self.is_configured:
            self.group.stop(cause, self.now)
        # after the stop, because the traceback reads source files
        _log.error('the control loop failed', exc_info=error)

    # --- the snapshot

    def _publish(self) -> None:
        """Replace the snapshot: at 100 Hz, in each new state and when a request ends."""
        state = self._present_state()
        self._published_at = self.now
        snapshot = ControllerSnapshot(
            state,
            None,
            self._axes(),
            self.group.causes,
            self._next_step(state),
            self._rejected + self.notes,
            bus_error=self.lost,
            realtime_priority=self._priority,
        )
        if self.exchange is not None:
            clock = self.exchange.clock
            snapshot = snapshot._replace(
                stamp=clock.sync_stamp or None,
                cycle=replace(clock.statistics),
                bus=replace(self.exchange.bus.statistics),
            )
        self._snapshot = snapshot
        self.observe(snapshot)

    def _axes(self) -> tuple[AxisSnapshot, ...]:
        """Return the snapshots of the axes; behind a lost bus all values are old at once."""
        targets = self.targets.positions or (None,) * 3
        axes = []
        for monitor, target in zip(self.monitors, targets, strict=True):
            axis = monitor.snapshot(target, self.now)
            axes.append(axis._replace(is_silent=True) if self.lost else axis)
        return tuple(axes)

    def _is_due(self) -> bool:
        """Return whether a snapshot is due: at a share of the cycles, or of the time without."""
        age = self.now - self._published_at
        if self.exchange is None:
            return age >= IDLE_PERIOD
        if not self.exchange.has_started:
            return age >= 1.0 / STATES_RATE
        return self.exchange.clock.statistics.cycles % self._every == 0

    def _present_state(self) -> ControllerState:
        if self.is_closed:
            return ControllerState.CLOSED
        is_stopped = self.is_configured and self.group.is_stopped
        if self._operation is not None and not is_stopped:
            return self._operation.request.state
        if self.lost:
            return ControllerState.BUS_LOST
        return self.group.state if self.is_configured else ControllerState.UNCONFIGURED

    def _next_step(self, state: ControllerState) -> str:
        """Return the requests after which the drives follow setpoints, '' if they already do."""
        cause = self.group.severest_cause
        if cause is not None and self.group.is_stopped:
            step = cause.next_step(not self.unhomed)
            return f'{self._remedy}, {step}' if self._remedy else step
        requests = NEXT_STEPS.get(
            state, f'wait until the drives are no longer {state.value}'
        )
        is_off = state in (ControllerState.UNCONFIGURED, ControllerState.INACTIVE)
        if state is ControllerState.INACTIVE and self.unhomed:
            requests = 'home, activate'
        if self.forbidden and is_off:
            requests = f'clear_faults, {requests}'
            return f'{self._remedy}, then {requests}' if self._remedy else requests
        return requests
