"""Components of the compensator on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import HeldBack
from facade_manipulator.compensation.pressing import Pressing
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import millimetres, OutOfPlane
from facade_manipulator.nodes.diagnostics import diagnostic_status

# in which poses are shown, and their factors
UNITS, SCALES = ('mm', 'mm', 'deg'), (1e3, 1e3, math.degrees(1.0))
LEVELS = {
    CorrectionMode.ACTIVE: 'ok',
    CorrectionMode.SETTLING: 'ok',
    CorrectionMode.DISABLED: 'warn',
    CorrectionMode.NO_ESTIMATE: 'warn',
    CorrectionMode.SILENT: 'error',
}


class CompensatorReport:
    """
    Build the diagnostics of a compensator.

    Attributes
    ----------
    newest : CorrectedPose or None
    pose_count : int
        Number of corrected poses.
    out_of_plane : OutOfPlane
        Height and tilt of the newest estimate.

    """

    def __init__(
        self, compensator: Compensator, held_back: HeldBack
    ) -> None:
        self._compensator, self._held_back = compensator, held_back
        self.newest: CorrectedPose | None = None
        self.pose_count = 0
        self.out_of_plane = OutOfPlane(0.0, 0.0)

    def add(self, corrected: CorrectedPose) -> None:
        """Count a corrected pose."""
        self.newest = corrected
        self.pose_count += 1

    def components(
        self, now: float, rejections: Mapping[str, Any], fault: str = ''
    ) -> list[DiagnosticStatus]:
        """Return the components at a time [s]; `fault` is that of the inputs."""
        components = [diagnostic_status(
            'correction', *self.outcome(now, fault), {**self._values(now), **rejections})]
        contact = self._compensator.contact
        pressing = contact.pressing
        if any(part.enabled for part in (
                contact.lateral.settings, pressing.press, pressing.turn)):
            components.append(diagnostic_status(
                'contact', *self._contact_outcome(), self._contact_values()))
        return components

    def _contact_outcome(self) -> tuple[str, str]:
        pressing = self._compensator.contact.pressing
        if pressing.reason:
            return 'error', pressing.outcome
        if self._compensator.obstacle:
            return 'warn', f'{pressing.outcome}; {self._compensator.obstacle}'
        return 'ok', pressing.outcome

    def outcome(self, now: float, fault: str = '') -> tuple[str, str]:
        """Return level and message, without numbers that change all the time."""
        mode = self._compensator.correction.mode
        if fault:
            return 'error', f'{mode.value}; {fault}'
        if held_back := self._held_back.message(now):
            level = 'error' if LEVELS[mode] == 'error' else 'warn'
            return level, f'{mode.value}; {held_back}'
        return LEVELS[mode], mode.value

    def _values(self, now: float) -> dict[str, Any]:
        correction = self._compensator.correction
        values: dict[str, Any] = {
            'horizon [ms]': 1e3 * self._compensator.settings.horizon,
            'corrected poses': self.pose_count,
            'age of the estimate [ms]': 1e3 * correction.age(now),
            'lag of the head [ms]': 1e3 * self._compensator.following.lag,
            'initialisations': self._compensator.initialisations,
        }
        if any(self.out_of_plane):
            values['left out of the estimate'] = (
                f'z {1e3 * self.out_of_plane.height:+.1f} mm, '
                f'tilt {math.degrees(self.out_of_plane.tilt):.2f} deg')
        if self.newest is not None:
            values['corrected disturbance'] = millimetres(self.newest.disturbance)
            values['saturation error'] = millimetres(self.newest.saturation_error)
            values['tracking error'] = millimetres(self.newest.tracking_error)
        deviations = correction.deviations(
            now, self._compensator.settings.horizon + self._compensator.following.lag)
        if deviations is not None:
            values['standard deviation of the prediction'] = '; '.join(
                f'{axis} {scale * whole:.2g} {unit} (estimator {scale * part:.2g})'
                for axis, scale, unit, whole, part in zip(
                    Pose._fields, SCALES, UNITS, *deviations, strict=True))
        return values

    def _contact_values(self) -> dict[str, Any]:
        contact = self._compensator.contact
        pressing, watch = contact.pressing, contact.pressing.watch
        sway = pressing.sway
        return {
            **pressing_values(pressing),
            'zero of the force [N]': pressing.zero.force,
            'force of the moment desired [N]': pressing.desired,
            'force, mean of 10 s [N]': watch.mean,
            'force, RMS error of 10 s [N]': watch.rms,
            'share off the wall of 10 s [%]': 100.0 * watch.share_off,
            'stiffness of the contact [N/mm]': 1e-3 * pressing.stiffness.value,
            'moment on the wall [N m]': pressing.theta.measured,
            'push-back of the gondola [mm]': 1e3 * sway.push_back,
            'sway of the gondola, envelope': millimetres(sway.envelope),
            'retracted last because': pressing.last_reason or 'never',
            'shift of the goal': millimetres(contact.present),
        }


def pressing_values(pressing: Pressing) -> dict[str, Any]:
    """Return the state and the force of the contact with the wall."""
    return {
        'pressing': pressing.outcome,
        'force on the wall [N]': pressing.y.measured,
        'desired force [N]': pressing.press.force,
        'bound of its error [N]': pressing.bound,
    }
