"""The ik_service node: goals in frame `rail` to certified setpoints, solutions and paths."""

from __future__ import annotations

from functools import partial
import math
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from rclpy.node import Node
from std_msgs.msg import Header

from facade_manipulator import interfaces, messages
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Carriages, Geometry, Pose
from facade_manipulator.motion.limits import triple
from facade_manipulator.motion.reference import Approach, ReferenceSettings
from facade_manipulator.motion.setpoints import GoalSettings, SetpointStream, STREAM_GAP
from facade_manipulator.nodes.description import Description
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.codec import pose_codec, setpoint_codec, states_codec
from facade_manipulator.ros.conversions import frames, node_time, PoseStream
from facade_manipulator.ros.diagnostics import (
    diagnostic_status,
    DiagnosticsPublisher,
    DriverWatch,
    rejection_status,
    Rejections,
)
from facade_manipulator.ros.interfaces import publisher, service
from facade_manipulator.ros.publisher_watch import PublisherWatch
from facade_manipulator.ros.runtime import run

ACTUATOR_SPACE = 'actuator_space'
APPROACH_PERIOD = 0.01  # s
LEAD = 0.05  # s, how far ahead of their time the setpoints of an approach are sent
FOLLOWING = ('ok', 'following the goals')  # level and message of an outcome
SAME_TIME = 1e-5  # s: stamps are cut to nanoseconds, floats hold a quarter of a microsecond


