"""
The compensation: a goal on the wall becomes the course of the head as the rail has to see it.

corrected = d⁻¹ ∘ reference, in SE(2), for the instant one horizon ahead; held within the limits of
motion, then led in at the border of the workspace, so that nothing can lead it out again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from facade_manipulator.control.blend import Blend, Course, NOWHERE
from facade_manipulator.control.border import Border, BorderSettings
from facade_manipulator.control.contact import Contact
from facade_manipulator.control.correction import Correction, CorrectionSettings, LONGEST_PAUSE
from facade_manipulator.control.estimate import EstimateGate, EstimateSettings
from facade_manipulator.control.following import Following, FollowingSettings
from facade_manipulator.control.impedance import ImpedanceSettings, YawImpedanceSettings
from facade_manipulator.control.lateral import LateralSettings
from facade_manipulator.control.reference import Motion, Reference, ReferenceSettings
from facade_manipulator.control.tracker import Tracker
from facade_manipulator.kinematics import certify, Geometry, Pose, Wrench
from facade_manipulator.kinematics.planar import add, compose, relative, subtract
from facade_manipulator.parameters import check_parameters, parameter
from facade_manipulator.prediction import PredictionSettings

BORDER_TIME = 0.2  # s, time constant of the way to a new border
LONGEST_INTERVAL = 0.1  # s, a pause counts as no longer


@dataclass(frozen=True)
class CompensationSettings:
    """How far ahead and how fast the compensation moves the head."""

    horizon: float = parameter(
        0.06, 'How far ahead of its publication a corrected pose is meant', unit='s',
        minimum=0.005, maximum=0.5, read_only=True)
    min_conditioning: float = parameter(
        0.05, 'Least local conditioning index of a corrected pose', minimum=0.0, maximum=1.0)
    speed: tuple[float, ...] = parameter(
        (0.45, 0.4, 1.2), 'Highest speed of the head along the rail: x, y, theta',
        unit='m/s, rad/s', minimum=1e-3, maximum=10.0, elements=Pose._fields)
    acceleration: tuple[float, ...] = parameter(
        (2.8, 2.5, 7.0), 'Highest acceleration of the head along the rail: x, y, theta',
        unit='m/s^2, rad/s^2', minimum=1e-2, maximum=100.0, elements=Pose._fields)

    def __post_init__(self) -> None:
        check_parameters(self)


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
        Where on the wall the head should be then, in frame facade: on its way to the goal.
    shifted : Pose
        The same with what the contact with the wall shifts it by.
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
    shifted: Pose
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
    following: FollowingSettings = FollowingSettings()
    lateral: LateralSettings = LateralSettings()
    impedance: ImpedanceSettings = ImpedanceSettings()
    yaw_impedance: YawImpedanceSettings = YawImpedanceSettings()


DEFAULTS = CompensatorSettings()


class Compensator:
    """
    Turn goals, estimates of the disturbance and what the head meets into corrected poses.

    Parameters
    ----------
    geometry : Geometry
    settings : CompensatorSettings

    Attributes
    ----------
    correction : Correction
        What is corrected at present, and whether.
    contact : Contact
        What the wall shifts the goal by.
    following : Following
        How the head follows.
    goal : Pose or None
        Where on the wall the head is to rest.
    anchors : int
        How often the course began anew.

    """

    def __init__(self, geometry: Geometry, settings: CompensatorSettings = DEFAULTS) -> None:
        self.geometry = geometry
        self.settings = settings.compensation
        self.correction = Correction(settings.correction, settings.prediction)
        self.contact = Contact(
            settings.lateral, settings.impedance, settings.yaw_impedance)
        self.following = Following(settings.following)
        self.goal: Pose | None = None
        self.anchors = 0
        self._gate = EstimateGate(settings.estimate)
        self._reference = Reference(settings.reference)
        self._border = Border(geometry, settings.border)
        self._tracker = Tracker(self.settings.speed, self.settings.acceleration)
        self._planned_goal: Pose | None = None
        self._last: CorrectedPose | None = None
        self._rest = Blend(settings.correction.blend_acceleration)
        self._changes = {
            'compensation': self._change_motion,
            'estimate': self._gate.change_settings,
            'prediction': self.correction.change_prediction,
            'border': self._change_border,
        }
        self._parts = {
            'correction': self.correction,
            'reference': self._reference,
            'following': self.following,
            'lateral': self.contact.lateral,
            'impedance': self.contact.press,
            'yaw_impedance': self.contact.turn,
        }

    def change(self, part: str, settings: Any) -> None:
        """
        Go on with other settings of one part; the head does not jump.

        Parameters
        ----------
        part : str
            A field of `CompensatorSettings`.
        settings : object
            Of the class of that field. A new prediction learns anew: the correction fades out
            and in again. A new reference holds from the next goal on.

        Raises
        ------
        ParameterError
            If a border leaves no workspace; the one before stays.

        """
        if part in self._changes:
            self._changes[part](settings)
        else:
            self._parts[part].settings = settings

    def _change_motion(self, settings: CompensationSettings) -> None:
        self.settings = settings
        self._tracker.change_limits(settings.speed, settings.acceleration)

    def _change_border(self, settings: BorderSettings) -> None:
        border, last = Border(self.geometry, settings), self._last
        if last is not None:  # lead from the pose inside the old border to that inside the new
            rest = self._rest.at(last.time).place
            led = subtract(add(last.pose, last.excess), rest)
            here, there = Course(last.pose, NOWHERE), Course(border.lead_in(led).pose, NOWHERE)
            self._rest.begin(last.time, here.minus(there), BORDER_TIME)
        self._border = border

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
        self.following.take(stamp, pose)

    def take_wrench(self, now: float, stamp: float, wrench: Wrench) -> None:
        """
        Learn from a wrench of the wall on the head, in the head's frame, at a stamp [s].

        Raises
        ------
        InputError
            If it cannot be believed.

        """
        self.contact.take_wrench(now, stamp, wrench)

    def take_lateral_offset(self, now: float, stamp: float, offset: float) -> None:
        """
        Learn where the head should be, seen from it along the wall [m], at a stamp [s].

        Raises
        ------
        InputError
            If it cannot be believed.

        """
        self.contact.take_lateral_offset(now, stamp, offset)

    def update(self, now: float) -> CorrectedPose | None:
        """
        Return the corrected pose for one horizon ahead, None before there is a goal.

        Parameters
        ----------
        now : float
            Present time [s]; later than at the update before. If the clock is set, the course
            begins anew.

        """
        time = now + self.settings.horizon
        if self._last is not None and (
                not -LONGEST_INTERVAL <= time - self._last.time <= LONGEST_PAUSE):
            self._last = None  # the clock was set: begin anew
        aim = time + self.following.lag
        disturbance = self.correction.at(now, aim).place
        if self.goal is None:
            return None
        if self._last is None or self.following.lost(now):
            self._anchor(now, aim, disturbance)
        elif self.goal != self._planned_goal:
            self._reference.retarget(aim, self.goal)
        self._planned_goal = self.goal
        self._last = self._corrected(now, time, self._reference.at(aim).place, disturbance)
        return self._last

    def _corrected(
        self, now: float, time: float, reference: Pose, disturbance: Pose
    ) -> CorrectedPose:
        interval, excess = 0.0, NOWHERE
        if self._last is not None:
            interval = min(max(time - self._last.time, 0.0), LONGEST_INTERVAL)
            excess = self._last.excess
        shifted = self.contact.shift(now, time, interval, reference, excess)
        wanted = relative(disturbance, shifted)
        tracked = self._tracker.step(time, wanted)
        inside = self._border.lead_in(tracked, math.tan(disturbance.theta))
        rest = self._rest.at(time).place
        pose = add(inside.pose, rest)
        self.following.publish(time, pose)
        return CorrectedPose(
            time, pose, reference, shifted, disturbance, inside.excess, self._tracker.behind)

    def _anchor(self, now: float, aim: float, disturbance: Pose) -> None:
        """Begin the course where the head stands, or at the goal if it is not seen."""
        self._tracker.reset()
        self.following.begin(now)
        self.anchors += 1
        head = self.following.head(now)
        start = self.goal
        if head is not None:
            start = subtract(compose(disturbance, head), self.contact.present)
        self._reference.anchor(aim, Motion(start), self.goal)
