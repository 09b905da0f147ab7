"""Reports of the compensator: components on /diagnostics, and compensator/goal_status."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.compensation.contact import Pressing
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import (
    ArrivalSettings,
    ArrivalWatch,
    GoalProgress,
    GoalState,
    HeldBack,
)
from facade_manipulator.messages import millimetres, OutOfPlane, stamp_text
from facade_manipulator.nodes.diagnostics import diagnostic_status, POSE_AXES

GOAL_PERIOD = 0.2  # s, between two messages on goal_status while the head moves
CORRECTION_LEVELS = {
    CorrectionMode.ACTIVE: 'ok',
    CorrectionMode.SETTLING: 'ok',
    CorrectionMode.DISABLED: 'warn',
    CorrectionMode.NO_ESTIMATE: 'warn',
    CorrectionMode.SILENT: 'error',
}
GOAL_LEVELS = {GoalState.HELD_BACK: 'warn', GoalState.ENDED: 'warn', GoalState.REJECTED: 'error'}


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

    def components(self, now: float, fault: str = '') -> list[DiagnosticStatus]:
        """Return the components at a time [s]; `fault` is that of the inputs."""
        components = [diagnostic_status(
            'correction', *self.outcome(now, fault), self._values(now))]
        contact = self._compensator.contact
        pressing = contact.pressing
        if contact.lateral.enabled or pressing.settings.enabled:
            level = 'error' if pressing.reason else 'ok'
            components.append(diagnostic_status('contact', level, pressing.outcome, {
                **pressing_values(pressing),
                'zero of the force [N]': pressing.zero,
                'force of the moment desired [N]': pressing.desired,
                'moment on the wall [N m]': pressing.moment,
                'retracted last because': pressing.last_reason or 'never',
                'shift of the goal': millimetres(contact.present),
            }))
        return components

    def outcome(self, now: float, fault: str = '') -> tuple[str, str]:
        """Return level and message, without numbers that change all the time."""
        mode = self._compensator.correction.mode
        level, addition = CORRECTION_LEVELS[mode], self._held_back.message(now)
        if addition and level == 'ok':
            level = 'warn'
        if fault:
            level, addition = 'error', fault
        return level, '; '.join(filter(None, (mode.value, addition)))

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
                f'{axis} {scale * deviation:.2g} {unit}'
                for (axis, scale, unit), deviation in zip(POSE_AXES, deviations, strict=True))
        return values


def pressing_values(pressing: Pressing) -> dict[str, Any]:
    """Return the state and the force of the contact with the wall."""
    return {
        'pressing': pressing.outcome,
        'force on the wall [N]': pressing.monitor.force,
        'desired force [N]': pressing.settings.force,
        'bound of its error [N]': pressing.bound,
    }


class GoalReport:
    """
    Publish the progress of the newest goal, on change and until it is reached.

    Parameters
    ----------
    publish : callable
        Publishes a message on compensator/goal_status.
    compensator : Compensator
    held_back : HeldBack

    """

    def __init__(
        self, publish: Callable[[DiagnosticStatus], None], compensator: Compensator,
        held_back: HeldBack,
    ) -> None:
        self._publish, self._compensator, self._held_back = publish, compensator, held_back
        self.watch = ArrivalWatch(ArrivalSettings())
        self.stamp: Time | None = None  #: of the followed goal
        self._rejected: dict[str, str] = {}  # stamp and reason of the last rejected goal
        self._published: tuple[GoalState | None, str] = (None, '')
        self._next = -math.inf

    def accept(self, stamp: Time) -> None:
        """Report on another goal from now on; it supersedes the previous goal."""
        if stamp != self.stamp:
            self.end('a newer goal was received', GoalState.SUPERSEDED)
        self.stamp, self._rejected = stamp, {}
        self.watch.begin()
        self._report(stamp, GoalProgress(GoalState.ACCEPTED), '')

    def reject(self, stamp: Time, reason: str) -> None:
        """Report why a goal is not followed; the report on the followed goal continues."""
        self._rejected = {'rejected goal stamp': stamp_text(stamp), 'rejection': reason}
        self._send(stamp, GoalProgress(GoalState.REJECTED), reason)

    def end(self, reason: str, state: GoalState = GoalState.ENDED) -> None:
        """Report why the followed goal is no longer followed."""
        if self.stamp is not None:
            was_reached = self._published[0] is GoalState.REACHED
            if not was_reached or state is not GoalState.SUPERSEDED:
                self._send(self.stamp, GoalProgress(state), reason)
            self.stamp = None

    def update(self, now: float) -> None:
        """Publish a change at once, and the distance to the goal every `GOAL_PERIOD`."""
        if self.stamp is None or self._compensator.goal is None:
            return
        pressing, held_back = self._compensator.contact.pressing, self._held_back.message(now)
        progress = self.watch.update(
            now, self._compensator.goal_error(now), self._compensator.path_time(now),
            bool(held_back or pressing.reason), pressing.is_held)
        if not pressing.is_held:
            held_back = '; '.join(filter(None, (held_back, pressing.outcome)))
        is_due = not self._next - GOAL_PERIOD <= now < self._next  # or the clock was set back
        is_moving = progress.state is not GoalState.REACHED
        if self._published != (progress.state, held_back) or is_due and is_moving:
            self._next = now + GOAL_PERIOD
            self._report(self.stamp, progress, held_back)

    def _report(self, stamp: Time, progress: GoalProgress, reason: str) -> None:
        self._published = progress.state, reason
        self._send(stamp, progress, reason)

    def _send(self, stamp: Time, progress: GoalProgress, reason: str) -> None:
        state, goal = progress.state, self._compensator.goal
        pressing = self._compensator.contact.pressing
        values = {
            'goal stamp': stamp_text(stamp),
            'state': state.value,
            'distance [mm]': 1e3 * progress.distance,
            'angle [deg]': math.degrees(progress.angle),
            'time to go [s]': progress.time_to_go,
            'reason': reason,
            **(pressing_values(pressing) if pressing.settings.enabled else {}),
        }
        if goal is not None:
            values |= {'followed x [mm]': 1e3 * goal.x, 'followed y [mm]': 1e3 * goal.y,
                       'followed angle [deg]': math.degrees(goal.theta)}
        self._publish(diagnostic_status(
            'goal', GOAL_LEVELS.get(state, 'ok'),
            f'{state.value}: {reason}' if reason else state.value, values | self._rejected))
