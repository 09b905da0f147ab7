"""A stroke says when it is done: goals through the real nodes and simulated drives."""

from __future__ import annotations

import pytest

from facade_manipulator import config_path
from facade_manipulator.kinematics import Pose
from facade_manipulator.ros.client import ManipulatorClient, NoAnswerError, RequestRejectedError

NAMESPACE = '/gondola_1'
NEAR, FAR, OUTSIDE = Pose(0.05, 0.25, 0.0), Pose(-0.2, 0.25, 0.0), Pose(0.0, 0.6, 0.0)


@pytest.fixture
def client(ros, start_process):
    """Return a supervisor of nodes whose drives are active."""
    for name in ('driver', 'manipulator'):
        start_process(
            f'facade_manipulator.nodes.{name}', '--ros-args', '-r', f'__ns:={NAMESPACE}',
            *(part for file in ('manipulator.yaml', 'simulation.yaml')
              for part in ('--params-file', str(config_path(file)))))
    with ManipulatorClient(NAMESPACE) as made:
        made.wait_until(lambda: made.component('driver: operation'), 'the driver', 20.0)
        yield made
        if made.driver_state() == 'active':
            made.deactivate()


def test_a_stroke_of_goals_is_reached_held_rejected_and_ended(client):
    with pytest.raises(RequestRejectedError, match='the drives are unconfigured'):
        client.go_to(NEAR)
    client.configure()
    client.home()
    client.activate()
    seen = []
    client.go_to(NEAR, FAR, timeout=20.0, on_progress=lambda *what: seen.append(what))
    assert {(0, 'moving'), (0, 'reached'), (1, 'moving'), (1, 'reached')} <= {
        (number, status.message) for number, status in seen}
    values = {item.key: item.value for item in seen[-1][1].values}
    assert float(values['distance [mm]']) < 5.0
    with pytest.raises(RequestRejectedError, match='rejected: '):
        client.go_to(OUTSIDE)
    with pytest.raises(NoAnswerError, match=r'not reached within 0\.1 s'):
        client.go_to(NEAR, timeout=0.1)
    assert 'stays on the wall at' in client.hold()
    with pytest.raises(RequestRejectedError, match='the drives are halt'):
        client.go_to(NEAR, on_progress=lambda number, status: (
            status.message == 'moving' and client.halt()))
