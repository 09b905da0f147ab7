"""
The compensation: a goal on the wall becomes the path of the head in the frame of the rail.

corrected = d⁻¹ ∘ reference, in SE(2), for the instant one horizon ahead; held within the limits of
motion, then saturated at the workspace limit, so that nothing can lead it out again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
import math
from typing import Any, NamedTuple

from facade_manipulator.compensation.contact import Contact, LateralSettings
from facade_manipulator.compensation.correction import (
    Correction,
    CorrectionMode,
    CorrectionSettings,
    LONGEST_PAUSE,
    Remainder,
)
from facade_manipulator.compensation.following import Following, LEAST_ERROR
from facade_manipulator.compensation.force_watch import OLDEST_WRENCH
from facade_manipulator.compensation.impedance import ImpedanceSettings, YawImpedanceSettings
from facade_manipulator.compensation.limits import Tracker, WorkspaceLimit, WorkspaceLimitSettings
from facade_manipulator.compensation.pressing import Surroundings
from facade_manipulator.compensation.suspension import (
    obstacle,
    stroke_obstacle,
    StrokeWatch,
    SuspensionSettings,
)
from facade_manipulator.compensation.wall_sense import WallSense
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import (
    add,
    compose,
    difference,
    Geometry,
    Mechanism,
    MotionState,
    Pose,
    relative,
    subtract,
    ZERO_POSE,
    ZERO_TWIST,
)
from facade_manipulator.motion.reference import HeadMotion, ReferencePath, ReferenceSettings
from facade_manipulator.parameters import parameter, settings, settings_from
from facade_manipulator.prediction.estimate import Estimate, EstimateGate, EstimateSettings
from facade_manipulator.prediction.predictor import PredictionSettings

LATEST_WRENCH = 0.04  # s, that an estimate waits for what the head felt at its stamp
LIMIT_CHANGE_TIME = 0.5  # s, of a change of the workspace limit: 0.4 m/s² at the largest margin
LONGEST_INTERVAL = 0.1  # s, a pause counts as no longer


@settings
class CompensationSettings:
    """How far ahead and how fast the compensation moves the head."""

    horizon: float = parameter(
        'How far ahead of its publication a corrected pose is meant', default=0.06, unit='s',
        minimum=0.005, maximum=0.5)
    min_conditioning: float = parameter(
        'Least local conditioning index of a corrected pose', default=0.05, minimum=0.0,
        maximum=1.0)
    speed: tuple[float, ...] = parameter(
        'Highest speed of the head along the rail: x, y, theta', default=(0.45, 0.4, 1.2),
        unit='m/s, rad/s', minimum=1e-3, maximum=10.0, elements=Pose._fields)
    acceleration: tuple[float, ...] = parameter(
        'Highest acceleration of the head along the rail: x, y, theta', default=(2.8, 2.5, 7.0),
        unit='m/s^2, rad/s^2', minimum=1e-2, maximum=100.0, elements=Pose._fields)


class CorrectedPose(NamedTuple):
    """What the head should do."""

    time: float  #: the instant it is meant for [s]
    pose: Pose  #: in frame rail
    reference: Pose  #: where the head should be then on its path to the goal, in frame facade
    shifted: Pose  #: the same with what the contact with the wall shifts it by
    disturbance: Pose  #: of the gondola, that is corrected: frame rail in frame facade
    saturation_error: Pose  #: by how much each axis is held back at the workspace limit
    tracking_error: Pose  #: by how much each axis is held back by the limits of motion


class CompensatorSettings(NamedTuple):
    """Settings of the compensator's parts."""

    compensation: CompensationSettings = CompensationSettings()
    estimate: EstimateSettings = EstimateSettings()
    prediction: PredictionSettings = PredictionSettings()
    correction: CorrectionSettings = CorrectionSettings()
    reference: ReferenceSettings = ReferenceSettings()
    workspace_limit: WorkspaceLimitSettings = WorkspaceLimitSettings()
    lateral: LateralSettings = LateralSettings()
    impedance: ImpedanceSettings = ImpedanceSettings()
    yaw_impedance: YawImpedanceSettings = YawImpedanceSettings()
    suspension: SuspensionSettings = SuspensionSettings()

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> CompensatorSettings:
        """Return those of a node's parameters by full name; raises as `settings_from`."""
        return cls(**{
            part: settings_from(type(default), values, '' if part == 'compensation' else part)
            for part, default in cls()._asdict().items()})


DEFAULTS = CompensatorSettings()


