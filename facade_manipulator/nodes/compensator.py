"""Compensator node: receives goals and disturbances, publishes corrected poses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any, TYPE_CHECKING

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import (
    PointStamped,
    PoseStamped,
    PoseWithCovarianceStamped,
    WrenchStamped,
)
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool, Trigger

from facade_manipulator import topics
from facade_manipulator.compensation import compensation_diagnostics
from facade_manipulator.compensation.contact import LateralSettings
from facade_manipulator.compensation.contact_phases import ContactSettings
from facade_manipulator.compensation.estimate_source import EstimateSource
from facade_manipulator.compensation.goal import ArrivalSettings, Goal, GoalTracker
from facade_manipulator.compensation.pose_compensator import Compensator, CorrectedPose
from facade_manipulator.errors import InputError, joined, ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import millimetres
from facade_manipulator.nodes import command_gate, conversions, planar_messages
from facade_manipulator.nodes.base_node import BaseNode
from facade_manipulator.nodes.command_gate import CommandGate, watch_driver
from facade_manipulator.nodes.conversions import (
    pose_stamped,
    ros_time,
    stamp,
    steady_seconds,
    steady_timer,
    system_time,
)
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.driver_status import SILENT
from facade_manipulator.nodes.node_parameters import accept_changes, NodeParameters
from facade_manipulator.nodes.node_settings import CompensatorSetup
from facade_manipulator.nodes.node_subscriptions import PublisherWatch
from facade_manipulator.nodes.run import run

if TYPE_CHECKING:
    from facade_manipulator.nodes.ik_service import IkServiceNode


def stamp_of(goal: PoseStamped) -> str:
    """Return the stamp of a goal as text; use the present time for a goal without a stamp."""
    given = goal.header.stamp
    return planar_messages.stamp_text(given if given != Time() else stamp(ros_time()))


class CompensatorNode(BaseNode):
    """
    Compensator node: keeps the head in place on the wall while the gondola moves.

    Parameters
    ----------
    connects_later : bool
        Whether the caller calls `connect`; needed if an ik_service runs in the same process.

    """

    wants_priority = True
    DROPPED = 'the goal was dropped; the head does not move'

    def __init__(self, connects_later: bool = False, **kwargs: Any) -> None:
        super().__init__('compensator', **kwargs)
        setup = CompensatorSetup.read(NodeParameters(self))
        self._compensator = Compensator(setup.geometry, setup.parts)
        change_contact = self._compensator.change_contact
        accept_changes(self, ContactSettings, 'contact', change_contact)
        change_lateral = self._compensator.change_lateral
        accept_changes(self, LateralSettings, 'lateral', change_lateral)
        self._source = EstimateSource()
        # of the newest estimate
        self._out_of_plane = planar_messages.OutOfPlane(0.0, 0.0)

        self.diagnostics = Diagnostics(self, self._components)
        self._frames = planar_messages.Frames.of(self.get_namespace())
        self._corrected_poses = self.create_publisher(*topics.CORRECTED_POSE)
        # receives each corrected pose, in an ik_service of this process
        self._follow: Callable[[float, Pose], None] | None = None
        self._message = PoseStamped()  # of each corrected pose
        self._references = self.create_publisher(*topics.REFERENCE)
        self._transform = conversions.FacadeTransform(self)
        self._goal_status = self.create_publisher(*topics.GOAL_STATUS)
        warn = partial(self.diagnostics.warn, 'goal')
        self._goals = GoalTracker(self._compensator, self._publish_goal, warn)
        self._goals.settings = setup.arrival
        change_arrival = partial(setattr, self._goals, 'settings')
        accept_changes(self, ArrivalSettings, 'arrival', change_arrival)

        self.inputs = PublisherWatch(self, self.diagnostics)
        self._gate = CommandGate(
            self._goals.follow,
            self._refuse,
            self._end_goal,
            'send the goal with a new stamp',
        )
        watch_driver(self._gate, self.inputs)
        self._subscribe(self._frames)
        self.create_service(*topics.ENABLE, self._enable)
        self.create_service(*topics.TARE, partial(self._answer, self._tare))
        self.create_service(*topics.HOLD, partial(self._answer, self._hold))
        steady_timer(self, 1.0 / self._compensator.settings.rate, self._update)
        steady_timer(self, command_gate.GATE_PERIOD, self._report_change)
        if not connects_later:
            self.connect(None)

    def _subscribe(self, frames: planar_messages.Frames) -> None:
        """Subscribe to goals, estimates and measurements of the contact with the wall."""
        subscribe = self.inputs.subscribe
        subscribe(
            topics.GOAL_POSE, self._receive_goal, self._reject_goal, frames.facade
        )
        for topic in (topics.DISTURBANCE, topics.DISTURBANCE_ODOMETRY):
            subscribe(topic, self._add_estimate, self._reject_estimate, frames.facade)
        head = frames.end_effector
        subscribe(
            topics.CONTACT_WRENCH, self._receive_wrench, self._reject_wrench, head
        )
        subscribe(topics.LATERAL_OFFSET, self._receive_lateral_offset, frame_id=head)

    def connect(self, ik_service: IkServiceNode | None) -> None:
        """
        Receive the head's pose from an ik_service in this process, or from messages.

        Messages are also necessary if both nodes have remapped the topic to different names.
        """
        topic = topics.END_EFFECTOR_POSE
        own_name = self.resolve_topic_name(topic.name)
        if ik_service and ik_service.resolve_topic_name(topic.name) == own_name:
            self.inputs.accept_calls(topic)
            ik_service.pass_heads_to(self.owned(self.add_head))
        else:
            self.inputs.subscribe(
                topic, self._receive_head, self._reject_head, self._frames.rail
            )

    def pass_poses_to(self, follow: Callable[[float, Pose], None]) -> None:
        """Set a function that receives time [s, monotonic] and value of each corrected pose."""
        self._follow = follow

    def add_head(self, time: float, head: Pose) -> None:
        """Receive time [s, monotonic] and pose of the head from an ik_service in this process."""
        self.inputs.accept(
            topics.END_EFFECTOR_POSE,
            partial(self._compensator.following.add_head, monotonic(), time, head),
            partial(self._reject_head, None),
        )

    def _publish_goal(self, component: compensation_diagnostics.Component) -> None:
        self._goal_status.publish(diagnostic_status(*component))

    def _receive_goal(self, message: PoseStamped) -> None:
        """
        Check a goal and offer it to the gate; only answer a repeated goal.

        Raises a ManipulatorError for a goal that is malformed, stale or outside the workspace.
        """
        time = planar_messages.seconds(message.header.stamp)
        pose = planar_messages.planar_pose(message.pose, 'goal_pose')
        goal = Goal(pose, stamp_of(message), monotonic())
        if self._goals.answer_repetition(goal, has_stamp=bool(time)):
            return
        planar_messages.require_recent_command('goal_pose', time, ros_time())
        self._require_one_driver()
        self._compensator.require_inside(pose)
        self._goals.receive(goal)
        self._gate.offer(goal)

    def _reject_goal(self, message: PoseStamped, error: ManipulatorError) -> None:
        self._goals.reject(stamp_of(message), str(error))

    def _refuse(self, _: Goal, error: ManipulatorError) -> None:
        self.diagnostics.reject(error, 'goal_pose rejected')
        self._goals.refuse(str(error))

    def _end_goal(self) -> None:
        """Drop a goal that was sent before the drives stopped or became active."""
        self._compensator.drop_goal()
        reason = str(self._gate.refusal('send a new goal'))
        try:
            self._require_one_driver()
        except InputError as error:
            reason = f'{error}, then send a new goal'
        self._goals.end(reason)

    def _require_one_driver(self) -> None:
        """Raise an InputError while two publishers of driver/status silence the driver."""
        if self._gate.status is SILENT:
            self.inputs.require_sole(topics.DRIVER_STATUS.name)

    def _add_estimate(self, message: PoseWithCovarianceStamped | Odometry) -> None:
        """
        Pass a disturbance to the compensator, measured at the rail or at an estimator on it.

        Raises an InputError for a malformed or impossible estimate, and while estimates arrive on
        the other topic.
        """
        now = monotonic()
        topic = topics.DISTURBANCE
        if isinstance(message, Odometry):
            topic = topics.DISTURBANCE_ODOMETRY
        self._source.require_sole(now, topic.name)
        # only Odometry contains this field
        child = getattr(message, 'child_frame_id', self._frames.rail)
        if not child:
            raise InputError(
                'frame',
                'disturbance_odometry contains no child_frame_id, expected '
                f"'{self._frames.rail}' or the frame of the estimator",
            )
        place, self._out_of_plane, variances = planar_messages.estimated_pose(
            message, 'disturbance'
        )
        if child != self._frames.rail:
            place = self._compensator.gate.displacement(place)
        self._compensator.add_estimate(
            now,
            steady_seconds(message.header.stamp),
            place,
            variances,
            self._out_of_plane.tilt,
        )
        self._source.accept(now, topic.name)

    def _reject_estimate(self, _: object, error: ManipulatorError) -> None:
        self._compensator.correction.rejections.add(monotonic(), error)

    def _receive_head(self, message: PoseStamped) -> None:
        self._compensator.following.add_head(
            monotonic(),
            steady_seconds(message.header.stamp),
            planar_messages.planar_pose(message.pose, 'end_effector_pose'),
        )

    def _reject_head(self, _: object, error: ManipulatorError) -> None:
        self._compensator.following.rejections.add(monotonic(), error)

    def _receive_wrench(self, message: WrenchStamped) -> None:
        self._compensator.contact.add_wrench(
            monotonic(),
            steady_seconds(message.header.stamp),
            planar_messages.planar_wrench(message),
        )

    def _reject_wrench(self, _: object, error: ManipulatorError) -> None:
        self._compensator.contact.pressing.rejections.add(monotonic(), error)

    def _receive_lateral_offset(self, message: PointStamped) -> None:
        self._compensator.contact.add_lateral_offset(
            monotonic(), steady_seconds(message.header.stamp), message.point.x
        )

    def _update(self) -> None:
        """Publish the pose of the rail and the corrected pose of this cycle."""
        now = monotonic()
        if self._transform.is_subscribed:
            rail = self._compensator.correction.rail(now)
            self._transform.publish(system_time(now), rail)
        with self.diagnostics.counted():
            corrected = self._compensator.update(now)
            if corrected is not None:
                self._send(corrected)

    def _send(self, corrected: CorrectedPose) -> None:
        """Pass a corrected pose to the ik_service; publish it if another node subscribes."""
        if self._corrected_poses.get_subscription_count():
            self._corrected_poses.publish(
                pose_stamped(
                    self._frames.rail,
                    system_time(corrected.time),
                    corrected.pose,
                    self._message,
                )
            )
        if self._references.get_subscription_count():
            self._references.publish(
                pose_stamped(
                    self._frames.facade,
                    system_time(corrected.reach_time),
                    corrected.reference,
                )
            )
        if self._follow is not None:
            self._follow(corrected.time, corrected.pose)

    def _report_change(self) -> None:
        """Publish the progress of the goal, and changed diagnostics."""
        now = monotonic()
        self._gate.update(now)
        self._goals.update(now)
        self.diagnostics.publish_change(
            compensation_diagnostics.correction_outcome(
                self._compensator, now, self._input_fault(now)
            )
        )

    def _input_fault(self, now: float) -> str:
        """Return the input topics with two publishers, and two topics with estimates."""
        return joined(self.inputs.fault, self._source.fault(now))

    def _components(self) -> list[DiagnosticStatus]:
        now = monotonic()
        correction = compensation_diagnostics.correction_component(
            self._compensator, now, self._input_fault(now), self._out_of_plane
        )
        components = [
            correction,
            *compensation_diagnostics.contact_components(self._compensator),
        ]
        return [diagnostic_status(*one) for one in components]

    def _enable(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        """Enable or disable the correction, which fades in or out."""
        correction = self._compensator.correction
        correction.enabled = request.data
        direction = 'in' if request.data else 'out'
        fade_time = correction.settings.fade_time
        response.success = True
        response.message = f'the correction fades {direction} within {fade_time:g} s'
        return response

    def _answer(
        self, act: Callable[[], str], _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Call a function and answer the request with its message or its error."""
        try:
            response.message = act()
            response.success = True
        except ManipulatorError as error:
            response.message = str(error)
        return response

    def _tare(self) -> str:
        place = self._compensator.correction.tare(monotonic())
        return f'the nominal position of the rail is now {millimetres(place)}'

    def _hold(self) -> str:
        """End the goal that is followed, or that waits for the status of the driver."""
        reason = f'{topics.HOLD.name} was called'
        if self._gate.withdraw():  # while a goal waits, no other goal is followed
            self._goals.refuse(reason)
            return self.DROPPED
        try:
            place = self._compensator.hold(monotonic())
        finally:
            self._goals.end(reason)  # the goal ends also without a path to rest
        if place is None:
            return self.DROPPED
        retreat = self._compensator.contact.pressing.distance_at_rest
        distance = f'{1e3 * retreat:.1f} mm in front of' if retreat else 'at'
        return f'the head stays {distance} {millimetres(place)}'


main = partial(run, lambda: [CompensatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
