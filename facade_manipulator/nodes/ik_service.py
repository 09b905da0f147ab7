"""Ik_service node: converts poses in frame `rail` to certified setpoints, solutions and paths."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from sensor_msgs.msg import JointState

from facade_manipulator import topics
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Carriages, Pose
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.motion.head_path import ReferencePath
from facade_manipulator.motion.pose_follower import PoseFollower, RailPose
from facade_manipulator.motion.setpoints import Setpoint, SetpointStream
from facade_manipulator.nodes import command_gate, conversions, planar_messages
from facade_manipulator.nodes.base_node import BaseNode
from facade_manipulator.nodes.command_gate import CommandGate, watch_driver
from facade_manipulator.nodes.conversions import (
    joint_state,
    pose_stamped,
    ros_time,
    steady_seconds,
    steady_timer,
    system_time,
)
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.node_parameters import NodeParameters
from facade_manipulator.nodes.node_settings import IkServiceSetup
from facade_manipulator.nodes.node_subscriptions import PublisherWatch
from facade_manipulator.nodes.run import run

if TYPE_CHECKING:
    from facade_manipulator.nodes.compensator import CompensatorNode


class IkServiceNode(BaseNode):
    """
    Inverse kinematics node for the stream of corrected poses and for requests.

    Parameters
    ----------
    connects_later : bool
        Whether the caller calls `connect`; needed if a compensator runs in the same process.

    """

    ACTUATOR_SPACE = 'actuator_space'
    APPROACH_PERIOD = 0.01  # s
    REASON = 'reason', 'quantity', 'value', 'bound', 'unit'  # of a rejected request

    wants_priority = True

    def __init__(self, connects_later: bool = False, **kwargs: Any) -> None:
        super().__init__('ik_service', **kwargs)
        setup = IkServiceSetup.read(NodeParameters(self))
        self._stream = SetpointStream(setup.geometry, setup.reference.min_conditioning)
        self._poses = PoseFollower(self._stream, ReferencePath(setup.reference))
        self._approach_timer = steady_timer(
            self, self.APPROACH_PERIOD, self._continue_approach, autostart=False
        )
        self._head: Pose | None = None
        # receives each pose of the head, in a compensator of this process
        self._add_head: Callable[[float, Pose], None] | None = None
        self._rejected = ''
        self._setpoint_count = 0

        self.diagnostics = Diagnostics(self, self._components)
        self._frames = planar_messages.Frames.of(self.get_namespace())
        self._setpoints = self.create_publisher(*topics.JOINT_SETPOINTS)
        self._head_message = PoseStamped()
        self._setpoint_message = JointState(name=AXIS_NAMES)
        self._setpoint_message.header.frame_id = self._frames.rail
        self._heads = self.create_publisher(*topics.END_EFFECTOR_POSE)
        self._description = conversions.Description(self, setup.geometry)
        self._rejected_requests = self.create_publisher(*topics.REJECTIONS)
        self.inputs = PublisherWatch(self, self.diagnostics, self._change_publishers)
        self._gate = CommandGate(
            self._follow, self._reject, self._end_commands, 'send the pose again'
        )
        watch_driver(self._gate, self.inputs)
        self.inputs.subscribe(topics.JOINT_STATES, self._receive_joint_states)
        self.create_service(*topics.SOLVE, self._solve)
        steady_timer(self, command_gate.GATE_PERIOD, self._report_change)
        if not connects_later:
            self.connect(None)

    def connect(self, compensator: CompensatorNode | None) -> None:
        """
        Receive corrected poses from a compensator in this process, or from messages.

        Messages are also necessary if both nodes have remapped the topic to different names.
        """
        topic = topics.CORRECTED_POSE
        own_name = self.resolve_topic_name(topic.name)
        if compensator and compensator.resolve_topic_name(topic.name) == own_name:
            self.inputs.accept_calls(topic)
            compensator.pass_poses_to(self.owned(self.follow))
        else:
            self.inputs.subscribe(
                topic,
                self._receive_corrected_pose,
                self._end_approach,
                self._frames.rail,
            )

    def pass_heads_to(self, add_head: Callable[[float, Pose], None]) -> None:
        """Set a function that receives time [s, monotonic] and pose of each measured head."""
        self._add_head = add_head

    def follow(self, time: float, pose: Pose) -> None:
        """
        Follow a pose of a compensator in this process.

        `time` is when the head reaches the pose [s, monotonic].
        """
        command = RailPose(time, pose, monotonic())
        self.inputs.accept(
            topics.CORRECTED_POSE,
            partial(self._offer, command),
            partial(self._end_approach, None),
        )

    def _receive_corrected_pose(self, message: PoseStamped) -> None:
        """Check a pose and offer it to the gate; without a stamp, the pose applies now."""
        stamp = planar_messages.seconds(message.header.stamp)
        planar_messages.require_recent_command('corrected_pose', stamp, ros_time())
        pose = planar_messages.planar_pose(message.pose, 'corrected_pose')
        received = monotonic()
        time = steady_seconds(message.header.stamp) if stamp else received
        self._offer(RailPose(time, pose, received))

    def _offer(self, command: RailPose) -> None:
        if not self._gate.is_open:
            self._stream.certify(command.pose)
        self._gate.offer(command)

    def _follow(self, command: RailPose) -> None:
        """Follow a pose of a stream; plan an approach from the head to a single pose."""
        now = monotonic()
        if now - command.received > command_gate.GATE_PERIOD:
            command = command._replace(time=now)  # the gate has held the pose
        if self._poses.is_first(command):
            self.inputs.require_sole(topics.JOINT_STATES.name)
        self._send(self._poses.follow(command, self._head))
        if self._poses.is_approaching and self._approach_timer.is_canceled():
            self._approach_timer.reset()

    def _reject(self, _: RailPose, error: ManipulatorError) -> None:
        """Count a rejected pose; end the approach unless the gate is closed."""
        self.diagnostics.reject(error, 'corrected_pose rejected')
        if self._gate.is_open:
            self._end_approach(None, error)

    def _end_commands(self) -> None:
        """Forget poses sent before the drives stopped or became active."""
        self._poses.end()
        self._rejected = ''

    def _continue_approach(self) -> None:
        """Send the next setpoint of an approach."""
        try:
            self._send(self._poses.step(monotonic(), self._head))
        except ManipulatorError as error:
            self.diagnostics.reject(error, 'approach')
            self._end_approach(None, error)
        if not self._poses.is_approaching:
            self._approach_timer.cancel()

    def _send(self, setpoint: Setpoint | None) -> None:
        """Publish a setpoint, or nothing for None (no setpoint exists before an approach)."""
        if setpoint is None:
            return
        time, position, velocity = setpoint
        self._setpoints.publish(
            joint_state(
                system_time(time), position, velocity, message=self._setpoint_message
            )
        )
        self._setpoint_count += 1
        self._rejected = ''

    def _end_approach(self, _: PoseStamped | None, error: ManipulatorError) -> None:
        """End the approach, because its goal or a pose on its path is rejected."""
        self._poses.end()
        self._rejected = str(error)

    def _receive_joint_states(self, message: JointState) -> None:
        """Publish the head's pose from measured positions; invalid positions make it unknown."""
        self._head = None
        time = planar_messages.seconds(message.header.stamp)
        carriages = Carriages(
            *planar_messages.carriages_from(
                message.name, message.position, 'joint_states position'
            )
        )
        head = self._stream.mechanism.forward_kinematics(carriages)
        self._head = head
        if self._heads.get_subscription_count():
            self._heads.publish(
                pose_stamped(self._frames.rail, time, head, self._head_message)
            )
        self._description.publish(time, head)
        if self._add_head is not None:
            self._add_head(steady_seconds(message.header.stamp), head)

    def _solve(
        self, request: GetPlan.Request, response: GetPlan.Response
    ) -> GetPlan.Response:
        """Reply with the carriage positions along the requested path, or none after an error."""
        header = response.plan.header
        header.frame_id = self.ACTUATOR_SPACE
        header.stamp = self.get_clock().now().to_msg()
        try:
            path = self._path(request)
        except ManipulatorError as error:
            self._reject_request(request, error)
            return response
        for carriages in path:
            pose = PoseStamped(header=header)
            point = pose.pose.position
            point.x, point.y, point.z = carriages
            response.plan.poses.append(pose)
        return response

    def _reject_request(
        self, request: GetPlan.Request, error: ManipulatorError
    ) -> None:
        """Count a rejected request; publish reason, value, limit and unit of the rejection."""
        self.diagnostics.reject(error, 'solve')
        values = {'goal stamp': planar_messages.stamp_text(request.goal.header.stamp)}
        for key in self.REASON:
            if hasattr(error, key):
                values[key] = getattr(error, key)
        self._rejected_requests.publish(
            diagnostic_status('solve', 'error', str(error), values)
        )

    def _path(self, request: GetPlan.Request) -> list[Carriages]:
        goal = planar_messages.pose_in_frame(request.goal, self._frames.rail, 'goal')
        if not request.start.header.frame_id:
            return [self._stream.certify(goal)]
        start = planar_messages.pose_in_frame(request.start, self._frames.rail, 'start')
        return self._stream.path(start, goal, request.tolerance)

    def _change_publishers(self) -> None:
        """Mark the head's pose as unknown while two nodes publish joint_states."""
        if self.inputs.fault_of(topics.JOINT_STATES.name):
            self._head = None

    def _report_change(self) -> None:
        """Apply the time-outs of the gate, and publish changed diagnostics."""
        self._gate.update(monotonic())
        self.diagnostics.publish_change(self._outcome())

    def _outcome(self) -> tuple[str, str]:
        """Return level and message: goals are followed, or why they are not followed."""
        if self.inputs.fault:
            return 'error', self.inputs.fault
        if self._rejected:
            return 'error', self._rejected
        status = self._gate.status
        if status is None:
            message = 'following the goals' if self._setpoint_count else 'no goal yet'
            return 'ok', message
        if not self._gate.is_open:
            next_step = f'; next: {status.next_step}' if status.next_step else ''
            return 'warn', f'no goal is followed: {status}{next_step}'
        if not self._gate.has_passed:
            return 'ok', 'holding: no goal since the drives were activated'
        if status.activity == 'holding':
            return 'ok', 'holding: no goal is being received'
        return 'ok', 'following the goals'

    def _components(self) -> list[DiagnosticStatus]:
        return [
            diagnostic_status(
                'goal', *self._outcome(), {'setpoints': self._setpoint_count}
            )
        ]


main = partial(run, lambda: [IkServiceNode()])

if __name__ == '__main__':
    raise SystemExit(main())
