"""The compensator node: goals on the wall and the disturbance in, corrected poses out."""

from __future__ import annotations

from dataclasses import dataclass
import math

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import SetBool, Trigger

from facade_manipulator.control.border import BorderSettings
from facade_manipulator.control.compensation import (
    CompensationSettings,
    Compensator,
    CompensatorSettings,
    CorrectedPose,
)
from facade_manipulator.control.correction import CorrectionSettings, Mode
from facade_manipulator.control.estimate import EstimateSettings
from facade_manipulator.control.prediction import PredictionSettings
from facade_manipulator.control.reference import ReferenceSettings
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes.conversions import (
    diagnostic_status,
    planar_pose,
    pose_stamped,
    require_frame,
    seconds,
)
from facade_manipulator.nodes.diagnostics import DiagnosticsPublisher, Refusals
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.nodes.runtime import LATEST, RELIABLE, run
from facade_manipulator.parameters import check_parameters, parameter

FACADE = 'facade'
RAIL = 'rail'
VARIANCES = (0, 7, 35)
HELD_BACK = 1e-4
TOLD_FOR = 1.0
LEVELS = {
    Mode.ACTIVE: 'ok', Mode.SETTLING: 'ok', Mode.DISABLED: 'warn', Mode.UNHEARD: 'warn',
    Mode.SILENT: 'error',
}


@dataclass(frozen=True)
class RateSettings:
    """How often the node publishes."""

    rate: float = parameter(
        100.0, 'Rate of corrected poses', unit='Hz', minimum=10.0, maximum=1000.0)

    def __post_init__(self) -> None:
        check_parameters(self)


PARTS = {
    'compensation': ('', CompensationSettings),
    'estimate': ('estimate', EstimateSettings),
    'prediction': ('prediction', PredictionSettings),
    'correction': ('correction', CorrectionSettings),
    'reference': ('reference', ReferenceSettings),
    'border': ('border', BorderSettings),
}


