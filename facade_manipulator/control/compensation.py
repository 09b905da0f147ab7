"""
The compensation: a goal on the wall becomes the course of the head as the rail has to see it.

corrected = d⁻¹ ∘ reference, in SE(2), for the instant one horizon ahead; led in at the border of
the workspace and held within the limits of motion.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

from facade_manipulator.control.blend import Course
from facade_manipulator.control.border import Border, BorderSettings
from facade_manipulator.control.correction import Correction, CorrectionSettings
from facade_manipulator.control.estimate import EstimateGate, EstimateSettings
from facade_manipulator.control.prediction import PredictionSettings
from facade_manipulator.control.reference import Motion, Reference, ReferenceSettings
from facade_manipulator.control.tracker import Tracker
from facade_manipulator.errors import InputError, ParameterError
from facade_manipulator.kinematics import certify, Geometry, Pose
from facade_manipulator.kinematics.planar import compose, inverse, wrap_angle
from facade_manipulator.parameters import check_parameters, parameter

KEPT_TIME = 2.0


@dataclass(frozen=True)
class CompensationSettings:
    """How far ahead and how fast the compensation moves the head."""

    horizon: float = parameter(
        0.06, 'How far ahead of its publication a corrected pose is meant', unit='s',
        minimum=0.005, maximum=0.5)
    min_conditioning: float = parameter(
        0.05, 'Least local conditioning index of a corrected pose', minimum=0.0, maximum=1.0)
    speed: tuple[float, ...] = parameter(
        (0.45, 0.4, 1.2), 'Highest speed of the head along the rail: x, y, theta',
        unit='m/s, rad/s', minimum=1e-3, maximum=10.0)
    acceleration: tuple[float, ...] = parameter(
        (2.8, 2.5, 7.0), 'Highest acceleration of the head along the rail: x, y, theta',
        unit='m/s^2, rad/s^2', minimum=1e-2, maximum=100.0)
    lost_distance: float = parameter(
        0.02, 'Distance of the head from the published course from which it is not following',
        unit='m', minimum=1e-3, maximum=1.0)
    lost_yaw: float = parameter(
        0.035, 'Yaw of the head from the published course from which it is not following',
        unit='rad', minimum=1e-3, maximum=1.0)
    lost_time: float = parameter(
        0.5, 'Time of not following after which the course begins anew at the head', unit='s',
        minimum=0.05, maximum=10.0)

    def __post_init__(self) -> None:
        check_parameters(self)
        for name in ('speed', 'acceleration'):
            if len(getattr(self, name)) != len(Pose._fields):
                raise ParameterError(
                    f'{name} has {len(getattr(self, name))} elements, expected 3: x, y, theta')


class CorrectedPose(NamedTuple):
    """
    What the head should do.

    Parameters
    ----------
    time : float
        The instant it is meant for [s].
    pose : Pose
        In frame rail.
    reference : Pose
        Where on the wall the head should be then, in frame facade.
    disturbance : Pose
        Disturbance that is corrected.
    excess : Pose
        By how much each axis is held back at the border of the workspace.
    behind : Pose
        By how much each axis is held back by the limits of motion.

    """

    time: float
    pose: Pose
    reference: Pose
    disturbance: Pose
    excess: Pose
    behind: Pose


class CompensatorSettings(NamedTuple):
    """Settings of the compensator's parts."""

    compensation: CompensationSettings = CompensationSettings()
    estimate: EstimateSettings = EstimateSettings()
    prediction: PredictionSettings = PredictionSettings()
    correction: CorrectionSettings = CorrectionSettings()
    reference: ReferenceSettings = ReferenceSettings()
    border: BorderSettings = BorderSettings()


DEFAULTS = CompensatorSettings()


