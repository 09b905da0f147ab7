"""Nodes of the chain of setpoints while the system clock is set."""

from itertools import pairwise

from nodes.test_compensator import Neighbours
from nodes.test_disturbance_estimator import PERIOD, Sensors
from nodes.test_ik_service import Bench, MIDDLE
import pytest

from facade_manipulator import topics
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.conversions import ros_time
from facade_manipulator.nodes.planar_messages import seconds
from facade_manipulator.simulation.gondola_simulator import GondolaSimulatorNode

ESTIMATES = (*topics.DISTURBANCE[:2], topics.DISTURBANCE.subscription_qos)
STEPS = pytest.mark.parametrize('step', [-0.3, -0.05, 0.05, 0.3])


@STEPS
def test_approach_continues_forward_after_a_clock_step(ros, set_clock, step):
    bench = Bench(ros)
    bench.until_head(Pose(-0.05, 0.25, 0.0))
    bench.send(MIDDLE)
    bench.until(lambda: len(bench.setpoints) > 20, 'the approach')
    set_clock(step)
    bench.until(lambda: not bench.is_approaching, 'the end of the approach')
    q3 = [item.position[2] for item in bench.setpoints]
    moves = [after - before for before, after in pairwise(q3)]
    assert min(moves) >= -1e-9
    assert max(moves) < 0.02
    assert q3[-1] == pytest.approx(MIDDLE.x, abs=1e-3)


@STEPS
def test_stream_remains_a_stream_after_a_clock_step(ros, set_clock, step):
    bench = Bench(ros)
    bench.until_head(MIDDLE)
    approaches = []
    for number in range(30):
        if number == 15:
            set_clock(step)
        count = len(bench.setpoints)
        bench.send(MIDDLE, bench.now())
        bench.until(lambda before=count: len(bench.setpoints) > before, 'a setpoint')
        approaches.append(bench.is_approaching)
    assert not any(approaches[5:])


@STEPS
def test_estimate_continues_after_a_clock_step(ros, set_clock, step):
    sensors = Sensors(ros)
    sensors.timer = sensors.node.create_timer(PERIOD, sensors.measure)
    sensors.until_estimates(50)
    events = len(sensors.events())
    set_clock(step)
    sensors.until_estimates(150)
    newer = sensors.events()[events:]
    assert not any('restart' in text for text in newer)


@STEPS
def test_path_continues_after_a_clock_step(ros, set_clock, step):
    neighbours = Neighbours(ros)
    neighbours.repeat(neighbours.estimate)
    neighbours.send_goal()
    ros.until(lambda: len(neighbours.corrected) > 50, 'corrected poses')
    before = neighbours.compensation.initialisations
    set_clock(step)
    count = len(neighbours.corrected) + 50
    ros.until(lambda: len(neighbours.corrected) > count, 'more corrected poses')
    assert neighbours.compensation.initialisations == before
    assert neighbours.compensation.correction.mode is CorrectionMode.ACTIVE


@pytest.mark.parametrize('step', [-3600.0, 3600.0])
def test_simulated_world_continues_after_a_clock_step(ros, set_clock, step):
    ros.add(GondolaSimulatorNode())
    estimates = ros.collect(ros.node(), *ESTIMATES)
    ros.until(lambda: len(estimates) > 20, 'estimates')
    set_clock(step)
    count = len(estimates) + 50
    ros.until(lambda: len(estimates) > count, 'more estimates')
    age = ros_time() - seconds(estimates[-1].header.stamp)
    assert abs(age) < 1.0