class CompensatorNode(Node):
    """Keep the head where it should be on the wall while the gondola moves."""

    def __init__(self, **kwargs) -> None:
        super().__init__('compensator', **kwargs)
        geometry = declare(self, Geometry, 'geometry')
        rate = declare(self, RateSettings).rate
        self.settings = CompensatorSettings(**{
            part: declare(self, settings_class, prefix)
            for part, (prefix, settings_class) in PARTS.items()})
        self._compensator = Compensator(geometry, self.settings)
        self._refusals = Refusals(self)
        self._held_back = HeldBack()
        self._last: CorrectedPose | None = None
        self._published = 0
        self._told = ('', '')
        self._corrected = self.create_publisher(PoseStamped, 'corrected_pose', LATEST)
        self._reference = self.create_publisher(PoseStamped, 'compensator/reference', RELIABLE)
        self._subscribe()
        self.create_service(SetBool, 'compensator/enable', self._enable)
        self.create_service(Trigger, 'compensator/tare', self._tare)
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        self.create_timer(1.0 / rate, self._update)

    def _subscribe(self) -> None:
        self.create_subscription(PoseStamped, 'goal_pose', self._take_goal, LATEST)
        self.create_subscription(
            PoseWithCovarianceStamped, 'disturbance', self._take_disturbance,
            qos_profile_sensor_data)
        self.create_subscription(
            PoseStamped, 'end_effector_pose', self._take_head, RELIABLE)

    def _take_goal(self, message: PoseStamped) -> None:
        try:
            require_frame(message.header.frame_id, FACADE, 'goal_pose')
            self._compensator.take_goal(planar_pose(message.pose, 'goal_pose'))
        except ManipulatorError as error:
            self._refusals.add(error)

    def _take_disturbance(self, message: PoseWithCovarianceStamped) -> None:
        try:
            require_frame(message.header.frame_id, FACADE, 'disturbance')
            pose = planar_pose(message.pose.pose, 'disturbance')
            variances = [float(message.pose.covariance[i]) for i in VARIANCES]
            self._compensator.take_estimate(
                self._now(), seconds(message.header.stamp), pose, variances)
        except ManipulatorError as error:
            self._refusals.add(error)

    def _take_head(self, message: PoseStamped) -> None:
        try:
            require_frame(message.header.frame_id, RAIL, 'end_effector_pose')
            self._compensator.take_head(
                seconds(message.header.stamp), planar_pose(message.pose, 'end_effector_pose'))
        except ManipulatorError as error:
            self._refusals.add(error)

    def _update(self) -> None:
        now = self._now()
        try:
            corrected = self._compensator.update(now)
        except ManipulatorError as error:
            self._refusals.add(error)
            return
        if corrected is not None:
            self._last = corrected
            self._published += 1
            self._held_back.note(now, corrected)
            self._corrected.publish(pose_stamped(RAIL, corrected.time, corrected.pose))
            self._reference.publish(pose_stamped(FACADE, corrected.time, corrected.reference))
        if self._outcome(now) != self._told:
            self._diagnostics.publish()

    def _enable(self, request: SetBool.Request, response: SetBool.Response):
        correction = self._compensator.correction
        correction.enabled = request.data
        response.success = True
        way = 'in' if request.data else 'out'
        response.message = (
            f'the correction fades {way} within {correction.settings.fade_time:g} s')
        return response

    def _tare(self, _: Trigger.Request, response: Trigger.Response):
        try:
            nominal = self._compensator.correction.tare(self._now())
        except ManipulatorError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f'the nominal place of the rail is now {_millimetres(nominal)}'
        return response

    def _outcome(self, now: float) -> tuple[str, str]:
        """Return level and sentence; no number that changes, so that a change means something."""
        mode = self._compensator.correction.mode
        held_back = self._held_back.sentence(now)
        if held_back:
            return 'warn', f'{mode.value}; {held_back}'
        return LEVELS[mode], mode.value

    def _components(self) -> list[DiagnosticStatus]:
        now = self._now()
        self._told = self._outcome(now)
        return [diagnostic_status('correction', *self._told, self._values(now))]

    def _values(self, now: float) -> dict:
        correction = self._compensator.correction
        values = {
            'horizon [ms]': 1e3 * self.settings.compensation.horizon,
            'corrected poses': self._published,
            'age of the estimate [ms]': 1e3 * correction.age(now),
            'courses begun': self._compensator.anchors,
        }
        if self._last is not None:
            values['corrected disturbance'] = _millimetres(self._last.disturbance)
            values['held back at the border'] = _millimetres(self._last.excess)
            values['held back by the limits of motion'] = _millimetres(self._last.behind)
        if correction.predictor.stamp is not None:
            values['frequencies [Hz]'] = '  '.join(
                f'{name} {first:.3g} {second:.3g}' for name, (first, second) in zip(
                    Pose._fields, correction.predictor.frequencies, strict=True))
        return {**values, **self._refusals.values()}

    def _now(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9


class HeldBack:
    """Remember for a while which axes were held back, and by what."""

    WHAT = {'excess': 'at the border of the workspace', 'behind': 'by the limits of motion'}

    def __init__(self) -> None:
        self._until: dict[tuple[str, str], float] = {}

    def note(self, now: float, corrected: CorrectedPose) -> None:
        """Note what holds back the corrected pose of this moment [s]."""
        for what in self.WHAT:
            for axis, amount in zip(Pose._fields, getattr(corrected, what), strict=True):
                if abs(amount) > HELD_BACK:
                    self._until[what, axis] = now + TOLD_FOR

    def sentence(self, now: float) -> str:
        """Return what holds back which axes, empty if nothing does."""
        parts = []
        for what, text in self.WHAT.items():
            axes = [axis for axis in Pose._fields if self._until.get((what, axis), 0.0) > now]
            if axes:
                parts.append(f'held back in {", ".join(axes)} {text}')
        return '; '.join(parts)


def _millimetres(pose: Pose) -> str:
    return (f'x {1e3 * pose.x:+.1f} mm, y {1e3 * pose.y:+.1f} mm, '
            f'theta {math.degrees(pose.theta):+.2f} deg')


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(lambda: [CompensatorNode()], args)


if __name__ == '__main__':
    raise SystemExit(main())
