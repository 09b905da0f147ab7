"""compensator/goal_status: the progress of the newest goal."""

from __future__ import annotations

from collections.abc import Callable
import math

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.compensation.following import (
    ArrivalSettings,
    ArrivalWatch,
    GoalProgress,
    GoalState,
    HeldBack,
)
from facade_manipulator.messages import stamp_text
from facade_manipulator.nodes.compensator_report import pressing_values
from facade_manipulator.nodes.diagnostics import diagnostic_status

GOAL_PERIOD = 0.2  # s, between two messages while the head moves
LEVELS = {GoalState.HELD_BACK: 'warn', GoalState.ENDED: 'warn', GoalState.REJECTED: 'error'}


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
            'goal', LEVELS.get(state, 'ok'),
            f'{state.value}: {reason}' if reason else state.value, values | self._rejected))
