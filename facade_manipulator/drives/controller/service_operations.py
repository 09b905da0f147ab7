"""Requests around the motion: configure, clean up, clear faults, self-test, close."""

from __future__ import annotations

from concurrent.futures import Future

from facade_manipulator.drives.canopen import Condition
from facade_manipulator.drives.cia402 import Cause, CONFIGURE_REMEDY, Phase
from facade_manipulator.drives.controller.commissioning import Finding
from facade_manipulator.drives.controller.operation import Operation, result_of
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.errors import (
    BusError,
    DriveError,
    DriveFaultError,
    DriveStateError,
    DriveTimeoutError,
)

CLOSING_TIMEOUT = 3.0
STOP_AND_CUT = 2  # steps: what still moves is stopped before it loses its power
LISTEN_PERIODS = 2  # of the heartbeats, before the first word
SLOWEST = 20  # cycles in which each TPDO comes once
MAX_BAD_CYCLES = 0.001  # of all


class Configure(Operation):
    """Open the bus, check and configure the drives, start the cycle."""

    state = ControllerState.CONFIGURING
    _job: Future | None = None
    _deadline = 0.0

    def begin(self, now: float) -> str | None:
        """Open the bus and listen: another master's drives are not ours to reset."""
        session = self.session
        if session.exchange is not None or session.lost is not None:
            raise DriveStateError('configure is not possible, the drives are configured already')
        session.open()
        self._deadline = now + LISTEN_PERIODS * session.settings.heartbeat_period
        return None

    def _listen(self) -> None:
        """Let the worker begin if nobody else commands the drives."""
        session = self.session
        if session.exchange.read_until >= self._deadline:
            session.exchange.require_sole_master()
            session.exchange.transmits = True
            self._job = session.worker.submit(session.commissioning.configure)

    def poll(self, now: float) -> str | None:
        """Start the cycle when the worker is done, then wait for the drives' answers."""
        session = self.session
        if self._job is None:
            self._listen()
            return None
        if not self._job.done():
            return None
        if session.group is None:
            session.notes = self._notes()
            session.exchange.require_sole_master()
            session.start_cycle(now)
            settings = session.settings
            self._deadline = now + settings.step_timeout + SLOWEST * settings.period
        if session.is_stopped:
            if session.group.needs_configuration:
                raise DriveTimeoutError(session.group.cause.message)
            return f'The drives are configured, but stopped: {session.group.cause.message}.'
        silent = [f'{name} of {one.title}'
                  for one in session.monitors for name in sorted(one.silent_tpdos)]
        if silent and now > self._deadline:
            raise DriveTimeoutError(
                f'{", ".join(silent)} did not come in answer to SYNC: '
                'correct pdos in the profile of the drive')
        if silent or not session.is_off:
            return None
        return f'The drives on {session.bus_name} are configured; the power is off.'

    def _notes(self) -> tuple[str, ...]:
        """Return what the worker found; a drive that is silent may be on another bus."""
        try:
            return tuple(result_of(self._job))
        except DriveTimeoutError as error:
            raise DriveTimeoutError(f'{error}. The bus is {self.session.bus_name}') from error

    def give_up(self) -> None:
        """Close the bus again."""
        self.session.close()


class Cleanup(Operation):
    """Take the power off for good and close the bus."""

    state = ControllerState.CLEANING_UP
    _deadline = 0.0

    def begin(self, now: float) -> str | None:
        """Command power off."""
        if self.session.lost is not None:
            self.session.close()
            return 'The bus was lost; the drives have stopped by themselves.'
        if self.group.is_powered:
            raise DriveStateError('cleanup is not possible while the drives have power')
        self.group.cut_power(now)
        self._deadline = now + STOP_AND_CUT * self.session.settings.step_timeout
        return None

    def poll(self, now: float) -> str | None:
        """Close once the drives have confirmed, or had the time to."""
        if not self.session.has_done(Phase.STOPPED) and now < self._deadline:
            return None
        self.session.close()
        return 'The drives have no power and the bus is closed.'


