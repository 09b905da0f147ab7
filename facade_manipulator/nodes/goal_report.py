"""What becomes of the goal that the compensator follows, on compensator/goal_status."""

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
from facade_manipulator.nodes import compensator_report
from facade_manipulator.ros.diagnostics import goal_status, RejectedGoal

GOAL_PERIOD = 0.2  # s, between messages about the goal while the head moves


class GoalReport:
    """
    Publish the progress of the newest goal, on change and while it is not reached.

    Parameters
    ----------
    publish : callable
        Takes a message of compensator/goal_status.
    compensator : Compensator
    held_back : HeldBack

    """

    def __init__(
        self, publish: Callable[[DiagnosticStatus], None], compensator: Compensator,
        held_back: HeldBack,
    ) -> None:
        self._send, self._compensator, self._held_back = publish, compensator, held_back
        self.watch = ArrivalWatch(ArrivalSettings())
        self.stamp: Time | None = None  #: of the goal that is followed
        self._rejected: RejectedGoal | None = None
        self._published: tuple[GoalState | None, str] = (None, '')
        self._next = -math.inf

    def accept(self, stamp: Time) -> None:
        """Report on another goal from now on; the one before is superseded."""
        if stamp != self.stamp:
            self.end('a newer goal came', GoalState.SUPERSEDED)
        self.stamp, self._rejected = stamp, None
        self.watch.begin()
        self._publish(GoalProgress(GoalState.ACCEPTED), '')

    def reject(self, stamp: Time, reason: str) -> None:
        """Say why a goal is not followed; the one before, if any, is reported on further."""
        self._rejected = RejectedGoal(stamp, reason)
        self._say(stamp, GoalProgress(GoalState.REJECTED), reason)

    def end(
        self, reason: str, state: GoalState = GoalState.ENDED
    ) -> None:
        """Say why the goal that was followed is not followed any more."""
        if self.stamp is not None:
            was_reached = self._published[0] is GoalState.REACHED
            if not was_reached or state is not GoalState.SUPERSEDED:
                self._say(self.stamp, GoalProgress(state), reason)
            self.stamp = None

    def update(self, now: float) -> None:
        """Publish what has changed, and where the head is now and then."""
        if self.stamp is None or self._compensator.goal is None:
            return
        pressing, held_back = self._compensator.contact.pressing, self._held_back.message(now)
        progress = self.watch.update(
            now, self._compensator.goal_error(now), self._compensator.path_time(now),
            bool(held_back or pressing.reason), pressing.is_held)
        if not pressing.is_held:
            held_back = '; '.join(filter(None, (held_back, pressing.outcome)))
        due = not self._next - GOAL_PERIOD <= now < self._next  # or the clock was set back
        is_still = progress.state is GoalState.REACHED
        if self._published != (progress.state, held_back) or due and not is_still:
            self._next = now + GOAL_PERIOD
            self._publish(progress, held_back)

    def _publish(self, progress: GoalProgress, reason: str) -> None:
        self._published = progress.state, reason
        self._say(self.stamp, progress, reason)

    def _say(self, stamp: Time, progress: GoalProgress, reason: str) -> None:
        pressing = self._compensator.contact.pressing
        self._send(goal_status(
            stamp, progress, reason, self._compensator.goal, self._rejected,
            compensator_report.pressing_values(pressing) if pressing.press.enabled else {}))
