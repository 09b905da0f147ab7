"""What the manipulator is doing, as a table in the terminal: the monitor and the demo's view."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import math
import sys
import time

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text
from sensor_msgs.msg import JointState

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES, planar_pose, status_values
from facade_manipulator.ros import (
    Component,
    followed_goal,
    GOAL_STATUS,
    LATCHED,
    LATEST,
    ManipulatorClient,
    RELIABLE,
)

REFRESH_PERIOD = 0.25
SILENT_AFTER = 2.5  # s without diagnostics of a component, which come once a second
OLD_AFTER = 1.0  # s after which a pose is no longer shown
LEVEL_STYLES = {b'\x00': 'green', b'\x01': 'yellow', b'\x02': 'bold red', b'\x03': 'magenta'}
SILENT_STYLE = 'bold magenta'
POSES = {
    GOAL_STATUS: 'goal on the wall',
    'corrected_pose': 'corrected goal',
    'end_effector_pose': 'head, from the rail',
    'gondola_simulator/uncompensated_error': 'disturbance at the goal',
    'gondola_simulator/wall_error': 'error on the wall',
}
PROFILES = {'corrected_pose': LATEST}
# what is shown of a component beside its message: diagnostic key, and how it is written
DETAILS = {
    'driver: operation': (
        ('drive faults', 'faults: {}'), ('rejected', '{} setpoints rejected')),
    'driver: bus': (
        ('cycles', '{} cycles'), ('missed cycles', '{} missed'),
        ('worst lateness [ms]', '≤ {} ms late'), ('worst-case load [%]', '{} % load')),
    'compensator: correction': (
        ('rejected', '{} rejected'), ('age of the estimate [ms]', 'estimate {} ms old')),
    'ik_service: goal': (('setpoints', '{} setpoints'), ('rejected', '{} goals rejected')),
}
OTHER_DETAILS = (('rejected', '{} rejected'),)


class Observer:
    """
    Keep the newest of everything a person wants to see of one manipulator.

    Parameters
    ----------
    client : ManipulatorClient
        Its node takes the subscriptions and its `spin` keeps them going.

    """

    def __init__(self, client: ManipulatorClient) -> None:
        self.client = client
        self.poses: dict[str, Pose | None] = {}  # None where there is none to be shown
        self.joints: JointState | None = None
        self._received_at: dict[str, float] = {}
        for topic in POSES.keys() - {GOAL_STATUS}:
            self._watch(client.node, topic)
        client.node.create_subscription(
            DiagnosticStatus, GOAL_STATUS, self._receive_goal, LATCHED)
        client.node.create_subscription(
            JointState, 'joint_states', self._receive_joints, RELIABLE)

    def _watch(self, node: Node, topic: str) -> None:
        def receive(message: PoseStamped) -> None:
            self._received_at[topic] = time.monotonic()
            try:
                self.poses[topic] = planar_pose(message.pose, topic)
            except ManipulatorError:
                self.poses[topic] = None  # the node that rejects it says why

        node.create_subscription(PoseStamped, topic, receive, PROFILES.get(topic, RELIABLE))

    def _receive_goal(self, status: DiagnosticStatus) -> None:
        self._received_at[GOAL_STATUS] = math.inf  # a goal stays until another is followed
        self.poses[GOAL_STATUS] = followed_goal(status)

    def _receive_joints(self, message: JointState) -> None:
        self._received_at['joint_states'] = time.monotonic()
        self.joints = message

    def is_old(self, topic: str) -> bool:
        """Return whether the newest message of a topic is too old to be shown."""
        return time.monotonic() - self._received_at.get(topic, -math.inf) > OLD_AFTER

    def value(self, component: str, key: str) -> str | None:
        """Return one value of a component's diagnostics, None before one came."""
        known = self.client.component(component)
        return status_values(known.status).get(key) if known else None

    def count(self, component: str, key: str) -> int:
        """Return one counter of a component's diagnostics, 0 before one came."""
        return int(self.value(component, key) or 0)

    def rejected(self) -> int:
        """Return how many messages the nodes have rejected."""
        return sum(
            self.count(name, 'rejected')
            for name in ('driver: operation', 'ik_service: goal', 'compensator: correction'))


