"""The compensator node: goals on the wall and the disturbance in, corrected poses out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    WrenchStamped,
)
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_srvs.srv import SetBool, Trigger

from facade_manipulator.control.blend import NOWHERE
from facade_manipulator.control.border import Border
from facade_manipulator.control.compensation import (
    Compensator,
    CompensatorSettings,
    CorrectedPose,
    DEFAULTS,
)
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes.compensator_report import CompensatorReport, millimetres
from facade_manipulator.nodes.conversions import (
    END_EFFECTOR,
    FACADE,
    node_time,
    planar_pose,
    planar_wrench,
    pose_stamped,
    RAIL,
    require_frame,
    seconds,
    set_pose_stamped,
    VARIANCES,
)
from facade_manipulator.nodes.diagnostics import DiagnosticsPublisher, Refusals
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.nodes.runtime import LATEST, RELIABLE, run
from facade_manipulator.parameters import check_parameters, parameter


@dataclass(frozen=True)
class RateSettings:
    """How often the node publishes."""

    rate: float = parameter(
        100.0, 'Rate of corrected poses', unit='Hz', minimum=10.0, maximum=1000.0)

    def __post_init__(self) -> None:
        check_parameters(self)


class CompensatorNode(Node):
    """Keep the head where it should be on the wall while the gondola moves."""

    def __init__(self, **kwargs) -> None:
        super().__init__('compensator', **kwargs)
        geometry = declare(self, Geometry, 'geometry')
        rate = declare(self, RateSettings).rate
        self.settings = CompensatorSettings(**{
            part: self._declare(geometry, part, type(default))
            for part, default in DEFAULTS._asdict().items()})
        self._compensator = Compensator(geometry, self.settings)
        self._refusals = Refusals(self)
        self._report = CompensatorReport(self._compensator)
        self._follower: Callable[[float, Pose], None] | None = None
        self._corrected = self.create_publisher(PoseStamped, 'corrected_pose', LATEST)
        self._reference = self.create_publisher(PoseStamped, 'compensator/reference', RELIABLE)
        self._corrected_message = pose_stamped(RAIL, 0.0, NOWHERE)  # sent again and again
        self._reference_message = pose_stamped(FACADE, 0.0, NOWHERE)
        self._subscribe()
        self.create_service(SetBool, 'compensator/enable', self._enable)
        self.create_service(Trigger, 'compensator/tare', self._tare)
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        self.create_timer(1.0 / rate, self._update)

    def hand_to(self, follower: Callable[[float, Pose], None]) -> None:
        """
        Hand corrected poses to a node of the same process, which subscribes to them as well.

        That saves the way through the middleware; the topic goes on for everybody else.

        Parameters
        ----------
        follower : callable
            Takes the time that a pose is meant for [s] and the pose.

        """
        self._follower = follower

    def _declare(self, geometry: Geometry, part: str, settings_class: type):
        """Declare the settings of a part of the compensator, which may change while it runs."""
        def check(settings) -> None:
            if part == 'border':
                Border(geometry, settings)

        return declare(
            self, settings_class, '' if part == 'compensation' else part,
            lambda settings: self._compensator.change(part, settings), check)

    def _subscribe(self) -> None:
        self.create_subscription(PoseStamped, 'goal_pose', self._take_goal, LATEST)
        self.create_subscription(
            PoseWithCovarianceStamped, 'disturbance', self._take_disturbance,
            qos_profile_sensor_data)
        self.create_subscription(
            PoseStamped, 'end_effector_pose', self._take_head, RELIABLE)
        self.create_subscription(
            WrenchStamped, 'contact_wrench', self._take_wrench, qos_profile_sensor_data)
        self.create_subscription(
            PointStamped, 'lateral_offset', self._take_lateral_offset, qos_profile_sensor_data)

    def _take_goal(self, message: PoseStamped) -> None:
        try:
            require_frame(message.header.frame_id, FACADE, 'goal_pose')
            goal = planar_pose(message.pose, 'goal_pose')
        except ManipulatorError as error:
            self._refusals.add(error)
            return
        try:
            self._compensator.take_goal(goal)
        except ManipulatorError as error:
            self._refusals.add(error, 'goal_pose')

    def _take_disturbance(self, message: PoseWithCovarianceStamped) -> None:
        try:
            require_frame(message.header.frame_id, FACADE, 'disturbance')
            pose = planar_pose(message.pose.pose, 'disturbance')
            variances = [float(message.pose.covariance[i]) for i in VARIANCES]
            self._compensator.take_estimate(
                node_time(self), seconds(message.header.stamp), pose, variances)
        except ManipulatorError as error:
            self._refusals.add(error)

    def _take_head(self, message: PoseStamped) -> None:
        try:
            require_frame(message.header.frame_id, RAIL, 'end_effector_pose')
            self._compensator.take_head(
                seconds(message.header.stamp), planar_pose(message.pose, 'end_effector_pose'))
        except ManipulatorError as error:
            self._refusals.add(error)

    def _take_wrench(self, message: WrenchStamped) -> None:
        try:
            require_frame(message.header.frame_id, END_EFFECTOR, 'contact_wrench')
            self._compensator.take_wrench(
                node_time(self), seconds(message.header.stamp), planar_wrench(message))
        except ManipulatorError as error:
            self._refusals.add(error)

    def _take_lateral_offset(self, message: PointStamped) -> None:
        try:
            require_frame(message.header.frame_id, END_EFFECTOR, 'lateral_offset')
            self._compensator.take_lateral_offset(
                node_time(self), seconds(message.header.stamp), message.point.x)
        except ManipulatorError as error:
            self._refusals.add(error)

    def _update(self) -> None:
        now = node_time(self)
        try:
            corrected = self._compensator.update(now)
        except ManipulatorError as error:
            self._refusals.add(error)
            return
        if corrected is not None:
            self._send(corrected)
            self._report.note(now, corrected)
        if self._report.changed(now):
            self._diagnostics.publish()

    def _send(self, corrected: CorrectedPose) -> None:
        """Send what somebody listens to, the corrected pose first."""
        time, followers = corrected.time, 0
        if self._follower is not None:
            self._follower(time, corrected.pose)
            followers = 1
        if self._corrected.get_subscription_count() > followers:
            set_pose_stamped(self._corrected_message, time, corrected.pose)
            self._corrected.publish(self._corrected_message)
        if self._reference.get_subscription_count() > 0:
            set_pose_stamped(self._reference_message, time, corrected.reference)
            self._reference.publish(self._reference_message)

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
            nominal = self._compensator.correction.tare(node_time(self))
        except ManipulatorError as error:
            response.success, response.message = False, str(error)
            return response
        response.success = True
        response.message = f'the nominal place of the rail is now {millimetres(nominal)}'
        return response

    def _components(self) -> list[DiagnosticStatus]:
        return self._report.components(node_time(self), self._refusals.values())


def main(args: list[str] | None = None) -> int:
    """Run the node."""
    return run(lambda: [CompensatorNode()], args)


if __name__ == '__main__':
    raise SystemExit(main())
