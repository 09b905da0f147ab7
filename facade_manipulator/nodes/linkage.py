"""ik_service/linkage: the manipulator as markers, drawn only while somebody subscribes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
import math
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Vector3
from rclpy.node import Node
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from facade_manipulator import interfaces
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.interfaces import Topic
from facade_manipulator.kinematics import (
    compose,
    Geometry,
    joints,
    mechanism_of,
    Pose,
    relative,
    ZERO_POSE,
)
from facade_manipulator.messages import pose_numbers, projected, RAIL
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.ros import (
    declare,
    LEVELS,
    node_time,
    pose_message,
    publisher,
    steady_timer,
    subscription,
)

# s
PERIOD = 0.1
OLDEST = 0.5  # s: what is older is not drawn, and markers vanish by themselves
OLDEST_STATE = 2.5  # s: /diagnostics comes once a second
POSES = (interfaces.END_EFFECTOR_POSE, interfaces.CORRECTED_POSE, interfaces.GOAL_POSE,
         interfaces.DISTURBANCE, interfaces.DISTURBANCE_ODOMETRY)
LEVEL_NAMES = {value: name for name, value in LEVELS.items()}

Colour = tuple[float, float, float, float]  # red, green, blue and opacity, 0 to 1

# m, of what is drawn
RAIL_DEPTH, RAIL_HEIGHT = 0.03, 0.02
CARRIAGE_DEPTH, CARRIAGE_HEIGHT = 0.05, 0.03
THINNEST_CARRIAGE = 0.004
LINK_WIDTH, PLATFORM_WIDTH, GUIDE_WIDTH = 0.012, 0.018, 0.006
HEAD_LENGTH, HEAD_WIDTH = 0.06, 0.012
CROSS_LENGTH, CROSS_WIDTH = 0.04, 0.004
WALL_LENGTH, WALL_DEPTH, WALL_HEIGHT = 4.0, 0.02, 0.3
TEXT_HEIGHT, TEXT_POSITION = 0.035, (0.0, -0.12)

# a colour-blind safe set (Okabe and Ito), the last number being the opacity
STATE_COLOURS = {
    'ok': (0.0, 0.45, 0.70, 1.0),
    'warn': (0.90, 0.62, 0.0, 1.0),
    'error': (0.84, 0.37, 0.0, 1.0),
    'stale': (0.6, 0.6, 0.6, 0.5),
}
# red, green, blue, opacity
RAIL_COLOUR = (0.35, 0.35, 0.35, 1.0)
GUIDE_COLOUR = (0.6, 0.6, 0.6, 1.0)
WALL_COLOUR = (0.75, 0.72, 0.65, 0.6)
GOAL_COLOUR = (0.0, 0.62, 0.45, 1.0)
CORRECTED_COLOUR = (0.80, 0.47, 0.65, 1.0)
TEXT_COLOUR = (0.9, 0.9, 0.9, 1.0)


@settings
class LinkageSettings:
    """What the picture cannot know by itself."""

    wall_distance: float = parameter(
        'Distance of the wall from the rail in still air, for the picture alone', default=0.3,
        unit='m', minimum=-10.0, maximum=10.0)


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
        self._publisher = publisher(node, interfaces.LINKAGE, self._match)

    def _match(self, matched: Any) -> None:
        if matched.current_count and not self._subscriptions:
            self._open()
        elif not matched.current_count and self._subscriptions:
            self._close()

    def _open(self) -> None:
        self._subscriptions = [
            subscription(self._node, interfaces.DIAGNOSTICS, self._receive_diagnostics),
            *(subscription(self._node, topic, partial(self._receive_pose, topic))
              for topic in POSES)]
        self._timer.reset()

    def _close(self) -> None:
        self._timer.cancel()
        for one in self._subscriptions:
            self._node.destroy_subscription(one)
        self._subscriptions = []
        self._values.clear()

    def _receive_pose(self, topic: Topic, message: Any) -> None:
        """Keep a pose, with or without a covariance; of an odometry only that of the rail."""
        if getattr(message, 'child_frame_id', RAIL) != RAIL:
            return
        what = topic.name.removesuffix('_odometry')
        try:
            pose = getattr(message.pose, 'pose', message.pose)
            self._keep(what, projected(pose_numbers(pose), what)[0])
        except ManipulatorError:
            self._values.pop(what, None)  # the node that rejects it says why

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
        picture = markers(self._geometry, self._view())
        now = self._node.get_clock().now().to_msg()
        for marker in picture:
            marker.header.stamp = now
        self._publisher.publish(MarkerArray(markers=picture))


class MechanismView(NamedTuple):
    """What is to be seen."""

    head: Pose | None = None  #: in frame `rail`; None when no pose has come lately
    corrected: Pose | None = None  #: the goal as the rail has to see it, in frame `rail`
    goal: Pose | None = None  #: on the wall, in frame `facade`
    disturbance: Pose = ZERO_POSE  #: pose of `rail` in `facade`
    wall: float = 0.3  #: its distance from the rail in still air [m]
    level: str = 'stale'  #: colour of the linkage: a key of `STATE_COLOURS`
    message: str = ''  #: what the drives are doing


def markers(geometry: Geometry, view: MechanismView) -> list[Marker]:
    """
    Return the picture of a view.

    Everything is given as seen from the rail: the wall and the goal on it move when the gondola
    does, the head should move with them.
    """
    least, greatest = geometry.stroke
    face = Pose(0.0, view.wall + 0.5 * WALL_DEPTH, 0.0)
    picture = [
        _marker('rail', Marker.CUBE, RAIL_COLOUR,
                (geometry.stroke_length, RAIL_DEPTH, RAIL_HEIGHT),
                Pose(0.5 * (least + greatest), 0.0, 0.0)),
        _marker('wall', Marker.CUBE, WALL_COLOUR, (WALL_LENGTH, WALL_DEPTH, WALL_HEIGHT),
                relative(view.disturbance, face)),
        _marker('state', Marker.TEXT_VIEW_FACING, TEXT_COLOUR, (TEXT_HEIGHT,) * 3,
                Pose(*TEXT_POSITION, 0.0), text=view.message or 'no diagnostics of the driver'),
    ]
    if view.goal is not None:
        picture.append(_cross('goal', relative(view.disturbance, view.goal), GOAL_COLOUR))
    if view.corrected is not None:
        picture.append(_cross('corrected goal', view.corrected, CORRECTED_COLOUR))
    if view.head is not None:
        picture += _linkage(geometry, view.head, STATE_COLOURS[view.level])
    return picture


def _cross(name: str, pose: Pose, colour: Colour) -> Marker:
    return _lines(name, colour, CROSS_WIDTH, (
        compose(pose, Pose(x, y, 0.0))[:2] for x, y in (
            (-CROSS_LENGTH, 0.0), (CROSS_LENGTH, 0.0), (0.0, -CROSS_LENGTH), (0.0, CROSS_LENGTH))))


def _linkage(geometry: Geometry, head: Pose, colour: Colour) -> list[Marker]:
    """Return carriages as wide as their gap, so that they touch where they must stop."""
    try:
        at = joints(geometry, mechanism_of(geometry).platform(head))
    except ManipulatorError:
        return []  # whoever published that pose says why
    width = max(geometry.carriage_gap, THINNEST_CARRIAGE)
    return [
        *(_marker(f'carriage {name}', Marker.CUBE, colour,
                  (width, CARRIAGE_DEPTH, CARRIAGE_HEIGHT), Pose(x, 0.0, 0.0))
          for name, (x, _) in (('q1', at.a1), ('q2', at.a2), ('q3', at.a3))),
        _lines('guide', GUIDE_COLOUR, GUIDE_WIDTH, (at.a3, at.p)),
        _lines('links', colour, LINK_WIDTH, (at.a1, at.b1, at.a2, at.b2)),
        _lines('platform', colour, PLATFORM_WIDTH, (at.b1, at.b2)),
        _marker('end effector', Marker.ARROW, colour, (HEAD_LENGTH, HEAD_WIDTH, HEAD_WIDTH),
                head._replace(theta=head.theta + 0.5 * math.pi)),
    ]


def _lines(
    name: str, colour: Colour, width: float, ends: Iterable[tuple[float, float]]
) -> Marker:
    """Return lines between ends, two each [m]."""
    marker = _marker(name, Marker.LINE_LIST, colour, (width,) * 3)
    marker.points = [Point(x=x, y=y) for x, y in ends]
    return marker


def _marker(
    name: str, kind: int, colour: Colour, size: tuple[float, ...], pose: Pose = ZERO_POSE,
    text: str = '',
) -> Marker:
    """Return a marker at its middle, an arrow at its start, which points along its own x."""
    marker = Marker(
        ns=name, type=kind, action=Marker.ADD, pose=pose_message(pose), text=text,
        scale=Vector3(**dict(zip('xyz', size, strict=True))),
        color=ColorRGBA(**dict(zip('rgba', colour, strict=True))),
        lifetime=Duration(nanosec=int(OLDEST * 1e9)))
    marker.header.frame_id = RAIL
    return marker