def render(observer: Observer, headline: str) -> Group:
    """Return the view of this moment; it fits a terminal of 80 by 24."""
    return Group(
        Text(headline, style='bold'), _pose_table(observer), _carriage_table(observer),
        _component_table(observer),
        Text())  # an empty line: the terminal writes ^C where the view ends, and may break there


def _pose_table(observer: Observer) -> Table:
    return _table(('pose', '>x [mm]', '>y [mm]', '>θ [°]'), (
        (title, f'{1e3 * pose.x:+.1f}', f'{1e3 * pose.y:+.1f}', f'{math.degrees(pose.theta):+.2f}')
        for topic, title in POSES.items()
        if (pose := observer.poses.get(topic)) is not None and not observer.is_old(topic)))


def _carriage_table(observer: Observer) -> Table:
    return _table(
        ('carriage', '>position [mm]', '>speed [mm/s]', '>force [N]', '>lag [mm]', 'drive'),
        ((name, *_motion(observer, name), _lag(observer, name), _message(
            observer, observer.client.component(f'driver: {name}'))) for name in CARRIAGES))


def _lag(observer: Observer, name: str) -> str:
    lag = _number(observer.value(f'driver: {name}', 'following error [m]'))
    return '-' if lag is None else f'{1e3 * lag:+.2f}'


def _motion(observer: Observer, name: str) -> tuple[str, str, str]:
    joints = observer.joints
    if joints is None or observer.is_old('joint_states') or name not in joints.name:
        return ('-', '-', '-')
    index = joints.name.index(name)
    return (f'{1e3 * joints.position[index]:+.2f}', f'{1e3 * joints.velocity[index]:+.1f}',
            f'{joints.effort[index]:+.1f}')


def _component_table(observer: Observer) -> Table:
    components = observer.client.components
    others = sorted(set(components) - set(DETAILS) - {f'driver: {name}' for name in CARRIAGES})
    return _table(('component', 'state', 'so far'), (
        (name, _message(observer, components[name]), _details(name, components[name]))
        for name in (*DETAILS, *others) if name in components))


def _message(observer: Observer, component: Component | None) -> Text:
    """Return what a component says of itself, or that it says nothing yet or any more."""
    if component is None:
        return Text('no diagnostics yet', style='magenta')
    if (age := observer.client.age(component)) > SILENT_AFTER:
        return Text(f'silent for {age:.0f} s', style=SILENT_STYLE)
    status = component.status
    return Text(status.message, style=LEVEL_STYLES.get(status.level, ''))


def _details(name: str, component: Component) -> Text:
    values = status_values(component.status)
    return Text(', '.join(
        text.format(_short(values[key]))
        for key, text in DETAILS.get(name, OTHER_DETAILS)
        if values.get(key, 'inf') != 'inf'))


def _short(value: str) -> str:
    number = _number(value)
    return value if number is None or number.is_integer() else f'{number:.3g}'


def _number(value: str | None) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def _table(names: Iterable[str], rows: Iterable[Iterable[str | Text]]) -> Table:
    """Return a table with a line under its head; ``>`` before a name: numbers, to the right."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0), show_edge=False)
    for name in names:  # Text: a unit in brackets would be taken for markup
        table.add_column(Text(name.removeprefix('>')),
                         justify='right' if name.startswith('>') else 'left')
    for row in rows:
        table.add_row(*row)
    return table


def main(args: list[str] | None = None) -> int:
    """Watch a manipulator until Ctrl-C."""
    words = remove_ros_args(args=sys.argv if args is None else ['monitor', *args])[1:]
    parser = argparse.ArgumentParser(
        prog='monitor', description='Watch a manipulator in the terminal until Ctrl-C.')
    parser.add_argument('--namespace', default='', help="namespace of the manipulator's nodes")
    options = parser.parse_args(words)
    try:
        rclpy.init(args=args)
        with ManipulatorClient(options.namespace, 'monitor') as client:
            _watch(client, options.namespace or '/')
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        rclpy.try_shutdown()
    return 0


def _watch(client: ManipulatorClient, namespace: str) -> None:
    observer = Observer(client)
    headline = f'manipulator in namespace {namespace}   (Ctrl-C ends the view, not the machine)'
    with Live(console=Console(), auto_refresh=False) as live:
        while rclpy.ok():
            client.spin(REFRESH_PERIOD)
            live.update(render(observer, headline), refresh=True)


if __name__ == '__main__':
    raise SystemExit(main())
