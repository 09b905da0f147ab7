"""`compensator/goal_status`: what becomes of a goal, for the supervisor who sent it."""

from __future__ import annotations

from collections.abc import Callable
import math

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from facade_manipulator.compensation import (
    ArrivalSettings,
    ArrivalWatch,
    Compensator,
    GoalProgress,
    GoalState,
)
from facade_manipulator.kinematics import Pose
from facade_manipulator.ros import declare, diagnostic_status, LATCHED, stamp_text

GOAL_STATUS = 'compensator/goal_status'
HOLD = 'compensator/hold was called'
PERIOD = 0.2  # s, between messages while the head moves
FOLLOWED = {  # key of the goal that is followed, and its factor
    'followed x [mm]': 1e3, 'followed y [mm]': 1e3, 'followed angle [deg]': math.degrees(1.0)}
LEVELS = {GoalState.HELD_BACK: 'warn', GoalState.REJECTED: 'error'}


class GoalReport:
    """
    Publish the progress of the newest goal, on change and while it is not reached.

    Parameters
    ----------
    node : rclpy.node.Node
    compensator : Compensator
    held_back : callable
        Takes the time [s], returns what holds the head back; '' if nothing does.

    """

    def __init__(
        self, node: Node, compensator: Compensator, held_back: Callable[[float], str]
    ) -> None:
        self._compensator, self._held_back = compensator, held_back
        self._watch = ArrivalWatch(declare(
            node, ArrivalSettings, 'arrival',
            lambda settings: setattr(self._watch, 'settings', settings)))
        self._publisher = node.create_publisher(DiagnosticStatus, GOAL_STATUS, LATCHED)
        self._stamp = ''
        self._is_open = False
        self._published: tuple[GoalState | None, str] = (None, '')
        self._next = -math.inf

    def accept(self, stamp: Time) -> None:
        """Report on another goal from now on."""
        self._stamp, self._is_open = stamp_text(stamp), True
        self._watch.begin()
        self._publish(GoalProgress(GoalState.ACCEPTED), '')

    def reject(self, stamp: Time, reason: str) -> None:
        """Say why a goal is not followed; the one before, if any, is reported on further."""
        self._send(stamp_text(stamp), GoalProgress(GoalState.REJECTED), reason)

    def end(self, reason: str) -> None:
        """Say why the goal that was followed is not followed any more."""
        if self._is_open:
            self._is_open = False
            self._publish(GoalProgress(GoalState.REJECTED), reason)

    def update(self, now: float) -> None:
        """Publish what has changed, and where the head is now and then."""
        if not self._is_open or self._compensator.goal is None:
            return
        held_back = self._held_back(now)
        progress = self._watch.update(
            now, self._compensator.goal_error(now), self._compensator.path_time(now),
            bool(held_back))
        due = now >= self._next or now < self._next - PERIOD  # or the clock was set back
        is_still = progress.state is GoalState.REACHED
        if self._published != (progress.state, held_back) or due and not is_still:
            self._next = now + PERIOD
            self._publish(progress, held_back)

    def _publish(self, progress: GoalProgress, reason: str) -> None:
        self._published = progress.state, reason
        self._send(self._stamp, progress, reason)

    def _send(self, stamp: str, progress: GoalProgress, reason: str) -> None:
        values = {
            'goal stamp': stamp,
            'state': progress.state.value,
            'distance [mm]': 1e3 * progress.distance,
            'angle [deg]': math.degrees(progress.angle),
            'time to go [s]': progress.time_to_go,
            'reason': reason,
            **_followed_values(self._compensator.goal),
        }
        message = f'{progress.state.value}: {reason}' if reason else progress.state.value
        self._publisher.publish(diagnostic_status(
            'goal', LEVELS.get(progress.state, 'ok'), message, values))


def _followed_values(goal: Pose | None) -> dict[str, float]:
    return {} if goal is None else {
        key: scale * value for (key, scale), value in zip(FOLLOWED.items(), goal, strict=True)}


def followed_goal(status: DiagnosticStatus) -> Pose | None:
    """Return the goal that is followed when a goal_status is sent, None if there is none."""
    values = {item.key: item.value for item in status.values}
    if FOLLOWED.keys() <= values.keys():
        return Pose(*(float(values[key]) / scale for key, scale in FOLLOWED.items()))
    return None
