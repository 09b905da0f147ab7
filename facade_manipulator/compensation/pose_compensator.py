"""
Compensator: converts a goal on the wall to the path of the head in the frame of the rail.

corrected = d⁻¹ ∘ reference, in SE(2), for one horizon ahead plus the lag of the head, saturated at
the workspace limit. d is the predicted disturbance; the reference is the jerk-limited path to the
goal.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from facade_manipulator.compensation.contact import Contact, LateralSettings
from facade_manipulator.compensation.contact_phases import ContactSettings, Surroundings
from facade_manipulator.compensation.correction import (
    Correction,
    CorrectionMode,
    CorrectionSettings,
    ESTIMATOR_SILENCE,
    LONGEST_PAUSE,
)
from facade_manipulator.compensation.following import Following
from facade_manipulator.compensation.held_back import HeldBack
from facade_manipulator.compensation.workspace_limit import WorkspaceLimit
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Mechanism, Pose, ZERO_POSE
from facade_manipulator.kinematics.planar import (
    add,
    compose,
    difference,
    relative,
    subtract,
)
from facade_manipulator.motion.head_path import (
    HeadMotion,
    ReferencePath,
    ReferenceSettings,
)
from facade_manipulator.parameters import parameter, ParameterSource, settings
from facade_manipulator.prediction.estimate import EstimateGate, EstimateSettings


@settings
class CompensationSettings:
    """Settings of the compensation: rate of corrected poses, and their lead time."""

    DRIVE_LAG = 0.015  # s, controller.drive_lag of the shipped parameters
    TRANSPORT = 0.01  # s, from a corrected pose to the cycle that uses its setpoint

    rate: float = parameter(
        'Rate of corrected poses, at least 2 / stream.stale_after',
        default=100.0,
        unit='Hz',
        minimum=10.0,
        maximum=1000.0,
    )
    horizon: float = parameter(
        'Time from the publication of a corrected pose to its instant; 0: computed from rate',
        default=0.0,
        unit='s',
        minimum=0.0,
        maximum=0.5,
    )

    @property
    def lead(self) -> float:
        """
        Return the lead time of corrected poses [s].

        Without a set horizon, the lead time is the delay of the commands: two periods, the lag of
        the drives, and the time until a setpoint is read. The drives latch a target at the next
        SYNC, and interpolate to it for one more period. A setpoint that is read later is
        extrapolated.
        """
        return self.horizon or 2.0 / self.rate + self.DRIVE_LAG + self.TRANSPORT


class CorrectedPose(NamedTuple):
    """Corrected pose of the head in frame rail, and the terms from which it was computed."""

    time: float  #: instant of the command [s]
    reach_time: float  #: instant at which the head reaches the pose, after its lag [s]
    pose: Pose  #: in frame rail
    reference: Pose  #: path to the goal at `reach_time`, in frame facade
    disturbance: (
        Pose  #: corrected disturbance at `reach_time`: frame rail in frame facade
    )
    saturation_error: Pose  #: removed from each axis at the workspace limit [m, m, rad]


class CompensatorSettings(NamedTuple):
    """Settings of all components of the compensator."""

    compensation: CompensationSettings = CompensationSettings()
    estimate: EstimateSettings = EstimateSettings()
    correction: CorrectionSettings = CorrectionSettings()
    reference: ReferenceSettings = ReferenceSettings()
    contact: ContactSettings = ContactSettings()
    lateral: LateralSettings = LateralSettings()

    @classmethod
    def read(cls, source: ParameterSource) -> CompensatorSettings:
        """Read the parameters of all components."""
        return cls(
            compensation=source.read(CompensationSettings),
            estimate=source.read(EstimateSettings, 'estimate'),
            correction=source.read(CorrectionSettings, 'correction'),
            reference=source.read(ReferenceSettings, 'reference'),
            contact=source.read(ContactSettings, 'contact'),
            lateral=source.read(LateralSettings, 'lateral'),
        )


class Compensator:
    """Compensator: computes corrected poses from goals, estimates and contact measurements."""

    LONGEST_INTERVAL = 0.1  # s, a longer pause counts as this interval

    def __init__(self, geometry: Geometry, settings: CompensatorSettings) -> None:
        self._mechanism = Mechanism(geometry)
        self.settings = settings.compensation
        #: present correction and its mode
        self.correction = Correction(settings.correction)
        #: shift of the goal by the wall; receives the measurements at the wall
        self.contact = Contact(settings.contact, settings.lateral)
        #: tracking of the path; receives measured head poses
        self.following = Following()
        self.goal: Pose | None = None  #: final pose of the head on the wall
        self._is_goal_new = False  # whether no cycle has followed the goal yet
        self.initialisations = 0  #: number of times the path began at the head
        self.gate = EstimateGate(settings.estimate)
        self._reference = ReferencePath(settings.reference)
        self._workspace = WorkspaceLimit(geometry, settings.reference.min_conditioning)
        self.newest: CorrectedPose | None = None  #: None while no goal is followed
        self.held_back = HeldBack()  #: limits that hold axes of the head back

    def change_contact(self, settings: ContactSettings) -> None:
        """Change the live parameters of the contact, without a jump of the pose."""
        self.contact.pressing.change_settings(settings)

    def change_lateral(self, settings: LateralSettings) -> None:
        """Change the live parameters of the lateral offset, without a jump of the pose."""
        self.contact.lateral = settings

    def set_goal(self, goal: Pose) -> None:
        """
        Begin to move to a goal on the wall.

        Raises a LimitError if the goal is outside the workspace even in still air; the previous
        goal stays.
        """
        self.require_inside(goal)
        self.goal = goal
        self._is_goal_new = True

    def require_inside(self, goal: Pose) -> None:
        """Raise a LimitError if a goal is outside the workspace of an undisturbed rail."""
        self._mechanism.certify(goal, self._reference.settings.min_conditioning)

    def drop_goal(self) -> None:
        """
        Drop the goal and end pressing; `update` then returns None.

        The path to the next goal begins at the head's pose.
        """
        self.goal = None
        self.newest = None
        self.contact.pressing.end()

    def hold(self, now: float) -> Pose | None:
        """
        End the path to the goal; return the pose on the wall at which the path stops [m, m, rad].

        A head that presses, or approaches the wall to press, retracts and waits there for the next
        goal. Without a path, because no cycle has followed the goal yet, drop the goal and return
        None.

        Raises a ManipulatorError if there is no goal, or no path to rest. Without a path to rest,
        the goal is dropped.
        """
        if self.goal is None:
            raise ManipulatorError(
                'hold rejected: the head follows no goal; next: send a goal'
            )
        if self.newest is None:
            self.drop_goal()
            return None
        self.contact.pressing.end()
        self._is_goal_new = False  # a goal that no cycle has followed is never followed
        begin = max(self.newest.time, now + self.settings.lead) + self.following.lag
        try:
            self.goal = self._reference.stop(begin)
        except ManipulatorError as error:
            self.drop_goal()
            raise ManipulatorError(
                f'hold failed: {error.problem}; the goal was dropped, and the carriages brake; '
                'next: check that the head is at rest'
            ) from error
        return self.goal

    def goal_error(self, now: float) -> Pose | None:
        """
        Return the goal, shifted by the contact, minus the head's pose on the wall [m, m, rad].

        Return None without a goal, without a recent pose of the head, or while the pose of the
        rail is unknown. The pose of the rail is unknown while the estimates are silent or an axis
        is not usable. Before the first estimate the rail counts as at rest.
        """
        newest = self.following.newest(now)
        if newest is None or self.goal is None:
            return None
        correction = self.correction
        if correction.is_silent(now) or not all(correction.usable):
            return None
        stamp, head = newest
        on_wall = compose(correction.disturbance(stamp), head)
        return difference(add(self.goal, self.contact.lasting_shift), on_wall)

    def path_time(self, now: float) -> float:
        """
        Return the remaining time of the path to the goal [s]; infinite without a path.

        While a disabled lateral shift returns to 0, the path lasts at least until its return.
        """
        if self.newest is None or self.goal != self._reference.goal:
            return math.inf
        remaining = self._reference.arrival() - now
        release_time = self.contact.release_time
        return max(remaining, release_time) if release_time else remaining

    def add_estimate(
        self,
        now: float,
        stamp: float,
        pose: Pose,
        variances: Sequence[float],
        tilt: float = 0.0,
    ) -> None:
        """
        Learn from an estimate of the disturbance; see `EstimateGate.check` for the arguments.

        Raises an InputError if the estimate is impossible.
        """
        self.correction.add_estimate(self.gate.check(now, stamp, pose, variances, tilt))

    def update(self, now: float) -> CorrectedPose | None:
        """
        Return the corrected pose for one horizon ahead; None without a goal.

        The present time [s] is later than at the previous update; if the clock was set, the path
        begins again.
        """
        time = now + self.settings.lead
        if self.newest is not None and (
            not -self.LONGEST_INTERVAL <= time - self.newest.time <= LONGEST_PAUSE
        ):
            self.newest = None  # the clock was set: begin again
        reach_time = time + self.following.lag
        disturbance = self.correction.at(now, reach_time).position
        goal = self.goal
        if goal is None:
            return None

        if self._is_goal_new:
            self._is_goal_new = False
            self._begin_goal(reach_time, goal)
        is_off_path = self.following.is_off_path(now)
        if is_off_path:
            self.held_back.note_off_path(now)
        if self.newest is None or is_off_path:
            self._initialise(now, reach_time, disturbance, goal)
        elif goal != self._reference.goal:
            self._reference.retarget(reach_time, goal)
        reference = self._reference.at(reach_time).position

        interval = 0.0
        if self.newest is not None:
            interval = min(max(time - self.newest.time, 0.0), self.LONGEST_INTERVAL)
        shifted = self._shift(now, reach_time, interval, reference, disturbance, goal)
        pose, error = self._workspace.saturate(
            relative(disturbance, shifted), math.tan(disturbance.theta)
        )

        self.following.publish(time, pose)
        uncertain = Pose(*(float(not one) for one in self.correction.usable))
        self.held_back.note(now, error, uncertain)
        self.newest = CorrectedPose(
            time, reach_time, pose, reference, disturbance, error
        )
        return self.newest

    def _shift(
        self,
        now: float,
        reach_time: float,
        interval: float,
        reference: Pose,
        disturbance: Pose,
        goal: Pose,
    ) -> Pose:
        """Return the reference pose [m, m, rad] shifted by the contact."""
        saturation_error = ZERO_POSE
        if self.newest is not None:
            saturation_error = self.newest.saturation_error

        silence = ''
        if self.correction.is_silent(now):
            cause = self.correction.silence_cause(now)
            silence = (
                f'no valid estimate for more than {ESTIMATOR_SILENCE:g} s: {cause}'
            )
        elif self.correction.mode is CorrectionMode.SETTLING:
            silence = self.correction.mode.value
        elif not all(self.correction.usable[1:]):
            silence = (
                'the estimate of y or theta is too uncertain; next: check the estimator'
            )

        surroundings = Surroundings(
            saturation_error,
            disturbance.y,
            silence,
            reference.y - goal.y,
            self.correction.fading.y,
        )
        return self.contact.shift(now, reach_time, interval, reference, surroundings)

    def _begin_goal(self, reach_time: float, goal: Pose) -> None:
        """Let the contact follow a new goal; the path takes over a shift that the contact ends."""
        before = self.contact.present
        self.contact.pressing.follow_goal()
        ended = subtract(before, self.contact.present)
        if self.newest is not None and any(ended):
            motion = self._reference.at(reach_time)
            start = motion._replace(position=add(motion.position, ended))
            self._reference.initialise(reach_time, start, goal)

    def _initialise(
        self, now: float, reach_time: float, disturbance: Pose, goal: Pose
    ) -> None:
        """Start the path at the head's pose; at the goal if the head's pose is unknown."""
        self.following.begin(now)
        self.initialisations += 1
        start = goal
        newest = self.following.newest(now)
        if newest is not None:
            _, head = newest
            start = subtract(compose(disturbance, head), self.contact.present)
        self._reference.initialise(reach_time, HeadMotion(start), goal)
