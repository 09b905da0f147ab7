"""Requests that power the drives: activate, deactivate, halt, home."""

from __future__ import annotations

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.homing import AxisHoming, HomingSequence
from facade_manipulator.drives.monitor import positions_of
from facade_manipulator.drives.operation import Operation, Steps
from facade_manipulator.drives.targets import require_inside
from facade_manipulator.errors import DriveError, DriveStateError, ManipulatorError


class Activate(Operation):
    """Power on and follow targets."""

    state = ControllerState.ACTIVATING

    def run(self, now: float) -> Steps:
        """Check that the carriages may be powered where they are; power them."""
        group = self.group
        self.require_allowed()
        if group.state is ControllerState.INACTIVE:
            self._require_ready()
        group.enable(now)
        yield from self.until(ControllerState.ACTIVE)
        return 'The drives are powered and follow setpoints.'

    def _require_ready(self) -> None:
        """Check that the carriages are homed, and where they may be."""
        unhomed = self.session.unhomed
        if unhomed:
            raise DriveStateError(
                f'activate is not possible, {" and ".join(unhomed)} must be homed')
        positions = positions_of(self.session.monitors)
        try:
            require_inside(self.session.axes, positions)
            self.session.targets.mechanism.check_targets(positions)
        except ManipulatorError as error:
            raise DriveStateError(
                f'activate is not possible from here: {error}; move the carriages by hand'
            ) from error


class Deactivate(Operation):
    """Come to rest on the path, then power off."""

    state = ControllerState.DEACTIVATING

    def run(self, now: float) -> Steps:
        """Ramp down and wait until the power is off."""
        self.group.disable(now)
        yield from self.until(ControllerState.INACTIVE)
        return 'The carriages stand still.'


class Halt(Operation):
    """Come to rest on the path and hold; a homing or an activation is given up."""

    state = ControllerState.HALTING
    interrupts = True

    def run(self, now: float) -> Steps:
        """Ramp down; where nothing is commanded to move, nothing is cancelled."""
        is_homing = self.group.state is ControllerState.HOMING
        self.interrupts = self.group.halt(now)
        if not self.interrupts:
            return 'Nothing moves on.'
        yield from self.until(ControllerState.HALTED, ControllerState.INACTIVE)
        if self.session.is_off:
            return f'{"Homing" if is_homing else "The activation"} is given up.'
        return 'The carriages stand still and hold.'


class Home(Operation):
    """Home all axes, rank after rank."""

    state = ControllerState.HOMING

    def run(self, now: float) -> Steps:
        """Power on in homing mode, and wait until the power is off again."""
        session, group = self.session, self.group
        self.require_allowed()
        positions_of(session.monitors)
        sequence = HomingSequence(tuple(
            AxisHoming(name, axis.homing_timeout, axis.homing_rank, axis.homing_method)
            for name, axis in zip(AXIS_NAMES, session.axes, strict=True)))
        group.home(sequence, now)
        for monitor in session.monitors:
            monitor.encoder.begin_homing()
        while not session.is_off:
            yield
            if session.is_stopped:
                raise DriveError(f'{group.reason}. {self._conclude()}')
        return self._conclude()

    def _conclude(self) -> str:
        """Note which axes are homed, not before their positions have settled, and report."""
        for homed, monitor in zip(
                self.group.homing.homed, self.session.monitors, strict=True):
            monitor.encoder.end_homing(homed)
        return 'Homing: ' + ', '.join(
            f'{monitor.name} is homed, at {monitor.measured.position:.4f} m'
            if monitor.encoder.homed else f'{monitor.name} is not homed'
            for monitor in self.session.monitors) + '.'
