"""
What an operator can ask for: each operation begins, is polled until it is done, and ends.

Operations run in the control thread. They raise a ManipulatorError with the sentence for the
operator; the sentence of a success is what `begin` or `poll` returns.
"""

from __future__ import annotations

from concurrent.futures import Future
from typing import ClassVar

from facade_manipulator.drives.bus import Condition
from facade_manipulator.drives.commissioning import Finding
from facade_manipulator.drives.group import Cause, Group, Phase
from facade_manipulator.drives.homing import AxisHoming, HomingSequence, HomingState
from facade_manipulator.drives.monitor import CONFIGURE_AGAIN
from facade_manipulator.drives.session import Session
from facade_manipulator.drives.settings import AXIS_NAMES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.targets import require_inside
from facade_manipulator.errors import (
    BusError,
    DriveError,
    DriveFaultError,
    DriveStateError,
    DriveTimeoutError,
    ManipulatorError,
)

CLOSING_TIMEOUT = 3.0
MOST_BAD_CYCLES = 0.001  # of all


class Operation:
    """
    A request under way.

    Parameters
    ----------
    session : Session

    """

    state: ClassVar[ControllerState]
    interrupts: ClassVar[bool] = False
    outlives_bus: ClassVar[bool] = False

    def __init__(self, session: Session) -> None:
        self.session = session

    @property
    def name(self) -> str:
        """What the operator calls it."""
        return type(self).__name__.lower()

    @property
    def group(self) -> Group:
        """
        The state machine of the drives.

        Raises
        ------
        DriveStateError
            The drives are not configured.

        """
        if self.session.group is None:
            raise DriveStateError(f'{self.name} is not possible: configure the drives first')
        return self.session.group

    def begin(self, now: float) -> str | None:
        """Begin; return the sentence if there is nothing to do."""

    def poll(self, now: float) -> str | None:
        """Return the sentence once it is done, None until then."""

    def give_up(self) -> None:
        """Tidy up after a failure."""

    def _require_not_stopped(self) -> None:
        if self.session.is_stopped:
            raise DriveFaultError(str(self.group.cause))


class Configure(Operation):
    """Open the bus, check and configure the drives, start the cycle."""

    state = ControllerState.CONFIGURING
    _job: Future | None = None

    def begin(self, now: float) -> str | None:
        """Open the bus; the worker does the rest."""
        session = self.session
        if session.connection is not None or session.lost is not None:
            raise DriveStateError('configure is not possible, the bus is in use: clean up first')
        session.open()
        self._job = session.worker.submit(session.connection.commissioning.configure)
        return None

    def poll(self, now: float) -> str | None:
        """Start the cycle when the worker is done, then wait for the drives' answers."""
        session = self.session
        if not self._job.done():
            return None
        if session.group is None:
            session.notes = tuple(_result(self._job))
            session.start_cycle(now)
        if session.is_stopped:
            if session.group.needs_configuration:
                raise DriveTimeoutError(str(session.group.cause))
            return f'The drives are configured, but stopped: {session.group.cause}.'
        return 'The drives are configured; the power is off.' if session.is_off else None

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
            raise DriveStateError('cleanup is not possible while powered: deactivate first')
        self.group.cut_power(now)
        self._deadline = now + self.session.settings.step_timeout
        return None

    def poll(self, now: float) -> str | None:
        """Close once the drives have confirmed, or had the time to."""
        if not self.session.has_done(Phase.STOPPED) and now < self._deadline:
            return None
        self.session.close()
        return 'The drives have no power and the bus is closed.'


class Activate(Operation):
    """Power on and follow targets."""

    state = ControllerState.ACTIVATING

    def begin(self, now: float) -> str | None:
        """Check that the carriages may be powered where they are."""
        group = self.group
        if group.phase is Phase.OFF:
            self._require_homed()
            self._require_allowed()
        group.enable(now)
        return None

    def poll(self, now: float) -> str | None:
        """Wait until targets are followed."""
        self._require_not_stopped()
        done = self.session.has_done(Phase.RUNNING)
        return 'The drives are powered and follow setpoints.' if done else None

    def _require_homed(self) -> None:
        unhomed = self.session.unhomed
        if unhomed:
            raise DriveStateError(
                f'activate is not possible, {" and ".join(unhomed)} must be homed: call home')

    def _require_allowed(self) -> None:
        positions = self.session.positions()
        try:
            require_inside(AXIS_NAMES, self.session.axes, positions)
            self.session.check_targets(positions)
        except ManipulatorError as error:
            raise DriveStateError(
                f'activate is not possible from here: {error}; move the carriages by hand'
            ) from error


class Deactivate(Operation):
    """Come to rest on the path, then power off."""

    state = ControllerState.DEACTIVATING

    def begin(self, now: float) -> str | None:
        """Begin to ramp down."""
        self.group.disable(now)
        return None

    def poll(self, now: float) -> str | None:
        """Wait until the power is off."""
        self._require_not_stopped()
        return 'The carriages stand still; the power is off.' if self.session.is_off else None


class Halt(Operation):
    """Come to rest on the path and hold; a homing is given up."""

    state = ControllerState.HALTING
    interrupts = True
    _was_homing = False

    def begin(self, now: float) -> str | None:
        """Begin to ramp down."""
        self._was_homing = self.group.phase is Phase.HOMING
        self.group.halt(now)
        return None

    def poll(self, now: float) -> str | None:
        """Wait until nothing moves."""
        self._require_not_stopped()
        if self._was_homing:
            return 'Homing is given up; the power is off.' if self.session.is_off else None
        done = self.session.has_done(Phase.HALTED)
        return 'The carriages stand still and hold: activate to go on.' if done else None


