"""Two manipulators in two namespaces, each on its own bus, as separate processes."""

from __future__ import annotations

from collections import deque

import pytest
from std_msgs.msg import Bool

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient, RequestRejectedError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_pose
from facade_manipulator.topics import LATEST

GONDOLAS = ('gondola_1', 'gondola_2')
GOAL = Pose(0.05, 0.25, 0.0)


@pytest.fixture
def gondolas(start_process, ros):
    """Start driver and manipulator of two gondolas, drives on, and give a client of each."""
    clients = {}
    for namespace in GONDOLAS:
        for module in ('driver', 'manipulator'):
            start_process(
                f'facade_manipulator.nodes.{module}', '--ros-args', '-r', f'__ns:=/{namespace}',
                '--params-file', str(config_path('manipulator.yaml')),
                '--params-file', str(config_path('simulation.yaml')))
    for namespace in GONDOLAS:
        client = clients[namespace] = ManipulatorClient(namespace)
        client.configure()
        client.home()
        client.activate()
        client.heads = heads_of(client.node)
        client.wait_until(lambda c=client: c.heads, f'the head of {namespace}')
    yield clients
    for client in clients.values():
        client.close()


def heads_of(node):
    """Return the newest pose of the head in a list that is kept up to date."""
    heads = deque(maxlen=1)
    topic = topics.END_EFFECTOR_POSE
    node.create_subscription(
        topic.type, topic.name, lambda message: heads.append(planar_pose(message.pose, 'head')),
        topic.qos)
    return heads


def test_two_gondolas_move_and_stop_independently(gondolas):
    assert_their_names_do_not_meet(gondolas[GONDOLAS[0]].node)
    first, second = (gondolas[name] for name in GONDOLAS)
    at_rest = second.heads[-1]
    move(first, GOAL)
    assert second.heads[-1] == pytest.approx(at_rest, abs=1e-4)

    stop = second.node.create_publisher(Bool, 'software_stop', LATEST)
    second.wait_until(stop.get_subscription_count, 'the driver of gondola_2')
    stop.publish(Bool(data=True))
    second.wait_until(lambda: second.driver_state() == 'inactive', 'the stop of gondola_2')
    assert first.driver_state() == 'active' and second.driver_state() == 'inactive'
    with pytest.raises(RequestRejectedError, match='software_stop was set'):
        second.activate()

    move(first, GOAL._replace(x=0.0))
    first.deactivate()


def move(client, goal):
    client.send_goal(goal)
    client.wait_until(
        lambda: client.heads[-1] == pytest.approx(goal, abs=1e-3), f'the head at {goal}', 20.0)


def assert_their_names_do_not_meet(node):
    known = dict(node.get_topic_names_and_types())
    shared = {name for name in known if not name.startswith(tuple(f'/{g}/' for g in GONDOLAS))}
    assert shared <= {'/diagnostics', '/parameter_events', '/rosout'}
    for namespace in GONDOLAS:
        assert f'/{namespace}/joint_setpoints' in known