class IkServiceNode(Node):
    """Inverse kinematics for the supervisor (service) and for the stream of corrected poses."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('ik_service', **kwargs)
        self.geometry = declare(self, Geometry, 'geometry')
        self._stream = SetpointStream(self.geometry, declare(self, GoalSettings))
        self._approach = Approach(declare(self, ReferenceSettings, 'approach'))
        self._last_goal_time = self._followed_at = -math.inf  # stamp; when it came, monotonic
        self._rejections = Rejections(self)
        self._rejected = ''
        self._waiting: tuple[float, Pose] | None = None  # a goal, and when it came
        self._published_outcome: tuple[str, str] | None = None
        self._setpoint_count = 0
        self._head: Pose | None = None
        self._frames = frames(self)
        self._goal_codec = pose_codec('corrected_pose', self._frames.rail)
        self._states_codec = states_codec()
        self._setpoint_codec = setpoint_codec(self._frames.rail)
        self._sources = PublisherWatch(self, self._rejections, self._change_publishers)
        self._driver = DriverWatch(
            self, self._rejections, self._change_driver, self._sources.subscribe)
        self._setpoints = publisher(self, interfaces.JOINT_SETPOINTS)
        self.heads = PoseStream(self, interfaces.END_EFFECTOR_POSE, self._frames.rail)
        self._status = publisher(self, interfaces.IK_STATUS)
        self._rejected_requests = publisher(self, interfaces.REJECTIONS)
        self._sources.subscribe(interfaces.CORRECTED_POSE, self._receive_goal, raw=True)
        self._sources.subscribe(
            interfaces.JOINT_STATES, self._receive_joint_states, raw=True)
        service(self, interfaces.SOLVE, self._solve)
        self._approaching = steady_timer(
            self, APPROACH_PERIOD, self._continue_approach, autostart=False)
        self._description = Description(self, self.geometry)
        self._diagnostics = DiagnosticsPublisher(self, lambda: [self._outcome_status()])
        self._publish_outcome()

    def _reject(self, error: ManipulatorError) -> None:
        """End the approach: a goal or a pose on the path to it is rejected."""
        self._approach.is_under_way = False
        self._rejections.add(error)
        self._rejected = str(error)
        self._publish_outcome()

    def _change_driver(self) -> None:
        """Lead no goal on that came before the drives were activated."""
        self._rejected = ''
        if not self._driver.may_move(self._followed_at):
            self._approach.is_under_way = False
        if self._waiting is not None:
            came, pose = self._waiting
            if self._driver.may_move(came):
                self._waiting = None
                self.follow(node_time(self), pose)
        self._publish_outcome()

    def _change_publishers(self) -> None:
        """Forget the head while two nodes publish joint_states; report the second one."""
        if self._sources.fault_of(interfaces.JOINT_STATES.name):
            self._head = None
        self._publish_outcome()

    def _receive_goal(self, data: bytes) -> None:
        try:
            time, numbers = self._goal_codec.read(data)
            if abs(time - self._last_goal_time) < SAME_TIME:  # came by a call already
                return
            messages.require_recent_command('corrected_pose', time, node_time(self))
            pose = messages.planar(numbers, 'corrected_pose')
        except ManipulatorError as error:
            self._reject(error)
        else:
            self.follow(time or node_time(self), pose)

    def follow(self, time: float, pose: Pose) -> None:
        """Follow a pose of a stream, meant for a time [s]; approach one that comes alone."""
        try:
            if self._driver.idle:
                self._stream.certify(pose)
                self._waiting = monotonic(), pose
                return
            pause = abs(time - self._last_goal_time)
            if pause > STREAM_GAP:  # an approach begins at the head
                self._sources.require_sole(interfaces.JOINT_STATES.name)
            self._last_goal_time, self._followed_at = time, monotonic()
            if self._head is None or pause <= STREAM_GAP:
                self._approach.is_under_way = False
                self._send(time, pose)
            else:
                self._stream.certify(pose)
                self._approach.begin(node_time(self) + LEAD, self._head, pose)
                self._approaching.reset()
        except ManipulatorError as error:
            self._reject(error)

    def _continue_approach(self) -> None:
        time = node_time(self) + LEAD
        pose = self._approach.pose(time)
        if pose is None:
            self._approaching.cancel()
            return
        try:
            self._send(time, pose)
        except ManipulatorError as error:
            self._reject(error)

    def _send(self, time: float, pose: Pose) -> None:
        """Publish the setpoint of a pose."""
        setpoint = self._stream.setpoint(time, pose)
        self._setpoint_count += 1
        self._setpoints.publish(self._setpoint_codec.write(
            setpoint.time, setpoint.position + setpoint.velocity))
        self._rejected = ''
        if self._published_outcome != FOLLOWING:  # which the next setpoint does not change
            self._publish_outcome()

    def _receive_joint_states(self, data: bytes) -> None:
        self._head = None
        with self._rejections:
            time, numbers = self._states_codec.read(data)
            position = triple(numbers[:3])
            messages.require_finite(messages.CARRIAGES, position, 'joint_states position of')
            self._head = self._stream.mechanism.forward_kinematics(Carriages(*position))
            self.heads.publish(time, self._head)
            self._description.publish(time, self._head)

    def _solve(self, request: GetPlan.Request, response: GetPlan.Response) -> GetPlan.Response:
        response.plan.header.frame_id = ACTUATOR_SPACE
        response.plan.header.stamp = self.get_clock().now().to_msg()
        try:
            path = self._path(request)
        except ManipulatorError as error:
            self._rejections.add(error, 'solve')
            self._rejected_requests.publish(
                rejection_status('solve', error, request.goal.header.stamp))
            return response
        response.plan.poses = [_actuator_pose(response.plan.header, point) for point in path]
        return response

    def _path(self, request: GetPlan.Request) -> list[Carriages]:
        goal = messages.pose_in_frame(request.goal, self._frames.rail, 'goal')
        if not request.start.header.frame_id:
            return [self._stream.certify(goal)]
        start = messages.pose_in_frame(request.start, self._frames.rail, 'start')
        return self._stream.path(start, goal, request.tolerance)

    def _publish_outcome(self) -> None:
        if self._outcome() != self._published_outcome:
            self._published_outcome = self._outcome()
            self._status.publish(self._outcome_status())
            self._diagnostics.publish()

    def _outcome(self) -> tuple[str, str]:
        """Return level and message of what the machine does with the goals."""
        driver = self._driver.status
        if self._sources.fault:
            return 'error', self._sources.fault
        if self._rejected:
            return 'error', self._rejected
        if idle := self._driver.idle:
            following = f'; next: {idle.next_step}' if idle.next_step else ''
            return 'warn', f'no goal is followed: {idle}{following}'
        if not self._driver.may_move(self._followed_at):
            return 'ok', 'holding: no goal since the drives were activated'
        if driver is not None and driver.activity == 'holding':
            return 'ok', 'holding: no goal comes'
        return FOLLOWING if self._setpoint_count else ('ok', 'no goal yet')

    def _outcome_status(self) -> DiagnosticStatus:
        values = {'setpoints': self._setpoint_count, **self._rejections.values()}
        return diagnostic_status('goal', *self._outcome(), values)


def _actuator_pose(header: Header, point: Carriages) -> PoseStamped:
    pose = PoseStamped(header=header)
    position = pose.pose.position
    position.x, position.y, position.z = point
    return pose


main = partial(run, lambda: [IkServiceNode()])

if __name__ == '__main__':
    raise SystemExit(main())
