"""A stroke says when it is done: goals through the real nodes and simulated drives."""

from __future__ import annotations

import os
import signal

import pytest

from facade_manipulator import config_path
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import status_values
from facade_manipulator.ros.client import ManipulatorClient, NoAnswerError, RequestRejectedError

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
        made.wait_until(lambda: made.component('driver: operation'), 'the driver', 20.0)
        made.driver = processes[0]
        yield made
        if made.driver.poll() is None and made.driver_state() == 'active':
            made.deactivate()


def states(client: ManipulatorClient, stamp: str) -> set[str]:
    values = map(status_values, client._progress)
    return {one['state'] for one in values if one['goal stamp'] == stamp}


def test_a_stroke_of_goals_is_reached_held_rejected_and_ended(client):
    with pytest.raises(RequestRejectedError, match='the drives are unconfigured'):
        client.go_to(NEAR)
    client.configure()
    client.home()
    client.activate()
    seen = []
    client.go_to(NEAR, FAR, timeout=20.0, on_progress=lambda *what: seen.append(what))
    assert {(0, 'moving'), (0, 'reached'), (1, 'moving'), (1, 'reached')} <= {
        (number, status_values(status)['state']) for number, status in seen}
    assert float(status_values(seen[-1][1])['distance [mm]']) < 5.0
    with pytest.raises(RequestRejectedError, match='rejected: '):
        client.go_to(OUTSIDE)
    with pytest.raises(NoAnswerError, match=r'not reached within 0\.1 s'):
        client.go_to(NEAR, timeout=0.1)
    assert 'stays on the wall at' in client.hold()
    with pytest.raises(RequestRejectedError, match='the drives are halt'):
        client.go_to(NEAR, on_progress=lambda number, status: (
            status_values(status)['state'] == 'moving' and client.halt()))


def test_a_killed_driver_is_silent_to_whoever_watches_the_goal(client):
    client.configure()
    client.home()
    client.activate()
    stamp = client.send_goal(FAR)
    os.killpg(client.driver.pid, signal.SIGKILL)
    client.driver.wait()
    client.wait_until(lambda: 'ended' in states(client, stamp), 'the end of the goal', 20.0)
    assert any('the driver is silent' in status.message for status in client._progress)
    client.wait_until(lambda: 'silent' in client.goal_status.message, 'ik_service/status')
