"""Requests around the motion: configure, clean up, clear faults, self-test, close."""

from __future__ import annotations

from facade_manipulator.canopen.bus import Condition
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.commissioning import Finding
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.operation import Operation, result_of, Steps
from facade_manipulator.drives.session import Session
from facade_manipulator.errors import DriveError, DriveStateError, DriveTimeoutError

CLOSING_TIMEOUT = 3.0  # s
SDO_TIMEOUT = 1.5  # s, for drives that are to be switched off by SDO
STOP_AND_CUT = 2  # steps: what still moves is stopped before it loses its power
LISTEN_PERIODS = 2  # of the heartbeats, before the first word
SLOWEST = 20  # cycles in which each TPDO comes once
MAX_BAD_CYCLES = 0.001  # of all


class Configure(Operation):
    """Open the bus, check and configure the drives, start the cycle."""

    state = ControllerState.CONFIGURING

    def run(self, now: float) -> Steps:
        """Listen before the first word: another master's drives are not ours to reset."""
        session, settings = self.session, self.session.settings
        if session.exchange is not None or session.lost:
            reason = (f'the bus is lost: {session.lost}' if session.lost
                      else 'the drives are configured already')
            raise DriveStateError(f'configure is not possible, {reason}')
        exchange, commissioning = session.open()
        end = exchange.read_until + LISTEN_PERIODS * settings.heartbeat_period
        while exchange.read_until < end:
            now = yield
        exchange.require_sole_master()
        yield from self.done(commissioning.require_unused)
        exchange.require_sole_master()
        exchange.transmits = True
        try:
            notes = yield from self.done(commissioning.configure)
        except DriveTimeoutError as error:  # a drive that is silent may be on another bus
            raise DriveTimeoutError(f'{error}. The bus is {session.bus.name}') from error
        session.notes = tuple(filter(None, (exchange.bus.sync_note, *notes)))
        now = yield
        exchange.require_sole_master()
        group = session.start_cycle(exchange, now)
        end = now + settings.step_timeout + SLOWEST * settings.period
        while not session.is_stopped:
            silent = [f'{name} of {one.title}'
                      for one in session.monitors for name in sorted(one.answers.silent)]
            if silent and now > end:
                raise DriveTimeoutError(
                    f'{", ".join(silent)} did not come in answer to SYNC: '
                    'correct pdos in the profile of the drive')
            if not silent and session.is_off:
                return '; '.join(filter(None, (
                    f'The drives on {session.bus.name} are configured', exchange.bus.sync_note)))
            now = yield
        if group.needs_configuration:
            raise DriveTimeoutError(group.reason)
        return f'The drives are configured, but stopped: {group.reason}.'

    def give_up(self) -> None:
        """Close the bus again."""
        self.session.close()


class Cleanup(Operation):
    """Take the power off for good and close the bus."""

    state = ControllerState.CLEANING_UP

    def run(self, now: float) -> Steps:
        """Close once the drives have confirmed that their power is off, or had the time to."""
        group = self.group
        if group.state.has_power:
            raise DriveStateError('cleanup is not possible while the drives have power')
        return (yield from _cut_power_and_close(self.session, group, now))


class ClearFaults(Operation):
    """Check the drives again and reset their faults, the power stays off; or end a halt."""

    state = ControllerState.CLEARING
    name = 'clear_faults'

    def run(self, now: float) -> Steps:
        """Let the worker prove that the drives are still as they were configured, then reset."""
        session, group = self.session, self.group
        cause = group.cause
        if group.state is ControllerState.HALTED:
            group.enable(now)
            return 'The halt is ended; the drives follow setpoints.'
        if cause is None:
            return 'There is no fault to clear.'
        _, commissioning = self.open_bus
        group.require_resettable(now)
        job = session.worker.submit(commissioning.check_again)
        while not (job.done() and group.state is ControllerState.STOPPED):
            now = yield
        try:
            result_of(job)
        except DriveError as error:
            group.stop(Cause(str(error), Remedy.CONFIGURE, configure_again=True), now)
            raise DriveError(f'The faults remain: {error}') from error
        group.reset(now)
        while not session.is_off:
            yield
            if session.is_stopped:
                raise DriveError(f'The faults remain: {group.causes[-1].message}')
        return f'The faults are cleared ({cause.message}).'


class SelfTest(Operation):
    """Look at the drives, the bus and the cycle; the answer is a list of findings."""

    state = ControllerState.TESTING
    name = 'self_test'
    _is_first = False

    def run(self, now: float) -> Steps:
        """Let the worker ask the drives; on a bus that is not open, for this test alone."""
        session = self.session
        if session.is_powered:
            raise DriveStateError('self_test is not possible while powered: deactivate first')
        self._is_first = session.exchange is None and not session.lost
        exchange, commissioning = session.open() if self._is_first else self.open_bus
        found = yield from self.done(lambda: commissioning.inspect(not self._is_first))
        findings = [*found, self._bus(exchange), self._cycle(exchange), self._stop()]
        self.give_up()
        return findings

    def give_up(self) -> None:
        """Close the bus if it was opened for the test."""
        if self._is_first:
            self.session.let_go()

    def _bus(self, exchange: CyclicExchange) -> Finding:
        bus = exchange.bus.statistics
        return Finding(
            'bus', bus.condition is Condition.ACTIVE and not bus.overflows,
            f'the controller is {bus.condition.name.lower()}, {bus.error_frames} error frames, '
            f'{bus.overflows} overflows, worst-case load {100.0 * self.session.bus_load:.0f} %')

    def _cycle(self, exchange: CyclicExchange) -> Finding:
        cycle = exchange.clock.statistics
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

    def run(self, now: float) -> Steps:
        """Power off, and take the power once the carriages stand still."""
        session, group = self.session, self.session.group
        if group is None:
            session.is_closed = True
            session.close()
            return 'The bus is closed; no drive was configured.'
        end = now + CLOSING_TIMEOUT
        if not session.lost and session.is_powered:
            try:
                group.disable(now)
            except DriveStateError:
                group.stop(Cause('the drive controller is being closed'), now)
        while not session.lost and now <= end and (
                group.state not in (ControllerState.INACTIVE, ControllerState.STOPPED)):
            now = yield
        try:
            return (yield from _cut_power_and_close(session, group, now))
        finally:
            session.is_closed = True


def _cut_power_and_close(session: Session, group: Group, now: float) -> Steps:
    """
    Take the power off and close the bus; return the message.

    Raises a DriveError with the drives that have not confirmed that they have no power; the bus
    is closed all the same.
    """
    since, end = now, now + STOP_AND_CUT * session.settings.step_timeout
    if not session.lost:
        group.cut_power(now)
    unsure = session.unconfirmed(since)
    while unsure and now < end and not session.lost:
        now = yield
        unsure = session.unconfirmed(since)
    if unsure and not session.lost and session.commissioning is not None:
        job = session.worker.submit(session.commissioning.unconfirmed, unsure)
        while not job.done() and now < end + SDO_TIMEOUT:
            now = yield
        unsure = result_of(job) if job.done() else unsure
    reason = f'the bus is lost, {session.lost}' if session.lost else 'no answer says so'
    session.close()
    if unsure:
        raise DriveError(
            f'The bus is closed, but the power of {" and ".join(one.title for one in unsure)} is '
            f'not confirmed off: {reason}; switch the supply off before anybody reaches in')
    return 'The drives have confirmed that their power is off; the bus is closed.'
