"""
ik_service/linkage: goals, wall and state of the drives as markers, while somebody subscribes.

The mechanism itself is in robot_description; what is on the wall moves with TF's `facade`.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
import math
from typing import Any

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Vector3
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from facade_manipulator import interfaces, ros
from facade_manipulator.kinematics import compose, Pose, ZERO_POSE
from facade_manipulator.messages import Frames, readable_pose, status_level
from facade_manipulator.nodes.settings import LinkageSettings

PERIOD = 0.1  # s
OLDEST = 0.5  # s: an older corrected pose is not drawn, and markers vanish by themselves

# m, of what is drawn
CROSS_LENGTH, CROSS_WIDTH = 0.04, 0.004
WALL_LENGTH, WALL_DEPTH, WALL_HEIGHT = 4.0, 0.02, 0.3
TEXT_HEIGHT, TEXT_POSITION = 0.035, Pose(0.0, -0.12, 0.0)

Colour = tuple[float, float, float, float]  # red, green, blue and opacity, 0 to 1
# a colour-blind safe set (Okabe and Ito)
STATE_COLOURS = {
    'ok': (0.0, 0.45, 0.70, 1.0),
    'warn': (0.90, 0.62, 0.0, 1.0),
    'error': (0.84, 0.37, 0.0, 1.0),
    'stale': (0.6, 0.6, 0.6, 1.0),
}
WALL_COLOUR = (0.75, 0.72, 0.65, 0.6)
GOAL_COLOUR = (0.0, 0.62, 0.45, 1.0)
CORRECTED_COLOUR = (0.80, 0.47, 0.65, 1.0)


class LinkageView:
    """
    Publish the picture at 10 Hz while someone subscribes.

    While nobody does there is no timer and no subscription.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._frames = node, ros.frames(node)
        self._settings = ros.declare(
            node, LinkageSettings, 'linkage', partial(setattr, self, '_settings'))
        self._newest: dict[interfaces.Topic, tuple[float, Any]] = {}
        self._subscriptions: list[Any] = []
        self._timer = ros.steady_timer(node, PERIOD, self._publish, autostart=False)
        self._publisher = ros.publisher(node, interfaces.LINKAGE, self._match)

    def _match(self, matched: Any) -> None:
        if matched.current_count and not self._subscriptions:
            self.open()
        elif not matched.current_count and self._subscriptions:
            self._close()

    def open(self) -> None:
        """Begin to draw."""
        self._subscriptions = [
            ros.subscription(self._node, topic, partial(self._keep, topic)) for topic in (
                interfaces.GOAL_POSE, interfaces.CORRECTED_POSE, interfaces.DRIVER_STATUS)]
        self._timer.reset()

    def _close(self) -> None:
        self._timer.cancel()
        for one in self._subscriptions:
            self._node.destroy_subscription(one)
        self._subscriptions = []
        self._newest.clear()

    def _keep(self, topic: interfaces.Topic, message: Any) -> None:
        self._newest[topic] = ros.node_time(self._node), message

    def _recent(self, topic: interfaces.Topic, oldest: float) -> Any:
        time, message = self._newest.get(topic, (-math.inf, None))
        return message if ros.node_time(self._node) - time < oldest else None

    def _publish(self) -> None:
        picture = markers(
            self._frames, self._settings.wall_distance,
            readable_pose(self._recent(interfaces.GOAL_POSE, math.inf)),
            readable_pose(self._recent(interfaces.CORRECTED_POSE, OLDEST)),
            self._recent(interfaces.DRIVER_STATUS, ros.SILENCE))
        now = self._node.get_clock().now().to_msg()
        for marker in picture:
            marker.header.stamp = now
        self._publisher.publish(MarkerArray(markers=picture))


def markers(
    frames: Frames, wall: float = 0.3, goal: Pose | None = None, corrected: Pose | None = None,
    status: DiagnosticStatus | None = None,
) -> list[Marker]:
    """
    Return the picture.

    Parameters
    ----------
    frames : Frames
    wall : float
        Its distance from the rail in still air [m].
    goal, corrected : Pose or None
        On the wall, and as the rail has to see it.
    status : DiagnosticStatus or None
        Of the driver; None if it is silent.

    """
    face = Pose(0.0, wall + 0.5 * WALL_DEPTH, 0.0)
    colour = STATE_COLOURS[status_level(status) if status else 'stale']
    picture = [
        _marker('wall', Marker.CUBE, frames.facade, WALL_COLOUR,
                (WALL_LENGTH, WALL_DEPTH, WALL_HEIGHT), face),
        _marker('state', Marker.TEXT_VIEW_FACING, frames.rail, colour, (TEXT_HEIGHT,) * 3,
                TEXT_POSITION, status.message if status else 'the driver is silent'),
    ]
    if goal is not None:
        picture.append(_cross('goal', frames.facade, goal, GOAL_COLOUR))
    if corrected is not None:
        picture.append(_cross('corrected goal', frames.rail, corrected, CORRECTED_COLOUR))
    return picture


def _cross(name: str, frame: str, pose: Pose, colour: Colour) -> Marker:
    marker = _marker(name, Marker.LINE_LIST, frame, colour, (CROSS_WIDTH,) * 3)
    marker.points = [Point(x=point.x, y=point.y) for point in (
        compose(pose, Pose(x, y, 0.0)) for x, y in (
            (-CROSS_LENGTH, 0.0), (CROSS_LENGTH, 0.0), (0.0, -CROSS_LENGTH), (0.0, CROSS_LENGTH)))]
    return marker


def _marker(
    name: str, kind: int, frame: str, colour: Colour, size: Iterable[float],
    pose: Pose = ZERO_POSE, text: str = '',
) -> Marker:
    """Return a marker at its middle, which moves with its frame until the next one comes."""
    marker = Marker(
        ns=name, type=kind, action=Marker.ADD, pose=ros.pose_message(pose), text=text,
        scale=Vector3(**dict(zip('xyz', size, strict=True))),
        color=ColorRGBA(**dict(zip('rgba', colour, strict=True))),
        lifetime=Duration(nanosec=int(OLDEST * 1e9)), frame_locked=True)
    marker.header.frame_id = frame
    return marker
