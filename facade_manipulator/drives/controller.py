"""
The drive controller: one control thread that owns the bus and runs the requests of an operator.

A request, one of `REQUESTS`, returns a future at once. Its result is a message for the operator,
and so is its exception. The control thread receives, supervises, steps the group and commands once
per SYNC. SDO transfers run in worker threads.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import suppress
from dataclasses import replace
import logging
from math import ceil
import threading
from typing import Any

from facade_manipulator.drives import realtime
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.requests import CLOSING_TIMEOUT, REQUESTS, Steps
from facade_manipulator.drives.session import Session
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.drives.targets import allow_anything
from facade_manipulator.errors import BusError, DriveError, DriveStateError, ManipulatorError

IDLE_WAIT = 1.0  # s: a request wakes it
STATES_RATE = 100.0  # Hz, at most: joint_states and the compensator need no more
AT_DRIVE = 'put that right at the drive, then '  # another configure would fail in the same way
FORBIDDEN_REMEDY = 'let software_stop be false'
NEXT_STEPS = {
    ControllerState.UNCONFIGURED: 'configure, home, activate',
    ControllerState.INACTIVE: 'activate',
    ControllerState.HALTED: 'clear_faults',
    **dict.fromkeys(
        (ControllerState.CONFIGURING, ControllerState.HOMING, ControllerState.ACTIVATING,
         ControllerState.HALTING, ControllerState.DEACTIVATING, ControllerState.CLEARING,
         ControllerState.TESTING, ControllerState.CLEANING_UP), 'wait until that is done'),
}
POWERLESS = (ControllerState.UNCONFIGURED, ControllerState.INACTIVE)
_NO_TARGETS = (None, None, None)
_log = logging.getLogger(__name__)


class Operation:
    """A request of the operator: its generator, once it has begun, and its reply."""

    def __init__(self, name: str) -> None:
        self.name, self.request = name, REQUESTS[name]
        self.steps: Steps | None = None
        self.future: Future[Any] = Future()
        self.future.set_running_or_notify_cancel()  # its owner can no longer cancel it


class DriveController:
    """
    Three drives on one CAN bus. After `start` only the control thread uses the session.

    Done callbacks of the futures run in the control thread and must be short. `close` must be
    called at the end; without it the drives stop because the master's heartbeat is missing.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._clock = session.clock
        #: takes each new snapshot, in the control thread; must not wait
        self.observe: Callable[[ControllerSnapshot], None] = allow_anything
        self._operation: Operation | None = None
        self._requests: deque[Operation] = deque()
        self._wake = threading.Event()
        self._rejected: tuple[str, ...] = ()
        self._every = ceil(session.settings.rate / STATES_RATE)  # cycles from state to state
        self._priority: int | None = None
        self._publish(self._clock.monotonic())
        self._thread = threading.Thread(target=self._run, name='drive control', daemon=True)

    def start(self) -> None:
        """Start the control thread; a test without one calls `turn` instead."""
        self._thread.start()

    # --- from any thread

    def request(self, name: str) -> Future[Any]:
        """Request one of `REQUESTS`; return its reply as a future, at once."""
        operation = Operation(name)
        self._requests.append(operation)
        self._wake.set()
        if self._session.is_closed:
            self._reject_rest()
        return operation.future

    def stop(self, cause: str) -> None:
        """Quick stop all axes at once; they stay stopped until the faults are cleared."""
        exchange, group = self._session.exchange, self._session.group
        if group is not None and exchange is not None:  # else no drive has power
            exchange.stops.append(Cause(cause))

    def forbid_power(self, cause: str) -> None:
        """Stop and power off all drives; they get no power until this is called with ``''``."""
        self._session.forbidden = cause
        exchange = self._session.exchange
        if cause and self._session.is_powered and exchange is not None:
            exchange.stops.append(Cause(cause, cut_power=True))

    def snapshot(self) -> ControllerSnapshot:
        """Return the newest state of controller and axes, at most 10 ms old while cycles run."""
        return self._snapshot

    def close(self, timeout: float = 2.0 * CLOSING_TIMEOUT) -> str:
        """
        Power the drives off in order, or stop them, then fall silent; waits for it.

        Raises a DriveError with the drives whose power is not confirmed off.
        """
        try:
            return self.request('close').result(timeout)
        except FutureTimeoutError:
            raise DriveError('the control loop does not end; the power of the drives is '
                             'unknown') from None
        finally:
            self._thread.join(timeout)

    # --- the control thread

    def _run(self) -> None:
        self._rejected = tuple(realtime.request_realtime(self._session.settings))
        self._priority = realtime.realtime_priority()
        for line in self._rejected or [realtime.describe_scheduling(self._priority)]:
            _log.info(line)
        while not self._session.is_closed:
            self.turn()
        self._reject_rest()

    def turn(self) -> None:
        """Run one cycle, or begin requests while the bus is closed; never raises."""
        try:
            self._turn()
        except BusError as error:
            self._lose_bus(error)
        except Exception as error:  # the control thread must live: the drives depend on it
            self._recover(error)

    def _turn(self) -> None:
        if self._requests:
            self._begin_requests()
        if self._session.is_closed:
            return
        session = self._session
        if session.exchange is None:
            now = self._idle()
        else:
            now = session.exchange.turn()
        may_have_power = session.is_powered or session.is_stopped
        if session.forbidden and may_have_power and session.exchange is not None:
            session.exchange.stop_for(Cause(session.forbidden, cut_power=True))
        session.watch_stop()
        if self._operation is not None and self._operation.steps is not None:
            self._resume(self._operation, self._operation.steps, now)
        cycles = session.exchange.clock.cycles if session.exchange is not None else 0
        if cycles % self._every == 0 or self._present_state() is not self._snapshot.state:
            self._publish(now)
        if session.group is not None and now >= session.collector.due:
            session.collector.collect(now)

    def _idle(self) -> float:
        if not self._requests:
            self._clock.wait(self._wake, IDLE_WAIT)
        self._wake.clear()
        return self._clock.monotonic()

    def _begin_requests(self) -> None:
        while self._requests and not self._session.is_closed:
            operation, running = self._requests.popleft(), self._operation
            if running is not None and not operation.request.interrupts:
                self._reply(operation, DriveStateError(
                    f'{operation.name} is not possible while {running.name} is under way'))
                continue
            operation.steps = operation.request.run(self._session, self._clock.monotonic())
            self._resume(operation, operation.steps, None)
            had_nothing_to_do = operation.future.done() and not self._session.is_closed
            if running is not None and not had_nothing_to_do:
                self._reply(running, DriveStateError(f'cancelled by {operation.name}'))
            if not operation.future.done():
                self._operation = operation

    def _resume(self, operation: Operation, steps: Steps, now: float | None) -> None:
        """Resume a request at a time [s], or begin it; reply once it has ended."""
        try:
            steps.send(now)  # type: ignore[arg-type]  # None begins a generator
        except StopIteration as end:
            self._reply(operation, end.value)
        except ManipulatorError as error:
            self._reply(operation, error)
        except Exception as error:
            self._reply(operation, error)
            raise

    def _reply(self, operation: Operation, result: Any) -> None:
        """Reply to a request with its result or error, power and next step as they are then."""
        if self._operation is operation:
            self._operation = None
        if operation.steps is not None:
            operation.steps.close()
        self._publish(self._clock.monotonic())
        if isinstance(result, Exception):
            if isinstance(result, (BusError, DriveError)):
                is_at_drive = not isinstance(result, (BusError, DriveStateError))
                result.args = (self._explained(str(result), is_at_drive),)
            operation.future.set_exception(result)
        else:
            operation.future.set_result(
                self._explained(result) if isinstance(result, str) else result)

    def _explained(self, message: str, is_at_drive: bool = False) -> str:
        """Return a reply with the present power and next step."""
        state, parts = self._snapshot.state, [message.rstrip('.')]
        if self._session.group is not None:
            parts.append(f'power: {self._snapshot.power}')
        if step := self._snapshot.next_step:
            repair = AT_DRIVE if is_at_drive and state is ControllerState.UNCONFIGURED else ''
            parts.append(f'next: {repair}{step}')
        return '; '.join(parts)

    def _reject_rest(self) -> None:
        while self._requests:
            self._requests.popleft().future.set_exception(
                DriveStateError('the drive controller is closed'))

    def _lose_bus(self, error: BusError) -> None:
        now = self._clock.monotonic()
        self._session.lose(error, now)
        if self._operation is not None and self._operation.name != 'close':
            self._reply(self._operation, error)
        self._publish(now)

    def _recover(self, error: Exception) -> None:
        """Stop the drives for an unexpected error; the loop continues."""
        _log.exception('the control loop failed')
        session = self._session
        cause = Cause(f'the control loop failed: {type(error).__name__}: {error}', 'report this')
        if session.exchange is not None:
            with suppress(BusError):
                session.exchange.stop_for(cause)
        if session.group is not None:
            session.group.stop(cause, self._clock.monotonic())
        self._wake.clear()
        self._clock.wait(self._wake, session.settings.period)  # an error that stays takes no CPU

    # --- the snapshot

    def _publish(self, now: float) -> None:
        """Replace the snapshot: at 100 Hz, in each new state and when a request ends."""
        session, state = self._session, self._present_state()
        group, exchange = session.group, session.exchange
        snapshot = ControllerSnapshot(
            state, None,
            tuple([one.snapshot(target, now) for one, target in zip(
                session.monitors, session.targets.positions or _NO_TARGETS, strict=True)]),
            group.causes if group is not None else (), self._next_step(state),
            self._rejected + session.notes + session.drive_errors,
            bus_error=session.lost, bus_load=session.bus_load,
            realtime_priority=self._priority)
        if exchange is not None:
            clock = exchange.clock
            snapshot = snapshot._replace(
                stamp=clock.sync_stamp or None, cycle=clock.statistics,
                bus=exchange.bus.statistics)
        self._snapshot = snapshot
        self.observe(snapshot)

    def _present_state(self) -> ControllerState:
        session = self._session
        if session.is_closed:
            return ControllerState.CLOSED
        if self._operation is not None and not session.is_stopped:
            return self._operation.request.state
        if session.lost:
            return ControllerState.BUS_LOST
        if session.group is None:
            return ControllerState.UNCONFIGURED
        return session.group.state

    def _next_step(self, state: ControllerState) -> str:
        """Return the way to drives that follow setpoints, '' if they do."""
        session, group = self._session, self._session.group
        cause = group.severest_cause if group is not None and group.is_stopped else None
        if cause is not None:
            remedy = f'{FORBIDDEN_REMEDY}, {cause.remedy}' if session.forbidden else cause.remedy
            return replace(
                cause, remedy=remedy.removesuffix(', '),
                home_again=cause.home_again or bool(session.unhomed)).next_step
        requests = NEXT_STEPS.get(state, '')
        if state is ControllerState.INACTIVE and session.unhomed:
            requests = 'home, activate'
        if requests and session.forbidden:
            clear = 'clear_faults, ' if state in POWERLESS else ''
            return f'{FORBIDDEN_REMEDY}, then {clear}{requests}'
        return requests
