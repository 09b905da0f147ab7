"""Two manipulators in two namespaces, each on its own bus, as processes of their own."""

from __future__ import annotations

import pytest
from qualities import LATEST
from std_msgs.msg import Bool
from support import wait_until

from facade_manipulator import config_path
from facade_manipulator.kinematics import Pose
from facade_manipulator.ros.client import ManipulatorClient, RequestRejectedError

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
        client.wait_until(lambda c=client: c.head_in_rail, f'the head of {namespace}')
    yield clients
    for client in clients.values():
        client.close()


def spin(clients):
    for client in clients.values():
        client.spin(0.02)


def test_each_gondola_moves_stops_and_rejects_for_itself_under_names_of_its_own(gondolas):
    assert_their_names_do_not_meet(gondolas[GONDOLAS[0]].node)
    first, second = (gondolas[name] for name in GONDOLAS)
    at_rest = second.head_in_rail
    move(gondolas, first, GOAL)
    assert second.head_in_rail == pytest.approx(at_rest, abs=1e-4)

    stop = second.node.create_publisher(Bool, 'software_stop', LATEST)
    second.wait_until(stop.get_subscription_count, 'the driver of gondola_2')
    stop.publish(Bool(data=True))
    wait_until(lambda: second.component('driver: operation').status.message.startswith('stopped'),
               'the stop of gondola_2', step=lambda: spin(gondolas))
    assert first.driver_state() == 'active' and second.driver_state() == 'inactive'
    with pytest.raises(RequestRejectedError, match='software_stop was set'):
        second.activate()

    move(gondolas, first, GOAL._replace(x=0.0))
    first.deactivate()


def move(gondolas, client, goal):
    client.send_goal(goal)
    wait_until(lambda: client.head_in_rail == pytest.approx(goal, abs=1e-3),
               f'the head at {goal}', step=lambda: spin(gondolas))


def assert_their_names_do_not_meet(node):
    topics = dict(node.get_topic_names_and_types())
    shared = {name for name in topics if not name.startswith(tuple(f'/{g}/' for g in GONDOLAS))}
    assert shared <= {'/diagnostics', '/parameter_events', '/rosout'}
    for namespace in GONDOLAS:
        assert f'/{namespace}/joint_setpoints' in topics
