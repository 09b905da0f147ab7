"""
Reports of the compensator: components for /diagnostics, and the progress of a goal.

A component is its name, its level (ok, warn or error), a message and values by key, without ROS.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.compensation.contact import Pressing
from facade_manipulator.compensation.correction import (
    Correction,
    CorrectionMode,
    FADE_AFTER,
    SILENCE,
)
from facade_manipulator.compensation.following import (
    ArrivalSettings,
    ArrivalWatch,
    GoalProgress,
    GoalState,
    PATIENCE,
)
from facade_manipulator.errors import joined
from facade_manipulator.kinematics.planar import millimetres, POSE_AXES

Component = tuple[str, str, str, dict[str, Any]]
GOAL_PERIOD = 0.2  # s, period of goal_status while the head moves
ARRIVAL_TIME = (
    1.0  # s after its path, in which the head reaches a goal if nothing holds it back
)
NEWER_GOAL = 'a newer goal was received'
UNESTIMATED = (CorrectionMode.NO_ESTIMATE, CorrectionMode.SILENT)
UNCORRECTED = (CorrectionMode.DISABLED, CorrectionMode.NO_ESTIMATE)
GOAL_LEVELS = {
    GoalState.HELD_BACK: 'warn',
    GoalState.ENDED: 'warn',
    GoalState.REJECTED: 'error',
}


def correction_outcome(
    compensator: Compensator, now: float, fault: str
) -> tuple[str, str]:
    """Return level and message at a time [s]; `fault` is the fault of the inputs."""
    correction = compensator.correction
    mode = correction.mode
    text = mode.value
    if mode in UNESTIMATED:
        text = f'{text}: {correction.silence_cause(now)}'
    addition = fault or compensator.held_back.message(now)
    level = 'warn' if addition or mode in UNCORRECTED else 'ok'
    if fault or mode is CorrectionMode.SILENT:
        level = 'error'
    return level, joined(text, addition)


def correction_component(
    compensator: Compensator, now: float, fault: str, left_out: tuple[float, float]
) -> Component:
    """Return the component of the correction; `left_out` is height and tilt [m, rad]."""
    correction, lag = compensator.correction, compensator.following.lag
    horizon, newest = compensator.settings.horizon, compensator.newest
    values: dict[str, Any] = {
        'horizon [ms]': 1e3 * horizon,
        'age of the estimate [ms]': 1e3 * correction.age(now),
        'lag of the head [ms]': 1e3 * lag,
        'initialisations': compensator.initialisations,
    }
    if any(left_out):
        values['left out of the estimate'] = (
            f'z {1e3 * left_out[0]:+z.1f} mm, tilt {math.degrees(left_out[1]):.2f} deg'
        )
    if newest is not None:
        values['corrected disturbance'] = millimetres(newest.disturbance)
        values['saturation error'] = millimetres(newest.saturation_error)
    if deviations := correction.deviations(now + horizon + lag):
        values['standard deviation of the prediction'] = '; '.join(
            f'{axis} {scale * deviation:.2g} {unit}'
            for (axis, scale, unit), deviation in zip(
                POSE_AXES, deviations, strict=True
            )
        )
    return 'correction', *correction_outcome(compensator, now, fault), values


def contact_components(compensator: Compensator) -> list[Component]:
    """Return the component of the contact with the wall, empty while contact is disabled."""
    contact, pressing = compensator.contact, compensator.contact.pressing
    if not (contact.lateral.enabled or pressing.settings.enabled):
        return []
    level = 'ok'
    if pressing.is_hindered:
        level = 'error' if pressing.reason else 'warn'
    return [
        (
            'contact',
            level,
            pressing.outcome,
            {
                **pressing_values(pressing),
                'zero of the force [N]': pressing.zero,
                'desired force at present [N]': pressing.desired,
                'moment on the wall [N m]': pressing.moment,
                'reason of the last retract': pressing.last_reason or 'never',
                'shift of the goal': millimetres(contact.present),
            },
        )
    ]


def pressing_values(pressing: Pressing) -> dict[str, Any]:
    """Return the state and the force of the contact with the wall."""
    return {
        'pressing': pressing.outcome,
        'force on the wall [N]': pressing.monitor.force,
        'desired force [N]': pressing.settings.force,
        'bound of the force error [N]': pressing.bound,
    }


def late_reason(compensator: Compensator, now: float) -> str:
    """Return why a head whose path has ended is not at its goal, ``''`` if it is unknown."""
    if compensator.following.newest(now) is None:
        return (
            f'end_effector_pose is silent for more than {PATIENCE:g} s; next: check '
            'the ik_service and the publishers of joint_states'
        )
    return uncorrected_reason(compensator.correction, now)


def uncorrected_reason(correction: Correction, now: float) -> str:
    """Return why received estimates are not corrected, or soon not; ``''`` if they are."""
    if correction.is_silent(now):
        return (
            f'no valid estimate for more than {SILENCE:g} s, and the correction fades out after '
            f'{FADE_AFTER:g} s: {correction.silence_cause(now)}'
        )  # constant: a change is published
    if correction.mode is CorrectionMode.DISABLED and math.isfinite(
        correction.age(now)
    ):
        return 'the correction is disabled; next: call compensator/enable with true'
    return ''


class GoalReport:
    """
    Report of the newest goal: published on change, and periodically until the goal is reached.

    Parameters
    ----------
    publish : callable
        Publishes a component on compensator/goal_status.
    compensator : Compensator
    warn : callable
        Logs a warning.

    """

    def __init__(
        self,
        publish: Callable[[Component], None],
        compensator: Compensator,
        warn: Callable[[str], object],
    ) -> None:
        self._publish, self._compensator, self._warn = publish, compensator, warn
        self.watch = ArrivalWatch(ArrivalSettings())
        self.stamp = ''  #: stamp of the followed goal in seconds, ``''`` for no goal
        self._rejected: dict[
            str, str
        ] = {}  # stamp and reason of the last rejected goal
        self._published: tuple[GoalState | None, str] = (None, '')
        self._next = -math.inf
        self._last: Component | None = None

    def accept(self, stamp: str) -> None:
        """Report on another goal from now on; it supersedes the previous goal."""
        if stamp != self.stamp:
            self.end(NEWER_GOAL, GoalState.SUPERSEDED)
        self.stamp, self._rejected = stamp, {}
        self.watch.begin()
        self.send(stamp, GoalProgress(GoalState.ACCEPTED), '')

    def reject(self, stamp: str, reason: str) -> None:
        """Report the reason of a rejected goal; the report on the followed goal continues."""
        self._rejected = {'rejected goal stamp': stamp, 'rejection': reason}
        self.send(stamp, GoalProgress(GoalState.REJECTED), reason)

    def repeat(self) -> None:
        """Publish the last report again, because its goal was sent again."""
        if self._last is not None:
            self._publish(self._last)

    def supersede(self, stamp: str) -> None:
        """Report that a newer goal has replaced a goal that was not yet accepted."""
        self.send(stamp, GoalProgress(GoalState.SUPERSEDED), NEWER_GOAL)

    def end(self, reason: str, state: GoalState = GoalState.ENDED) -> None:
        """Report why a goal is no longer followed; a reached goal is not superseded."""
        was_reached = self._published[0] is GoalState.REACHED
        if self.stamp and not (was_reached and state is GoalState.SUPERSEDED):
            self.send(self.stamp, GoalProgress(state), reason)
        self.stamp = ''

    def update(self, now: float) -> None:
        """Publish a change at once, and the distance to the goal [m] every `GOAL_PERIOD`."""
        compensator, pressing = self._compensator, self._compensator.contact.pressing
        if not self.stamp or compensator.goal is None:
            return
        reason = compensator.held_back.message(now)
        path_time = compensator.path_time(now)
        progress = self.watch.update(
            now,
            compensator.goal_error(now),
            path_time,
            bool(reason) or pressing.is_hindered,
            pressing.is_held,
        )
        if not pressing.is_held:
            reason = joined(reason, pressing.outcome)
        is_late = path_time < -ARRIVAL_TIME
        is_near = (
            progress.time_to_go < self.watch.settings.dwell
        )  # the dwell time has begun
        if (
            is_late
            and not (reason or is_near)
            and (reason := late_reason(compensator, now))
        ):
            progress = progress._replace(state=GoalState.HELD_BACK)
            if self._published[0] is not GoalState.HELD_BACK:
                self._warn(f'goal held back: {reason}')
        is_due = (
            not self._next - GOAL_PERIOD <= now < self._next
        )  # or the clock was set back
        is_moving = progress.state is not GoalState.REACHED
        if self._published != (progress.state, reason) or is_due and is_moving:
            self._next = now + GOAL_PERIOD
            self.send(self.stamp, progress, reason)

    def send(self, stamp: str, progress: GoalProgress, reason: str) -> None:
        """Publish the progress of a goal by its stamp, and the reason of its state."""
        state, goal = progress.state, self._compensator.goal
        if state is not GoalState.REJECTED:
            self._published = state, reason
        pressing = self._compensator.contact.pressing
        values = {
            'goal stamp': stamp,
            'state': state.value,
            'distance [mm]': 1e3 * progress.distance,
            'angle [deg]': math.degrees(progress.angle),
            'time to go [s]': progress.time_to_go,
            'reason': reason,
            **(pressing_values(pressing) if pressing.settings.enabled else {}),
        }
        if goal is not None:
            values |= {
                'followed x [mm]': 1e3 * goal.x,
                'followed y [mm]': 1e3 * goal.y,
                'followed angle [deg]': math.degrees(goal.theta),
            }
        self._last = (
            'goal',
            GOAL_LEVELS.get(state, 'ok'),
            _outcome(state, reason),
            values | self._rejected,
        )
        self._publish(self._last)


def _outcome(state: GoalState, reason: str) -> str:
    """Return state and reason; a reason that begins with the state is the outcome."""
    if not reason or reason.startswith(state.value):
        return reason or state.value
    return f'{state.value}: {reason}'