class Compensator:
    """
    Turn goals, estimates of the disturbance and the head's place into corrected poses.

    Parameters
    ----------
    geometry : Geometry
    settings : CompensatorSettings

    Attributes
    ----------
    correction : Correction
        What is corrected at present, and whether.
    goal : Pose or None
        Where on the wall the head is to rest.
    anchors : int
        How often the course began anew.

    """

    def __init__(self, geometry: Geometry, settings: CompensatorSettings = DEFAULTS) -> None:
        self.geometry = geometry
        self.settings = settings.compensation
        self.correction = Correction(settings.correction, settings.prediction)
        self.goal: Pose | None = None
        self.anchors = 0
        self._gate = EstimateGate(settings.estimate)
        self._reference = Reference(settings.reference)
        self._border = Border(geometry, settings.border)
        self._tracker = Tracker(self.settings.speed, self.settings.acceleration)
        self._published: deque[tuple[float, Pose]] = deque()
        self._head: tuple[float, Pose] | None = None
        self._following_at = -math.inf
        self._planned_goal: Pose | None = None

    def take_goal(self, goal: Pose) -> None:
        """
        Head for a goal on the wall from now on.

        Raises
        ------
        LimitError
            If it is out of the workspace even in still air; the goal before stays.

        """
        certify(self.geometry, goal, self.settings.min_conditioning)
        self.goal = goal

    def take_estimate(
        self, now: float, stamp: float, pose: Pose, variances: Sequence[float]
    ) -> None:
        """
        Learn from an estimate of the disturbance.

        Raises
        ------
        InputError
            If it cannot be believed.

        """
        self.correction.take(self._gate.check(now, stamp, pose, variances))

    def take_head(self, stamp: float, pose: Pose) -> None:
        """
        Take where the head is, seen from the rail, at a stamp [s].

        Raises
        ------
        InputError
            If it is older than the one before.

        """
        if self._head is not None and stamp <= self._head[0]:
            raise InputError(
                'out_of_order', f'end_effector_pose is {self._head[0] - stamp:.3f} s older than '
                'the one before, expected a newer one')
        self._head = stamp, pose
        planned = self._planned_at(stamp)
        if planned is None or self._is_near(pose, planned):
            self._following_at = stamp

    def update(self, now: float) -> CorrectedPose | None:
        """
        Return the corrected pose for one horizon ahead, None before there is a goal.

        Parameters
        ----------
        now : float
            Present time [s]; later than at the update before.

        """
        time = now + self.settings.horizon
        disturbance = self.correction.at(now, time)
        if self.goal is None:
            return None
        if self._planned_goal is None or self._is_lost(now):
            self._anchor(now, time, disturbance)
        elif self.goal != self._planned_goal:
            self._reference.retarget(time, self.goal)
        self._planned_goal = self.goal
        return self._corrected(time, disturbance.place)

    def _corrected(self, time: float, disturbance: Pose) -> CorrectedPose:
        reference = self._reference.at(time).place
        wanted = compose(inverse(disturbance), reference)
        inside = self._border.lead_in(wanted)
        pose = self._tracker.step(time, inside.pose)
        self._keep(time, pose)
        return CorrectedPose(
            time, pose, reference, disturbance, inside.excess, self._tracker.behind)

    def _anchor(self, now: float, time: float, disturbance: Course) -> None:
        """Begin the course where the head stands, or at the goal if it was never seen."""
        self._tracker.reset()
        self._published.clear()
        self._following_at = now
        self.anchors += 1
        place = self.goal
        if self._head is not None and now - self._head[0] < self.settings.lost_time:
            place = compose(disturbance.place, self._head[1])
        self._reference.anchor(time, Motion(place), self.goal)

    def _keep(self, time: float, pose: Pose) -> None:
        self._published.append((time, pose))
        while self._published[0][0] < time - KEPT_TIME:
            self._published.popleft()

    def _planned_at(self, stamp: float) -> Pose | None:
        """Return what was published for about a stamp, None if nothing was."""
        for time, pose in reversed(self._published):
            if time <= stamp:
                return pose
        return None

    def _is_near(self, pose: Pose, planned: Pose) -> bool:
        distance = math.hypot(pose.x - planned.x, pose.y - planned.y)
        yaw = abs(wrap_angle(pose.theta - planned.theta))
        return distance < self.settings.lost_distance and yaw < self.settings.lost_yaw

    def _is_lost(self, now: float) -> bool:
        return (
            self._head is not None
            and self._head[0] - self._following_at > self.settings.lost_time
            and now - self._head[0] < self.settings.lost_time)