class Home(Operation):
    """Home all axes, rank after rank."""

    state = ControllerState.HOMING

    def begin(self, now: float) -> str | None:
        """Power on in homing mode."""
        session = self.session
        group = self.group
        session.positions()
        sequence = HomingSequence(tuple(
            AxisHoming(name, axis.homing_timeout, axis.homing_rank, axis.homing_method)
            for name, axis in zip(AXIS_NAMES, session.axes, strict=True)))
        group.home(sequence, now)
        session.homing = sequence
        for monitor in session.monitors:
            monitor.homed = False
        return None

    def poll(self, now: float) -> str | None:
        """Note which axes are homed; done when the power is off again."""
        for axis, monitor in zip(self.session.homing.axes, self.session.monitors, strict=True):
            monitor.homed = axis.state is HomingState.HOMED
        if self.session.is_stopped:
            raise DriveFaultError(f'{self.group.cause}. {self._report()}')
        return self._report() if self.session.is_off else None

    def _report(self) -> str:
        return 'Homing: ' + ', '.join(
            f'{monitor.name} is homed, at {monitor.position:.4f} m' if monitor.homed else
            f'{monitor.name} is not homed' for monitor in self.session.monitors) + '.'


class ClearFaults(Operation):
    """Check the drives again and reset their faults; they stay without power."""

    state = ControllerState.CLEARING
    name = 'clear_faults'
    _job: Future | None = None
    _cause: Cause | None = None

    def begin(self, now: float) -> str | None:
        """Let the worker prove that the drives are still as they were configured."""
        session = self.session
        self._cause = self.group.cause
        if self._cause is None:
            return 'There is no fault to clear.'
        if session.lost is not None:
            raise BusError(
                f'clear_faults is not possible, the bus is lost: {session.lost.sentence}')
        self.group.require_resettable(now)
        self._job = session.worker.submit(session.connection.commissioning.check_again)
        return None

    def poll(self, now: float) -> str | None:
        """Reset when the check has passed; wait until the drives have taken it."""
        session = self.session
        if self._job is not None:
            if self._job.done() and self.group.phase is Phase.STOPPED:
                self._reset(now)
        elif session.is_stopped:
            raise DriveFaultError(f'The faults remain: {self._latest()}')
        if not session.is_off:
            return None
        following = f'home {" and ".join(session.unhomed)}, then ' if session.unhomed else ''
        return f'The faults are cleared ({self._cause.sentence}); next: {following}activate.'

    def _reset(self, now: float) -> None:
        job, self._job = self._job, None
        try:
            _result(job)
        except DriveError as error:
            cause = Cause(str(error), CONFIGURE_AGAIN, configure_again=True)
            self.group.stop(cause, now)
            raise DriveFaultError(f'The faults remain: {cause}') from error
        self.group.reset(now)

    def _latest(self) -> Cause:
        group = self.group
        return group.further_causes[-1] if group.further_causes else group.cause


class SelfTest(Operation):
    """Look at the drives, the bus and the cycle; the answer is a list of findings."""

    state = ControllerState.TESTING
    name = 'self_test'
    _job: Future | None = None

    def begin(self, now: float) -> None:
        """Let the worker ask the drives."""
        session = self.session
        if self.group.is_powered:
            raise DriveStateError('self_test is not possible while powered: deactivate first')
        if session.lost is not None:
            raise BusError(f'self_test is not possible, the bus is lost: {session.lost.sentence}')
        self._job = session.worker.submit(session.connection.commissioning.inspect)

    def poll(self, now: float) -> list[Finding] | None:
        """Add what this side knows to what the drives said."""
        if not self._job.done():
            return None
        return [*_result(self._job), self._bus(), self._cycle(), self._stop()]

    def _bus(self) -> Finding:
        bus = self.session.bus_statistics
        return Finding(
            'bus', bus.condition is Condition.ACTIVE and not bus.overflows,
            f'the controller is {bus.condition.name.lower()}, {bus.error_frames} error frames, '
            f'{bus.overflows} overflows, worst-case load {100.0 * self.session.bus_load:.0f} %')

    def _cycle(self) -> Finding:
        cycle = self.session.cycle_statistics
        bad = cycle.incomplete + cycle.late + cycle.skipped
        return Finding(
            'cycle', bad <= MOST_BAD_CYCLES * cycle.cycles,
            f'{cycle.cycles} cycles, {cycle.incomplete} incomplete, {cycle.late} late, '
            f'{cycle.skipped} skipped; commands at most {1e3 * cycle.worst:.1f} ms after SYNC')

    def _stop(self) -> Finding:
        causes = self.session.causes
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
            self._deadline = now + session.settings.step_timeout
            session.group.cut_power(now)
        elif self._cutting and (session.has_done(Phase.STOPPED) or late):
            return self._finish()
        return None

    def _finish(self) -> str:
        self.session.close()
        return 'The drive controller is closed.'


def _result(job: Future):
    """Return what the worker brought, or raise what it met, told to an operator."""
    error = job.exception()
    if error is None or isinstance(error, ManipulatorError):
        return job.result()
    raise DriveError(f'checking the drives failed: {type(error).__name__}: {error}') from error
