"""Two manipulators in two namespaces, each on its own bus, as separate processes."""

from __future__ import annotations

from collections import deque
import os
import signal

import pytest
from std_msgs.msg import Bool

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient, RequestRejectedError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.messages import planar_pose, status_values

GONDOLAS = ('gondola_1', 'gondola_2')
NEAR, FAR, OUTSIDE = Pose(0.05, 0.25, 0.0), Pose(-0.2, 0.25, 0.0), Pose(0.0, 0.6, 0.0)


def latest(client, topic):
    """Return the newest message of a topic in a list that is kept up to date."""
    messages = deque(maxlen=1)
    client.node.create_subscription(
        topic.type, topic.name, lambda message: messages.append(message), topic.qos)
    return messages


@pytest.fixture
def gondolas(start_process, ros):
    """Start driver and manipulator of two gondolas, and give a client of each."""
    clients, drivers = [], []
    for namespace in GONDOLAS:
        for module in ('manipulator', 'driver'):
            process = start_process(
                f'facade_manipulator.nodes.{module}', '--ros-args', '-r', f'__ns:=/{namespace}',
                '--params-file', str(config_path('manipulator.yaml')),
                '--params-file', str(config_path('simulation.yaml')))
        drivers.append(process)
    for namespace in GONDOLAS:
        client = ManipulatorClient(namespace)
        client.heads = latest(client, topics.END_EFFECTOR_POSE)
        client.statuses = latest(client, topics.GOAL_STATUS)
        clients.append(client)
    yield clients, drivers
    for client in clients:
        client.close()


def activate(client):
    client.configure()
    client.home()
    client.activate()
    client.wait_until(lambda: client.heads, 'the pose of the head')


def head_of(client):
    return planar_pose(client.heads[-1].pose, 'head')


def until_ended(client, reason):
    client.wait_until(lambda: reason in client.statuses[-1].message, f'the end: {reason}', 20.0)


def test_two_gondolas_move_and_stop_independently(gondolas):
    (first, second), drivers = gondolas
    with pytest.raises(RequestRejectedError, match='the drives are unconfigured'):
        first.go_to(NEAR)
    activate(first)
    activate(second)
    known = {name for name, _ in first.node.get_topic_names_and_types()}
    own = tuple(f'/{name}/' for name in GONDOLAS)
    assert {f'{name}joint_setpoints' for name in own} <= known
    assert {name for name in known if not name.startswith(own)} <= {
        '/diagnostics', '/parameter_events', '/rosout'}

    at_rest = head_of(second)
    first.go_to(FAR, NEAR, timeout=20.0)
    assert float(status_values(first.statuses[-1])['distance [mm]']) < 5.0
    assert head_of(first) == pytest.approx(NEAR, abs=5e-3)
    assert head_of(second) == pytest.approx(at_rest, abs=1e-4)

    stop = second.node.create_publisher(Bool, 'software_stop', topics.LATEST)
    second.wait_until(stop.get_subscription_count, 'the driver of gondola_2')
    stop.publish(Bool(data=True))
    second.wait_until(lambda: second.driver_state() == 'inactive', 'the stop of gondola_2')
    assert first.driver_state() == 'active'
    with pytest.raises(RequestRejectedError, match='software_stop was set'):
        second.activate()

    with pytest.raises(RequestRejectedError, match='rejected: '):
        first.go_to(OUTSIDE)
    first.send_goal(FAR)
    first.halt()
    until_ended(first, 'ended: the drives are halt')
    first.clear_faults()
    first.send_goal(FAR)
    os.killpg(drivers[0].pid, signal.SIGKILL)
    drivers[0].wait()
    until_ended(first, 'ended: the driver is silent')
