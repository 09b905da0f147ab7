"""A stroke says when it is done: goals through the real nodes and simulated drives."""

from __future__ import annotations

import os
import signal

from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient, NoAnswerError, RequestRejectedError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import status_values

NAMESPACE = '/gondola_1'
NEAR, FAR, OUTSIDE = Pose(0.05, 0.25, 0.0), Pose(-0.2, 0.25, 0.0), Pose(0.0, 0.6, 0.0)


@pytest.fixture
def client(ros, start_process):
    """Return a supervisor of nodes whose drives are active."""
    processes = [
        start_process(
            f'facade_manipulator.nodes.{name}', '--ros-args', '-r', f'__ns:={NAMESPACE}',
            *(part for file in ('manipulator.yaml', 'simulation.yaml')
              for part in ('--params-file', str(config_path(file)))))
        for name in ('driver', 'manipulator')]
    with ManipulatorClient(NAMESPACE) as made:
        made.driver = processes[0]
        yield made
        if made.driver.poll() is None and made.driver_state() == 'active':
            made.deactivate()


@pytest.fixture
def statuses(client):
    """Return the statuses of goals, a list that grows while the client receives."""
    received: list[DiagnosticStatus] = []
    topic = topics.GOAL_STATUS
    client.node.create_subscription(topic.type, topic.name, received.append, topic.qos)
    return received


def test_goals_are_reached_held_rejected_and_ended(client, statuses):
    with pytest.raises(RequestRejectedError, match='the drives are unconfigured'):
        client.go_to(NEAR)
    client.configure()
    client.home()
    client.activate()
    statuses.clear()
    client.go_to(NEAR, FAR, timeout=20.0)
    seen = [status_values(status) for status in statuses]
    for stamp in {one['goal stamp'] for one in seen[-1:]} | {seen[0]['goal stamp']}:
        assert {'moving', 'reached'} <= {
            one['state'] for one in seen if one['goal stamp'] == stamp}
    assert float(seen[-1]['distance [mm]']) < 5.0
    with pytest.raises(RequestRejectedError, match='rejected: '):
        client.go_to(OUTSIDE)
    with pytest.raises(NoAnswerError, match=r'timed out after 0\.1 s waiting for the goal: '):
        client.go_to(NEAR, timeout=0.1)
    stamp = client.send_goal(NEAR)
    client.halt()
    client.wait_until(
        lambda: 'ended' in states(statuses, stamp), 'the end of the goal', 20.0)


def test_killed_driver_is_reported_as_silent(client, statuses):
    client.configure()
    client.home()
    client.activate()
    stamp = client.send_goal(FAR)
    os.killpg(client.driver.pid, signal.SIGKILL)
    client.driver.wait()
    client.wait_until(lambda: 'ended' in states(statuses, stamp), 'the end of the goal', 20.0)
    assert any('the driver is silent' in status.message for status in statuses)


def states(statuses: list[DiagnosticStatus], stamp: str) -> set[str]:
    values = map(status_values, list(statuses))
    return {one['state'] for one in values if one['goal stamp'] == stamp}
