"""Components of the compensator on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.contact import Pressing
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import HeldBack
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
        if contact.lateral.enabled or pressing.settings.enabled:
            components.append(diagnostic_status(
                'contact', *self._contact_outcome(), self._contact_values()))
        return components

    def _contact_outcome(self) -> tuple[str, str]:
        pressing = self._compensator.contact.pressing
        if pressing.reason:
            return 'error', pressing.outcome
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
        deviations = correction.deviations(
            now + self._compensator.settings.horizon + self._compensator.following.lag)
        if deviations is not None:
            values['standard deviation of the prediction'] = '; '.join(
                f'{axis} {scale * deviation:.2g} {unit}' for axis, scale, unit, deviation in zip(
                    Pose._fields, SCALES, UNITS, deviations, strict=True))
        return values

    def _contact_values(self) -> dict[str, Any]:
        contact = self._compensator.contact
        pressing = contact.pressing
        return {
            **pressing_values(pressing),
            'zero of the force [N]': pressing.zero,
            'force of the moment desired [N]': pressing.desired,
            'moment on the wall [N m]': pressing.moment,
            'retracted last because': pressing.last_reason or 'never',
            'shift of the goal': millimetres(contact.present),
        }


def pressing_values(pressing: Pressing) -> dict[str, Any]:
    """Return the state and the force of the contact with the wall."""
    return {
        'pressing': pressing.outcome,
        'force on the wall [N]': pressing.monitor.force,
        'desired force [N]': pressing.settings.force,
        'bound of its error [N]': pressing.bound,
    }