class ClearFaults(Operation):
    """Check the drives again and reset their faults, the power stays off; or end a halt."""

    state = ControllerState.CLEARING
    name = 'clear_faults'
    _job: Future | None = None
    _cause: Cause | None = None

    def begin(self, now: float) -> str | None:
        """Let the worker prove that the drives are still as they were configured."""
        session = self.session
        self._cause = self.group.cause
        if self.group.phase is Phase.HALTED:
            self.group.enable(now)
            return 'The halt is ended; the drives follow setpoints.'
        if self._cause is None:
            return 'There is no fault to clear.'
        if session.lost is not None:
            raise BusError(
                f'clear_faults is not possible, the bus is lost: {session.lost.message}')
        self.group.require_resettable(now)
        self._job = session.worker.submit(session.commissioning.check_again)
        return None

    def poll(self, now: float) -> str | None:
        """Reset when the check has passed; wait until the drives have taken it."""
        session = self.session
        if self._job is not None:
            if self._job.done() and self.group.phase is Phase.STOPPED:
                self._reset(now)
        elif session.is_stopped:
            raise DriveFaultError(f'The faults remain: {self.group.causes[-1].message}')
        return f'The faults are cleared ({self._cause.message}).' if session.is_off else None

    def _reset(self, now: float) -> None:
        job, self._job = self._job, None
        try:
            result_of(job)
        except DriveError as error:
            cause = Cause(str(error), CONFIGURE_REMEDY, configure_again=True)
            self.group.stop(cause, now)
            raise DriveFaultError(f'The faults remain: {cause.message}') from error
        self.group.reset(now)


class SelfTest(Operation):
    """Look at the drives, the bus and the cycle; the answer is a list of findings."""

    state = ControllerState.TESTING
    name = 'self_test'
    _job: Future | None = None
    _is_first = False

    def begin(self, now: float) -> None:
        """Let the worker ask the drives; on a bus that is not open, for this test alone."""
        session = self.session
        if session.is_powered:
            raise DriveStateError('self_test is not possible while powered: deactivate first')
        if session.lost is not None:
            raise BusError(f'self_test is not possible, the bus is lost: {session.lost.message}')
        self._is_first = session.exchange is None
        if self._is_first:
            session.open()
        self._job = session.worker.submit(
            session.commissioning.inspect, not self._is_first)

    def poll(self, now: float) -> list[Finding] | None:
        """Add what this side knows to what the drives said."""
        if not self._job.done():
            return None
        findings = [*result_of(self._job), self._bus(), self._cycle(), self._stop()]
        self.give_up()
        return findings

    def give_up(self) -> None:
        """Close the bus if it was opened for the test."""
        if self._is_first:
            self.session.let_go()

    def _bus(self) -> Finding:
        bus = self.session.exchange.bus.statistics
        return Finding(
            'bus', bus.condition is Condition.ACTIVE and not bus.overflows,
            f'the controller is {bus.condition.name.lower()}, {bus.error_frames} error frames, '
            f'{bus.overflows} overflows, worst-case load {100.0 * self.session.bus_load:.0f} %')

    def _cycle(self) -> Finding:
        cycle = self.session.exchange.clock.statistics
        bad = cycle.incomplete + cycle.late + cycle.skipped
        return Finding(
            'cycle', bad <= MAX_BAD_CYCLES * cycle.cycles,
            f'{cycle.cycles} cycles, {cycle.incomplete} incomplete, {cycle.late} late, '
            f'{cycle.skipped} skipped; commands at most {1e3 * cycle.worst:.1f} ms after SYNC')

    def _stop(self) -> Finding:
        group = self.session.group
        causes = group.causes if group is not None else ()
        return Finding(
            'faults', not causes, '; '.join(map(str, causes)) or 'nothing has stopped the drives')


class Close(Operation):
    """Power off in order if that is possible, stop if it is not; then fall silent."""

    state = ControllerState.CLEANING_UP
    interrupts = outlives_bus = True
    _deadline = 0.0
    _cutting = False

    def begin(self, now: float) -> str | None:
        """Begin to power off."""
        session = self.session
        if session.group is None or session.lost is not None:
            return self._finish()
        self._deadline = now + CLOSING_TIMEOUT
        if session.is_powered:
            try:
                session.group.disable(now)
            except DriveStateError:
                session.group.stop(Cause('the drive controller is being closed'), now)
        return None

    def poll(self, now: float) -> str | None:
        """Take the power off once the carriages stand still."""
        session = self.session
        late = now > self._deadline
        if session.group is None or session.lost is not None:
            return self._finish()
        if not self._cutting and (session.group.phase in (Phase.OFF, Phase.STOPPED) or late):
            self._cutting = True
            self._deadline = now + STOP_AND_CUT * session.settings.step_timeout
            session.group.cut_power(now)
        elif self._cutting and (session.has_done(Phase.STOPPED) or late):
            return self._finish()
        return None

    def _finish(self) -> str:
        self.session.close()
        return 'The drive controller is closed.'
