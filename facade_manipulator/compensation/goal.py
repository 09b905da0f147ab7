"""Goal of the head on the wall, and the reports about its progress to a supervisor."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
import math
from typing import NamedTuple

from facade_manipulator.compensation.compensation_diagnostics import (
    Component,
    pressing_values,
)
from facade_manipulator.compensation.correction import (
    Correction,
    CorrectionMode,
    ESTIMATOR_SILENCE,
    FADE_AFTER,
)
from facade_manipulator.compensation.following import OFF_PATH_TIME
from facade_manipulator.compensation.pose_compensator import Compensator
from facade_manipulator.errors import joined
from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.parameters import parameter, settings


class Goal(NamedTuple):
    """Goal of the head on the wall."""

    pose: Pose  #: [m, m, rad]
    stamp: str  #: text of the stamp on compensator/goal_status [s]
    received: float  #: [s, monotonic]


class GoalState(Enum):
    """State of a goal; the values are published on compensator/goal_status."""

    NONE = 'none'  #: no goal was received
    WAITING = 'waiting'  #: for the status of the driver; not published
    ACCEPTED = 'accepted'
    MOVING = 'moving'
    HELD_BACK = 'held back'
    REACHED = 'reached'
    REJECTED = 'rejected'  #: never followed
    ENDED = 'ended'  #: no longer followed
    SUPERSEDED = 'superseded'  #: by a newer goal


@settings
class ArrivalSettings:
    """Settings of arrival: tolerances around the goal, and required duration within them."""

    distance: float = parameter(
        'Distance on the wall within which a goal is reached',
        default=0.005,
        unit='m',
        minimum=1e-4,
        maximum=0.1,
        live=True,
    )
    angle: float = parameter(
        'Angle within which a goal is reached',
        default=0.01,
        unit='rad',
        minimum=1e-4,
        maximum=0.5,
        live=True,
    )
    dwell: float = parameter(
        'Dwell time within both tolerances',
        default=0.2,
        unit='s',
        minimum=0.0,
        maximum=10.0,
        live=True,
    )


class Rejection(NamedTuple):
    """Rejected goal, identified by its stamp."""

    stamp: str
    reason: str


class Remaining(NamedTuple):
    """Remaining distance, angle and time to a goal; NaN if unknown."""

    distance: float = math.nan  #: of the measured head [m]
    angle: float = math.nan  #: of the measured head [rad]
    time: float = math.nan  #: until the path ends and the dwell time is over [s]


class GoalTracker:
    """
    Tracker of the newest goal, which publishes every change of its state.

    The node calls `receive` for a goal that is inside the workspace and is not a repetition. The
    goal then waits for `follow` or `refuse`, and a followed goal for `end`. The node calls
    `update` at 20 Hz, and `reject` for a goal that cannot be followed at all.

    Parameters
    ----------
    compensator : Compensator
        Moves the head to the followed goal.
    publish : callable
        Publishes a component on compensator/goal_status.
    warn : callable
        Logs a warning.

    Attributes
    ----------
    settings : ArrivalSettings
    state : GoalState
        State of the newest goal that was received.

    """

    GOAL_PERIOD = 0.2  # s, between two reports while the head moves
    LEAVING = 2.0  # times the tolerance: a larger error leaves a reached goal
    # s after its path, in which the head reaches a goal if nothing holds it back
    ARRIVAL_TIME = 1.0
    LATE = (
        f'the head is not at its goal {ARRIVAL_TIME:g} s after the end of its path; '
        'next: check /diagnostics'
    )
    NO_GOAL = 'no goal was received; next: send goal_pose'
    NEWER_GOAL = 'a newer goal was received'
    FOLLOWED = (
        GoalState.ACCEPTED,
        GoalState.MOVING,
        GoalState.HELD_BACK,
        GoalState.REACHED,
    )
    LEVEL_OF_STATE = {
        GoalState.HELD_BACK: 'warn',
        GoalState.ENDED: 'warn',
        GoalState.REJECTED: 'error',
    }
    UNKNOWN_REMAINDER = Remaining()

    def __init__(
        self,
        compensator: Compensator,
        publish: Callable[[Component], None],
        warn: Callable[[str], object],
    ) -> None:
        self._compensator = compensator
        self._publish = publish
        self._warn = warn
        self.settings = ArrivalSettings()
        self._goal = Goal(ZERO_POSE, '', -math.inf)  # before the first goal
        self.state = GoalState.NONE
        self._reason = self.NO_GOAL
        self._rejection: Rejection | None = None  # since a goal was followed last
        self._near_since = math.inf  # since when the head is near the goal [s]
        self._due = -math.inf  # time of the next report [s]
        # whether the rejection of another goal was published after the followed goal
        self._hides_followed = False
        self._repeat()

    @property
    def is_followed(self) -> bool:
        """Return whether the head follows the newest goal."""
        return self.state in self.FOLLOWED

    @property
    def is_in_force(self) -> bool:
        """Return whether the newest goal is followed or waits to be accepted or rejected."""
        return self.is_followed or self.state is GoalState.WAITING

    def answer_repetition(self, goal: Goal, has_stamp: bool) -> bool:
        """
        Answer a repetition of an earlier goal; return whether the goal is a repetition.

        Each stamp has one answer. After the goal was rejected or has ended, this answer is
        published again. A goal without a stamp repeats the newest goal while that goal waits or is
        followed.
        """
        newest = self._goal
        if not has_stamp:
            return self.is_in_force and goal.pose == newest.pose
        rejection = self._rejection
        is_rejected = rejection is not None and goal.stamp == rejection.stamp
        is_newest = goal.stamp == newest.stamp and goal.pose == newest.pose
        if self.is_in_force:
            return is_rejected or is_newest
        if rejection is not None and is_rejected:
            self._send(rejection.stamp, GoalState.REJECTED, rejection.reason)
        elif is_newest:
            self._repeat()
        return is_rejected or is_newest

    def receive(self, goal: Goal) -> None:
        """Store a goal that waits for its answer; it supersedes a goal that is not reached."""
        is_reached = self.state is GoalState.REACHED
        is_other = goal.stamp != self._goal.stamp
        if self.is_in_force and is_other and not is_reached:
            self._enter(GoalState.SUPERSEDED, self.NEWER_GOAL)
        self._goal = goal
        self.state = GoalState.WAITING

    def follow(self, goal: Goal) -> None:
        """Move the head to the waiting goal."""
        self._compensator.set_goal(goal.pose)
        self._rejection = None
        self._near_since = math.inf
        self._enter(GoalState.ACCEPTED, '')

    def refuse(self, reason: str) -> None:
        """Reject the goal that waits, because the drives do not follow it."""
        self._rejection = Rejection(self._goal.stamp, reason)
        self._enter(GoalState.REJECTED, reason)

    def reject(self, stamp: str, reason: str) -> None:
        """Reject a malformed goal or a goal outside the workspace; a followed goal continues."""
        if self.is_in_force and stamp == self._goal.stamp:
            return  # a repetition does not change the answer
        self._rejection = Rejection(stamp, reason)
        self._send(stamp, GoalState.REJECTED, reason)
        self._hides_followed = True

    def end(self, reason: str) -> None:
        """Report why the followed goal ends; the caller then stops the head."""
        if self.is_followed:
            self._enter(GoalState.ENDED, reason)

    def update(self, now: float) -> None:
        """
        Publish changes at once, and the distance every `GOAL_PERIOD` until arrival.

        A goal is also published after the rejection of another, for subscribers that join later.
        """
        if not self.is_followed:
            return
        remaining = self._measure_remaining(now)
        state, reason = self._present_state(now, remaining)
        is_changed = state is not self.state or reason != self._reason
        is_changed = is_changed or self._hides_followed
        # or the clock was set back
        is_due = not self._due - self.GOAL_PERIOD <= now < self._due
        if is_changed or (is_due and state is not GoalState.REACHED):
            self._due = now + self.GOAL_PERIOD
            self._enter(state, reason, remaining)

    def _measure_remaining(self, now: float) -> Remaining:
        """Return remaining distance, angle and time; record how long the head has been near."""
        distance = math.nan
        angle = math.nan
        error = self._compensator.goal_error(now)
        if error is not None:
            distance = math.hypot(error.x, error.y)
            angle = abs(error.theta)

        path_time = self._compensator.path_time(now)
        is_pressed = self._compensator.contact.pressing.is_force_reached
        if is_pressed and path_time <= 0.0 and self._is_near(distance, angle):
            self._near_since = min(self._near_since, now)
        else:
            self._near_since = math.inf
        dwelt = max(now - self._near_since, 0.0)
        dwell = max(self.settings.dwell - dwelt, 0.0)
        return Remaining(distance, angle, max(path_time, 0.0) + dwell)

    def _is_near(self, distance: float, angle: float) -> bool:
        """Return whether distance [m] and angle [rad] are within the tolerances."""
        factor = self.LEAVING if self.state is GoalState.REACHED else 1.0
        is_close = distance <= factor * self.settings.distance
        return is_close and angle <= factor * self.settings.angle

    def _present_state(self, now: float, remaining: Remaining) -> tuple[GoalState, str]:
        """
        Return the state of the followed goal, and the reason for this state.

        A goal is held back by a limit, by pressing that cannot reach its force, or for another
        reason after the path has ended. This other reason is logged unless the goal was held back
        before. While pressing has not reached its force, its phase is the only reason, also in
        state MOVING.
        """
        compensator = self._compensator
        pressing = compensator.contact.pressing
        reason = compensator.held_back.message(now)
        is_held_back = bool(reason) or pressing.is_hindered
        if not pressing.is_force_reached:
            reason = joined(reason, pressing.outcome)

        is_near = self._near_since < math.inf  # `_measure_remaining` has measured it
        if is_near and (self.state is GoalState.REACHED or remaining.time <= 0.0):
            return GoalState.REACHED, reason

        # the path time is negative after the end of the path
        is_late = compensator.path_time(now) < -self.ARRIVAL_TIME
        if is_late and not is_near and not reason:
            reason = late_reason(compensator, now)
            if reason and self.state is not GoalState.HELD_BACK:
                self._warn(f'goal held back: {reason}')
            reason = reason or self.LATE
            is_held_back = True
        return GoalState.HELD_BACK if is_held_back else GoalState.MOVING, reason

    def _enter(
        self, state: GoalState, reason: str, remaining: Remaining = UNKNOWN_REMAINDER
    ) -> None:
        """Change and publish the state of the newest goal."""
        self.state = state
        self._reason = reason
        self._hides_followed = False
        self._send(self._goal.stamp, state, reason, remaining)

    def _repeat(self) -> None:
        self._send(self._goal.stamp, self.state, self._reason)

    def _send(
        self,
        stamp: str,
        state: GoalState,
        reason: str,
        remaining: Remaining = UNKNOWN_REMAINDER,
    ) -> None:
        """Publish state and reason of the goal that a stamp identifies."""
        values = {
            'goal stamp': stamp,
            'state': state.value,
            'distance [mm]': 1e3 * remaining.distance,
            'angle [deg]': math.degrees(remaining.angle),
            'time to go [s]': remaining.time,
            'reason': reason,
        }
        pressing = self._compensator.contact.pressing
        if pressing.settings.enabled:
            values |= pressing_values(pressing)
        followed = self._compensator.goal
        if followed is not None:
            values |= {
                'followed x [mm]': 1e3 * followed.x,
                'followed y [mm]': 1e3 * followed.y,
                'followed angle [deg]': math.degrees(followed.theta),
            }
        if self._rejection is not None:
            values |= {
                'rejected goal stamp': self._rejection.stamp,
                'rejection': self._rejection.reason,
            }
        level = self.LEVEL_OF_STATE.get(state, 'ok')
        self._publish(('goal', level, _outcome(state, reason), values))


def _outcome(state: GoalState, reason: str) -> str:
    """Return state and reason as one text; a reason that begins with the state is sufficient."""
    if not reason or reason.startswith(state.value):
        return reason or state.value
    return f'{state.value}: {reason}'


def late_reason(compensator: Compensator, now: float) -> str:
    """Return why the head is not at its goal after the end of its path; ``''`` if unknown."""
    following = compensator.following
    if following.newest(now) is None:
        if rejection := following.rejections.message(now):
            return f'each end_effector_pose is rejected: {rejection}'
        return (
            f'end_effector_pose is silent for more than {OFF_PATH_TIME:g} s; next: check '
            'the ik_service and the publishers of joint_states'
        )
    return uncorrected_reason(compensator.correction, now)


def uncorrected_reason(correction: Correction, now: float) -> str:
    """Return the reason why the correction is off or about to end, or ``''``."""
    if correction.is_silent(now):
        # without a changing number, because each change of the text is published
        return (
            f'no valid estimate for more than {ESTIMATOR_SILENCE:g} s, and the correction '
            f'fades out after {FADE_AFTER:g} s: {correction.silence_cause(now)}'
        )
    if correction.mode is CorrectionMode.DISABLED and math.isfinite(
        correction.age(now)
    ):
        return 'the correction is disabled; next: call compensator/enable with true'
    return ''
