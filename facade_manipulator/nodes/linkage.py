"""ik_service/linkage: the manipulator as markers, drawn only while somebody subscribes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.messages import pose_numbers, projected, RAIL
from facade_manipulator.nodes.shapes import MechanismView, Shape, shapes
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.ros import (
    declare,
    LATEST,
    LEVELS,
    node_time,
    pose_message,
    RELIABLE,
    steady_timer,
)

PERIOD = 0.1
OLDEST = 0.5  # s: what is older is not drawn, and markers vanish by themselves
OLDEST_STATE = 2.5  # s: /diagnostics comes once a second
KINDS = {
    'box': Marker.CUBE,
    'lines': Marker.LINE_LIST,
    'arrow': Marker.ARROW,
    'text': Marker.TEXT_VIEW_FACING,
}
LEVEL_NAMES = {value: name for name, value in LEVELS.items()}


@settings
class LinkageSettings:
    """What the picture cannot know by itself."""

    wall_distance: float = parameter(
        0.3, 'Distance of the wall from the rail in still air, for the picture alone', unit='m',
        minimum=-10.0, maximum=10.0)


class LinkageView:
    """
    Publish the picture at 10 Hz while someone subscribes.

    While nobody does there is no timer and no subscription.
    """

    def __init__(self, node: Node, geometry: Geometry) -> None:
        self._node = node
        self._geometry = geometry
        self._settings = declare(
            node, LinkageSettings, 'linkage', partial(setattr, self, '_settings'))
        self._values: dict[str, tuple[float, Any]] = {}
        self._driver = f'{node.get_namespace()}/driver: operation'.lstrip('/')
        self._subscriptions: list = []
        self._timer = steady_timer(node, PERIOD, self._publish, autostart=False)
        self._publisher = node.create_publisher(
            MarkerArray, 'ik_service/linkage', LATEST,
            event_callbacks=PublisherEventCallbacks(matched=self._match))

    def _match(self, matched) -> None:
        if matched.current_count and not self._subscriptions:
            self._open()
        elif not matched.current_count and self._subscriptions:
            self._close()

    def _open(self) -> None:
        create = self._node.create_subscription
        self._subscriptions = [
            *(create(PoseStamped, topic, self._receiver(topic), LATEST)
              for topic in ('end_effector_pose', 'corrected_pose', 'goal_pose')),
            create(PoseWithCovarianceStamped, 'disturbance', self._receive_disturbance,
                   qos_profile_sensor_data),
            create(Odometry, 'disturbance_odometry', self._receive_disturbance,
                   qos_profile_sensor_data),
            create(DiagnosticArray, '/diagnostics', self._receive_diagnostics, RELIABLE),
        ]
        self._timer.reset()

    def _close(self) -> None:
        self._timer.cancel()
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []
        self._values.clear()

    def _receiver(self, topic: str) -> Callable[[PoseStamped], None]:
        return lambda message: self._keep_pose(topic, message.pose)

    def _receive_disturbance(self, message: PoseWithCovarianceStamped | Odometry) -> None:
        if getattr(message, 'child_frame_id', RAIL) == RAIL:
            self._keep_pose('disturbance', message.pose.pose)

    def _keep_pose(self, topic: str, message: Any) -> None:
        try:
            self._keep(topic, projected(pose_numbers(message), topic)[0])
        except ManipulatorError:
            self._values.pop(topic, None)  # the node that rejects it says why

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._driver:
                self._keep('driver', status)

    def _keep(self, what: str, value: Any) -> None:
        self._values[what] = node_time(self._node), value

    def _newest(self, what: str, oldest: float = OLDEST) -> Any:
        time, value = self._values.get(what, (0.0, None))
        return value if node_time(self._node) - time < oldest else None

    def _view(self) -> MechanismView:
        driver: DiagnosticStatus | None = self._newest('driver', OLDEST_STATE)
        return MechanismView(
            head=self._newest('end_effector_pose'),
            corrected=self._newest('corrected_pose'),
            goal=self._values.get('goal_pose', (0.0, None))[1],
            disturbance=self._newest('disturbance') or Pose(0.0, 0.0, 0.0),
            wall=self._settings.wall_distance,
            level=LEVEL_NAMES[driver.level] if driver else 'stale',
            message=driver.message if driver else '')

    def _publish(self) -> None:
        picture = shapes(self._geometry, self._view())
        now = self._node.get_clock().now().to_msg()
        self._publisher.publish(MarkerArray(
            markers=[_marker(shape, now) for shape in picture]))


def _marker(shape: Shape, now) -> Marker:
    marker = Marker(
        ns=shape.name, id=0, type=KINDS[shape.kind], action=Marker.ADD,
        pose=pose_message(shape.pose), scale=Vector3(x=shape.size[0], y=shape.size[1],
                                                     z=shape.size[2]),
        lifetime=Duration(nanosec=int(OLDEST * 1e9)),
        points=[Point(x=x, y=y) for x, y in shape.points], text=shape.text)
    marker.color = ColorRGBA(**dict(zip('rgba', shape.colour, strict=True)))
    marker.header.frame_id = RAIL
    marker.header.stamp = now
    return marker