class Compensator:
    """Turn goals, estimates of the disturbance and what the head meets into corrected poses."""

    def __init__(self, geometry: Geometry, settings: CompensatorSettings = DEFAULTS) -> None:
        self.geometry = geometry
        self._mechanism = Mechanism(geometry)
        self.settings = settings.compensation
        #: what is corrected at present, and whether
        self.correction = Correction(settings.correction, settings.prediction)
        #: what the wall shifts the goal by; measurements at the wall go there
        self.contact = Contact(
            settings.lateral, settings.impedance, settings.yaw_impedance)
        self.following = Following()  #: how the head follows; the head's poses go there
        self._wall = WallSense()
        self._estimates: deque[Estimate] = deque()  # that wait for what the head felt then
        self.goal: Pose | None = None  #: where on the wall the head is to end
        self.initialisations = 0  #: how often the path began at the head
        self._suspension = settings.suspension
        self._strokes = StrokeWatch()
        self.gate = EstimateGate(settings.estimate)
        self._reference = ReferencePath(settings.reference)
        self._workspace_limit = WorkspaceLimit(geometry, settings.workspace_limit)
        self._tracker = Tracker(self.settings.speed, self.settings.acceleration)
        self._planned_goal: Pose | None = None
        self._last: CorrectedPose | None = None
        self._remainder = Remainder()  # of changes of the workspace limit
        self._frame: tuple[Pose, bool] | None = None  # that places on the wall were found in
        self._changes: dict[str, Callable[[Any], None]] = {
            'compensation': self._change_motion,
            'estimate': self._change_estimate,
            'prediction': self.correction.change_prediction,
            'workspace_limit': self._change_workspace_limit,
            'suspension': partial(setattr, self, '_suspension'),
            'impedance': partial(setattr, self.contact.pressing, 'press'),
            'yaw_impedance': partial(setattr, self.contact.pressing, 'turn'),
            **{name: partial(setattr, part, 'settings') for name, part in (
                ('correction', self.correction), ('reference', self._reference),
                ('lateral', self.contact.lateral))},
        }

    def change(self, part: str, settings: Any) -> None:
        """
        Go on with other settings of one part; the head does not jump.

        Parameters
        ----------
        part : str
            A field of `CompensatorSettings`.
        settings : object
            Of the class of that field. New settings of prediction or estimator learn
            again: the correction fades out and in again. A new reference holds from the next
            goal on.

        Raises
        ------
        ParameterError
            If a margin leaves no workspace; the one before stays.

        """
        self._changes[part](settings)
        self.contact.look_whether_idle()

    def _change_motion(self, settings: CompensationSettings) -> None:
        self.settings = settings
        self._tracker.change_limits(settings.speed, settings.acceleration)

    def _change_estimate(self, settings: EstimateSettings) -> None:
        if self.gate.change_settings(settings):
            self.correction.learn_again()

    def _change_workspace_limit(self, settings: WorkspaceLimitSettings) -> None:
        limit, last = WorkspaceLimit(self.geometry, settings), self._last
        if last is not None:  # fade from the pose inside the old limit to that inside the new
            inside = subtract(last.pose, self._remainder.at(last.time).position)
            wanted = add(inside, last.saturation_error)
            jump = subtract(inside, limit.saturate(wanted).pose)
            self._remainder.add(last.time, MotionState(jump, ZERO_TWIST), LIMIT_CHANGE_TIME)
        self._workspace_limit = limit

    def set_goal(self, goal: Pose) -> None:
        """
        Move to a goal on the wall from now on.

        Raises a LimitError if it is out of the workspace even in still air; the goal before stays.
        """
        self.require_inside(goal)
        self.goal = goal

    def drop_goal(self) -> None:
        """Publish nothing more; the next goal begins where the head is."""
        self.goal = self._planned_goal = self._last = None

    def hold(self, now: float) -> Pose:
        """
        End the way to the goal; return where on the wall the head comes to rest.

        Raises a ManipulatorError if there is no way to end.
        """
        if self._last is None:
            raise ManipulatorError('the head follows no goal: there is no way to end')
        self.goal = self._planned_goal = self._reference.stop(
            max(self._last.time, now + self.settings.horizon) + self.following.lag)
        return self.goal

    def goal_error(self, now: float) -> Pose | None:
        """Return the goal less where the head is on the wall; None where that is not known."""
        newest = self.following.newest(now)
        if newest is None or self.goal is None or not all(self.correction.known):
            return None
        stamp, head = newest
        on_wall = compose(self.correction.disturbance(stamp), head)
        return difference(add(self.goal, self.contact.present), on_wall)

    def path_time(self, now: float) -> float:
        """Return how long the path to the goal still takes [s]."""
        return self._reference.arrival() - now if self.goal == self._planned_goal else math.inf

    def require_inside(self, goal: Pose) -> None:
        """
        Check a goal.

        Raises a LimitError if it is out of the workspace even in still air.
        """
        self._mechanism.certify(goal, self.settings.min_conditioning)

    def add_estimate(
        self, now: float, stamp: float, pose: Pose, variances: Sequence[float], tilt: float = 0.0
    ) -> None:
        """
        Learn from an estimate of the disturbance, all as `EstimateGate.check` takes it.

        Raises an InputError if it cannot be true.
        """
        self._estimates.append(self.gate.check(now, stamp, pose, variances, tilt))
        while self._estimates and self._is_added(now, self._estimates[0]):
            self._estimates.popleft()

    def _is_added(self, now: float, estimate: Estimate) -> bool:
        """Add an estimate, with what the wall says of its stamp once that has come."""
        if not self.contact.is_idle:
            pressing, stamp = self.contact.pressing, estimate.stamp
            head, pressed = self.following.head_at(stamp), pressing.deflection(stamp)
            patience = LATEST_WRENCH if all(estimate.known) else OLDEST_WRENCH
            if pressing.is_holding and None in (head, pressed) and abs(now - stamp) < patience:
                return False
            estimate = self._wall.fused(
                estimate, self.correction.predicted(estimate).theta, head, pressed,
                pressing.is_holding)
        self.correction.add_estimate(estimate)
        return True

    @property
    def obstacle(self) -> str:
        """Why goal or strokes are too much for the gondola to press at; empty if they are not."""
        if self.goal is None:
            return ''
        press = self.contact.pressing.press
        return obstacle(
            self._suspension, press, self.geometry, self.goal) or stroke_obstacle(
            self._suspension, press, self._strokes.strokes)

    def update(self, now: float) -> CorrectedPose | None:
        """
        Return the corrected pose for one horizon ahead, None before there is a goal.

        The present time [s] is later than at the update before; if the clock is set, the path
        begins again.
        """
        time = now + self.settings.horizon
        if self._last is not None and (
                not -LONGEST_INTERVAL <= time - self._last.time <= LONGEST_PAUSE):
            self._last = None  # the clock was set: begin again
        aim = time + self.following.lag
        disturbance = self.correction.at(now, aim)
        if self.goal is None:
            return None
        if self._last is None or self.following.is_off_path(now):
            self._initialise(now, aim, disturbance.position, self.goal)
        elif self.goal != self._planned_goal:
            self._reference.retarget(aim, self.goal)
        if self.goal != self._planned_goal:
            self._strokes.note(now, self.goal)
        self._planned_goal = self.goal
        self._last = self._corrected(now, time, self._reference.at(aim).position, disturbance)
        return self._last

    def _corrected(
        self, now: float, time: float, reference: Pose, rail: MotionState
    ) -> CorrectedPose:
        interval = 0.0
        if self._last is not None:
            interval = min(max(time - self._last.time, 0.0), LONGEST_INTERVAL)
        if self.contact.is_idle:
            shifted, self.contact.yaw = reference, reference.theta
        else:
            shifted = self.contact.shift(
                now, time, interval, reference, self._surroundings(reference, rail.position))
        disturbance = rail.position
        wanted = relative(disturbance, shifted)
        tracked = self._tracker.step(time, wanted)
        inside = self._workspace_limit.saturate(tracked, math.tan(disturbance.theta))
        pose = add(inside.pose, self._remainder.at(time).position)
        self.following.publish(time, pose)
        return CorrectedPose(
            time, pose, reference, shifted, disturbance, inside.saturation_error,
            subtract(wanted, tracked))

    def _surroundings(self, reference: Pose, rail: Pose) -> Surroundings:
        """Return what pressing depends on; a wall is forgotten whose frame is another one."""
        correction, last = self.correction, self._last
        if (correction.nominal, correction.is_blind) != self._frame:
            self._frame = correction.nominal, correction.is_blind
            self.contact.pressing.wall = None
        silence = correction.mode.value if correction.mode in (
            CorrectionMode.SILENT, CorrectionMode.SETTLING) else (
            '' if all(correction.known[1:]) else 'the estimate of y or theta is too uncertain')
        beyond = reference.y - (reference if self.goal is None else self.goal).y
        if last is None:
            return Surroundings(reference.y, ZERO_POSE, rail, silence, beyond=beyond)
        held_back = '' if max(map(abs, (last.saturation_error.y, last.tracking_error.y))) < (
            LEAST_ERROR) else 'the head was held back in y'
        return Surroundings(
            reference.y, last.saturation_error, rail, silence, held_back, beyond)

    def _initialise(self, now: float, aim: float, disturbance: Pose, goal: Pose) -> None:
        """Begin the path where the head stands, or at the goal if that is not known."""
        self._tracker.reset()
        self.following.begin(now)
        self.initialisations += 1
        newest, start = self.following.newest(now), goal
        if newest is not None:
            start = subtract(compose(disturbance, newest[1]), self.contact.present)
        self._reference.initialise(aim, HeadMotion(start), goal)
