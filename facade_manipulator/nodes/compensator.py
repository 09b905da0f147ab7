"""The compensator node: goals on the wall and the disturbance in, corrected poses out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from time import monotonic
from typing import Any, NamedTuple

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, PoseStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from std_srvs.srv import SetBool

from facade_manipulator import interfaces, messages
from facade_manipulator.compensation.compensator import Compensator, CompensatorSettings, DEFAULTS
from facade_manipulator.compensation.following import ArrivalSettings, HeldBack
from facade_manipulator.compensation.limits import WorkspaceLimit
from facade_manipulator.errors import InputError, LimitError, ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes import compensator_report
from facade_manipulator.nodes.goal_report import GoalReport
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.nodes.settings import RateSettings
from facade_manipulator.ros.clocks import steady_timers
from facade_manipulator.ros.codec import estimate_codec, pose_codec
from facade_manipulator.ros.conversions import frames, node_time, PoseStream, Transforms
from facade_manipulator.ros.diagnostics import (
    DiagnosticsPublisher,
    DriverWatch,
    Rejections,
    SILENT,
)
from facade_manipulator.ros.interfaces import incompatible, publisher, service, subscription
from facade_manipulator.ros.lifecycle import offer_trigger
from facade_manipulator.ros.publisher_watch import PublisherWatch
from facade_manipulator.ros.runtime import run

REPORT_PERIOD = 0.02  # s
LOG_PAUSE = 10.0  # s, of a supervisor that sends goals all the time


class Goal(NamedTuple):
    """A goal on the wall, and when it came [s, monotonic]."""

    came: float
    stamp: Time
    pose: Pose


class CompensatorNode(Node):
    """
    Keep the head where it should be on the wall while the gondola moves.

    Parameters
    ----------
    heads : PoseStream, optional
        The head's poses, of a node of this process: they are received by call, not on the topic.

    """

    def __init__(self, heads: PoseStream | None = None, **kwargs: Any) -> None:
        super().__init__('compensator', **kwargs)
        geometry = declare(self, Geometry, 'geometry')
        rate = declare(self, RateSettings).rate
        self.settings = CompensatorSettings(**{
            part: self._declare(geometry, part, type(default))
            for part, default in DEFAULTS._asdict().items()})
        self._compensator = Compensator(geometry, self.settings)
        self._rejections = Rejections(self)
        self._held_back = HeldBack()
        self._report = compensator_report.CompensatorReport(self._compensator, self._held_back)
        self._goal: Goal | None = None  # the newest
        self._sources = PublisherWatch(self, self._rejections)
        self._driver = DriverWatch(
            self, self._rejections, self._choose_goal, self._sources.subscribe)
        self._progress = GoalReport(
            publisher(self, interfaces.GOAL_STATUS).publish, self._compensator,
            self._held_back)
        self._progress.watch.settings = declare(
            self, ArrivalSettings, 'arrival',
            partial(setattr, self._progress.watch, 'settings'))
        self._frames = frames(self)
        self.corrected = PoseStream(self, interfaces.CORRECTED_POSE, self._frames.rail)
        self._reference = PoseStream(self, interfaces.REFERENCE, self._frames.facade)
        self._transforms = Transforms(self)
        self._disturbance_codec = estimate_codec('disturbance', self._frames.facade)
        self._head_codec = pose_codec('end_effector_pose', self._frames.rail)
        self._subscribe(heads)
        service(self, interfaces.ENABLE, self._enable)
        offer_trigger(self, interfaces.TARE, self._tare)
        offer_trigger(self, interfaces.HOLD, self._hold)
        service(self, interfaces.CANCEL, self._cancel)
        self._diagnostics = DiagnosticsPublisher(
            self, lambda: self._report.components(
                node_time(self), self._rejections.values(), self._sources.fault))
        steady_timers(self, 1.0 / rate, self._update, REPORT_PERIOD, self._say)

    def _declare(self, geometry: Geometry, part: str, settings_class: type) -> Any:
        """Declare the settings of a part of the compensator, which may change while it runs."""
        return declare(
            self, settings_class, '' if part == 'compensation' else part,
            lambda settings: self._compensator.change(part, settings),
            partial(WorkspaceLimit, geometry) if part == 'workspace_limit' else lambda _: None)

    def _subscribe(self, heads: PoseStream | None) -> None:
        subscribe = self._sources.subscribe
        subscription(
            self, interfaces.GOAL_POSE, self._receive_goal,
            incompatible=lambda _: self._rejections.add(
                InputError('quality', incompatible('goal_pose'))),
            matched=self._sources.watch(interfaces.GOAL_POSE.name))
        subscribe(interfaces.DISTURBANCE, self._receive_disturbance, raw=True)
        subscribe(interfaces.DISTURBANCE_ODOMETRY, self._receive_odometry)
        if heads is not None:
            heads.connect(self._add_head, subscribes=False)
        else:
            subscribe(interfaces.END_EFFECTOR_POSE, self._receive_head, raw=True)
        subscribe(interfaces.CONTACT_WRENCH, self._receive_wrench)
        subscribe(interfaces.LATERAL_OFFSET, self._receive_lateral_offset)

    def _receive_goal(self, message: PoseStamped) -> None:
        now, stamp = self.get_clock().now().to_msg(), message.header.stamp
        stamp = stamp if messages.seconds(stamp) else now  # goal_status says which it got
        try:
            self._sources.require_sole(interfaces.GOAL_POSE.name)
            pose = messages.pose_in_frame(message, self._frames.facade, 'goal_pose')
            if self._is_followed(pose, message.header.stamp):
                return
            messages.require_recent_command(
                'goal_pose', messages.seconds(message.header.stamp), messages.seconds(now))
            goal = Goal(monotonic(), stamp, pose)
            self._follow(goal)
        except ManipulatorError as error:
            self._rejections.add(error, 'goal_pose' if isinstance(error, LimitError) else '')
            self._progress.reject(stamp, str(error))
            return
        self._goal = self._unless_silent(goal)
        if idle := self._driver.idle:
            reason = f'{idle}: send it again once they are active'
            self.get_logger().warning(
                f'goal_pose is not followed, {reason}', throttle_duration_sec=LOG_PAUSE)
            self._progress.reject(stamp, reason)
        else:
            self._progress.accept(stamp)

    def _is_followed(self, pose: Pose, stamp: Time) -> bool:
        """Return whether a goal repeats the one that is followed, with its stamp or without."""
        goal = self._goal
        return (goal is not None and goal.stamp == self._progress.stamp and goal.pose == pose
                and (stamp == goal.stamp or not messages.seconds(stamp)))

    def _choose_goal(self) -> None:
        """Follow the newest goal unless it came before the drives were activated."""
        if self._goal is not None:
            with self._rejections:  # its bounds may have been changed meanwhile
                if self._follow(self._goal) and self._progress.stamp is None:
                    self._progress.accept(self._goal.stamp)
            self._goal = self._unless_silent(self._goal)

    def _unless_silent(self, goal: Goal) -> Goal | None:
        """Forget a goal while the driver is silent: nothing moves by itself when it is back."""
        return None if self._driver.status is SILENT else goal

    def _follow(self, goal: Goal) -> bool:
        if self._driver.may_move(goal.came):
            self._compensator.set_goal(goal.pose)
            return True
        self._compensator.drop_goal()
        self._progress.end(str(self._driver.status))
        self._compensator.require_inside(goal.pose)
        return False

    def _receive_disturbance(self, data: bytes) -> None:
        with self._rejections:
            self._add_estimate(*self._disturbance_codec.read(data))

    def _receive_odometry(self, message: Odometry) -> None:
        with self._rejections:
            messages.require_frame(
                message.header.frame_id, self._frames.facade, 'disturbance_odometry')
            if not message.child_frame_id:
                raise InputError('frame', 'disturbance_odometry has no child_frame_id, expected '
                                 f"'{self._frames.rail}' or the estimator's own")
            self._add_estimate(
                messages.seconds(message.header.stamp), messages.estimate_numbers(message),
                is_of_rail=message.child_frame_id == self._frames.rail)

    def _add_estimate(
        self, time: float, numbers: Sequence[float], is_of_rail: bool = True
    ) -> None:
        *pose, x, y, yaw = numbers
        place, self._report.out_of_plane = messages.projected(pose, 'disturbance')
        if not is_of_rail:
            place = self._compensator.gate.displacement(place)
        self._compensator.add_estimate(
            node_time(self), time, place, (x, y, yaw), self._report.out_of_plane.tilt)

    def _receive_head(self, data: bytes) -> None:
        with self._rejections:
            time, pose = self._head_codec.read(data)
            self._compensator.following.add_head(time, messages.planar(pose, 'end_effector_pose'))

    def _add_head(self, time: float, pose: Pose) -> None:
        with self._rejections:
            self._compensator.following.add_head(time, pose)

    def _receive_wrench(self, message: WrenchStamped) -> None:
        with self._rejections:
            messages.require_frame(
                message.header.frame_id, self._frames.end_effector, 'contact_wrench')
            self._compensator.contact.add_wrench(
                node_time(self), messages.seconds(message.header.stamp),
                messages.planar_wrench(message))

    def _receive_lateral_offset(self, message: PointStamped) -> None:
        with self._rejections:
            messages.require_frame(
                message.header.frame_id, self._frames.end_effector, 'lateral_offset')
            self._compensator.contact.add_lateral_offset(
                node_time(self), messages.seconds(message.header.stamp), message.point.x)

    def _update(self) -> None:
        now = node_time(self)
        try:
            corrected = self._compensator.update(now)
        except ManipulatorError as error:
            self._rejections.add(error)
            return
        if corrected is not None:
            self.corrected.publish(corrected.time, corrected.pose)
            self._reference.publish(corrected.time, corrected.reference)
            self._transforms.publish(
                corrected.time, messages.FACADE, messages.RAIL, corrected.disturbance)
            self._held_back.note(
                now, corrected.saturation_error, corrected.tracking_error,
                Pose(*(float(not known) for known in self._compensator.correction.known)))
            self._report.newest = corrected
            self._report.pose_count += 1

    def _say(self) -> None:
        """Publish what a person is to know, apart from the poses, which are often and urgent."""
        now = node_time(self)
        self._progress.update(now)
        self._diagnostics.publish_news(self._report.outcome(now, self._sources.fault))

    def _enable(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        correction = self._compensator.correction
        correction.enabled = request.data
        response.success, direction = True, 'in' if request.data else 'out'
        response.message = (
            f'the correction fades {direction} within {correction.settings.fade_time:g} s')
        return response

    def _tare(self) -> str:
        place = self._compensator.correction.tare(node_time(self))
        return f'the nominal position of the rail is now {messages.millimetres(place)}'

    def _hold(self) -> str:
        now = self.get_clock().now().to_msg()
        self._goal = Goal(monotonic(), now, self._compensator.hold(messages.seconds(now)))
        self._progress.end(messages.HOLD)
        return f'the head stays on the wall at {messages.millimetres(self._goal.pose)}'

    def _cancel(
        self, request: CancelGoal.Request, response: CancelGoal.Response
    ) -> CancelGoal.Response:
        """Hold if the goal that is followed is not newer than the request's stamp."""
        stamp, newest = self._progress.stamp, request.goal_info.stamp
        if stamp is None or 0.0 < messages.seconds(newest) < messages.seconds(stamp):
            response.return_code = CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID
            return response
        try:
            self._hold()
        except ManipulatorError as error:
            self._rejections.add(error, 'cancel')
            response.return_code = CancelGoal.Response.ERROR_REJECTED
        else:
            response.goals_canceling = [GoalInfo(stamp=stamp)]
        return response


main = partial(run, lambda: [CompensatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
