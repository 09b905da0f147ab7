"""What the manipulator is doing, as a table in the terminal: the monitor and the demo's view."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
import math
import sys

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.utilities import remove_ros_args
from rich.console import Console, Group
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text
from sensor_msgs.msg import JointState

from facade_manipulator.client import ManipulatorClient
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.conversions import planar_pose
from facade_manipulator.nodes.runtime import LATEST, RELIABLE

REFRESH_PERIOD = 0.25
LEVEL_STYLES = {b'\x00': 'green', b'\x01': 'yellow', b'\x02': 'red', b'\x03': 'magenta'}
POSES = {
    'goal_pose': 'goal on the wall',
    'corrected_pose': 'corrected goal',
    'end_effector_pose': 'head, from the rail',
    'gondola_simulator/uncompensated_error': 'disturbance at the goal',
    'gondola_simulator/wall_error': 'error on the wall',
}
PROFILES = {'goal_pose': LATEST, 'corrected_pose': LATEST}


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
        self.poses: dict[str, Pose] = {}
        self.joints: JointState | None = None
        for topic in POSES:
            self._watch(client.node, topic)
        client.node.create_subscription(
            JointState, 'joint_states', self._take_joints, RELIABLE)

    def _watch(self, node: Node, topic: str) -> None:
        def take(message: PoseStamped) -> None:
            try:
                self.poses[topic] = planar_pose(message.pose, topic)
            except ManipulatorError:
                self.poses.pop(topic, None)  # the node that refuses it says why

        node.create_subscription(PoseStamped, topic, take, PROFILES.get(topic, RELIABLE))

    def _take_joints(self, message: JointState) -> None:
        self.joints = message

    def value(self, component: str, key: str) -> str | None:
        """Return one value of a component's diagnostics, None before it was heard."""
        known = self.client.component(component)
        values = {item.key: item.value for item in known.status.values} if known else {}
        return values.get(key)

    def count(self, component: str, key: str) -> int:
        """Return one counter of a component's diagnostics, 0 before it was heard."""
        return int(self.value(component, key) or 0)

    def refused(self) -> int:
        """Return how many messages the nodes have refused."""
        return sum(
            self.count(name, 'refused')
            for name in ('driver: operation', 'ik_service: goal', 'compensator: correction'))


def render(observer: Observer, headline: str) -> Group:
    """Return the view of this moment."""
    return Group(
        Text(headline, style='bold'), _pose_table(observer), _carriage_table(observer),
        _component_table(observer.client.components.values()))


def _pose_table(observer: Observer) -> Table:
    table = Table('pose', *(_right(name) for name in ('x [mm]', 'y [mm]', 'θ [°]')))
    for topic, title in POSES.items():
        pose = observer.poses.get(topic)
        if pose is not None:
            table.add_row(title, f'{1e3 * pose.x:+.1f}', f'{1e3 * pose.y:+.1f}',
                          f'{math.degrees(pose.theta):+.2f}')
    return table


def _carriage_table(observer: Observer) -> Table:
    table = Table('carriage', *(_right(name) for name in (
        'position [mm]', 'speed [mm/s]', 'force [N]')))
    joints = observer.joints
    if joints is not None:
        rows = zip(joints.name, joints.position, joints.velocity, joints.effort, strict=True)
        for name, position, speed, force in rows:
            table.add_row(name, f'{1e3 * position:+.2f}', f'{1e3 * speed:+.1f}', f'{force:+.1f}')
    return table


def _component_table(components: Iterable) -> Table:
    table = Table('component', 'state', _right('cycles'), _right('missed'), _right('refused'))
    for component in components:
        table.add_row(*_component_row(component.status))
    return table


def _component_row(status: DiagnosticStatus) -> tuple:
    values = {item.key: item.value for item in status.values}
    sentence = Text(status.message, style=LEVEL_STYLES.get(status.level, ''))
    return (status.name, sentence,
            *(values.get(key, '') for key in ('cycles', 'missed cycles', 'refused')))


def _right(name: str) -> Column:
    return Column(name, justify='right')


def main(args: list[str] | None = None) -> int:
    """Watch a manipulator until Ctrl-C."""
    words = remove_ros_args(args=sys.argv if args is None else ['monitor', *args])[1:]
    parser = argparse.ArgumentParser(
        prog='monitor', description='Watch a manipulator in the terminal until Ctrl-C.')
    parser.add_argument('--namespace', default='', help="namespace of the manipulator's nodes")
    options = parser.parse_args(words)
    rclpy.init(args=args)
    try:
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
