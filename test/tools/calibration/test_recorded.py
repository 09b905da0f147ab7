"""What is read from a file of the recorder."""

import math
from types import SimpleNamespace as Message

import numpy as np
import pytest
from recorded_messages import estimate, header, pose_message

from facade_manipulator.blackbox import Received, RecordedRun
from facade_manipulator.errors import CalibrationError, RecordError
from facade_manipulator.estimation import EstimatorSetup
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction import EstimateSettings
from facade_manipulator.tools.calibration import read_estimator_recording, recorded
from facade_manipulator.tools.calibration.recorded import read_sensors, read_touches


@pytest.fixture
def run(monkeypatch):
    """Return a recording in which estimates overtake each other and one is not finite."""
    run = RecordedRun(begin=5.0)
    for time, x in ((10.02, 0.2), (10.0, 0.1), (10.02, 0.2), (10.04, math.nan), (10.06, 0.4)):
        run.topics['disturbance'].append(Received(time, estimate(time, Pose(x, 0.0, 0.01))))
    run.topics['joint_states'].append(Received(10.0, Message(
        header=header(10.0), name=['q3', 'q1', 'q2'], position=[0.0, -0.1, 0.1])))
    monkeypatch.setattr(recorded, 'read_recording', lambda path: run)
    return run


def put(run, topic, *rows):
    for time, *numbers in rows:
        run.topics[topic].append(Received(time, pose_message(time, Pose(*numbers))))


def test_a_recording_is_in_the_order_of_its_stamps(run):
    put(run, 'camera', (10.01, 0.3, 0.25, 0.1))
    disturbance, joints, wall = read_estimator_recording('a', 'camera')
    assert disturbance == pytest.approx(np.array([
        [10.0, 0.1, 0.0, 0.01], [10.02, 0.2, 0.0, 0.01], [10.06, 0.4, 0.0, 0.01]]))
    assert joints == pytest.approx(np.array([[10.0, -0.1, 0.1, 0.0]]))
    assert wall == pytest.approx(np.array([[10.01, 0.3, 0.25, 0.1]]))


def test_without_a_measured_head_its_slip_shows_x(run):
    put(run, 'compensator/reference', (10.0, 0.1, 0.25, 0.0), (11.0, 0.2, 0.25, 0.0))
    run.topics['lateral_offset'].append(Received(10.5, Message(
        header=header(10.5), point=Message(x=0.002))))
    _, _, ((time, x, y, theta),) = read_estimator_recording('a')
    assert (time, x) == pytest.approx((10.5, 0.148))
    assert math.isnan(y) and math.isnan(theta)


def test_while_the_head_presses_carriages_and_rail_are_those_of_the_force(run):
    run.topics['joint_states'].append(Received(11.0, Message(
        header=header(11.0), name=['q1', 'q2', 'q3'], position=[0.0, 0.2, 0.1])))
    run.topics['disturbance'].append(Received(11.0, estimate(11.0, Pose(0.1, 0.0, 0.01))))
    for time, force in ((9.0, 20.0), (10.02, -0.2), (10.03, -20.0), (12.0, -20.0)):
        run.topics['contact_wrench'].append(Received(time, Message(
            header=header(time), wrench=Message(
                force=Message(x=1.0, y=force), torque=Message(z=0.0)))))
    found = read_touches('a', EstimateSettings(delay=0.02, mounting=(0.0, 0.0, 0.01)))
    assert found.times == pytest.approx([10.03]) and found.forces == pytest.approx([20.0])
    assert found.carriages == pytest.approx(np.array([[-0.097, 0.103, 0.003]]))
    assert found.rails == pytest.approx(np.array([[0.35, 0.0, 0.0]]), abs=1e-9)
    run.topics['contact_wrench'].pop(2)
    with pytest.raises(CalibrationError, match='did not touch the wall with 1.5 N'):
        read_touches('a', EstimateSettings())


def test_raw_sensors_are_read_without_what_is_out_of_their_range(run):
    run.topics['imu'] += [Received(time, Message(
        header=header(time), angular_velocity=Message(x=1.0, y=2.0, z=3.0),
        angular_velocity_covariance=[of_rates, *[0.0] * 8],
        linear_acceleration=Message(x=4.0, y=5.0, z=9.8),
        linear_acceleration_covariance=[0.01, *[0.0] * 8]))
        for time, of_rates in ((10.0, 0.0), (10.01, -1.0))]
    run.topics['fix_x'].append(Received(10.0, Message(
        header=header(9.9), point=Message(x=0.1))))
    for name in ('range_1', 'range_2'):
        run.topics[name] += [Received(10.0, Message(
            header=header(time), min_range=0.05, max_range=4.0, range=value))
            for time, value in ((9.9, 0.45), (9.91, 7.0), (9.92, math.inf), (9.93, 0.46))]
    setup = EstimatorSetup.of({'poses': ('',)})
    imu, walls = read_sensors('a', setup)
    assert imu == pytest.approx(np.array([[10.0, 1.0, 2.0, 3.0, 4.0, 5.0, 9.8]]))
    assert walls['range_2'] == pytest.approx(np.array([[9.9, 0.45], [9.93, 0.46]]))
    assert walls['fix_x'] == pytest.approx(np.array([[9.9, 0.1]]))
    del run.topics['range_2']
    with pytest.raises(CalibrationError, match='no message of range_2'):
        read_sensors('a', setup)


def test_a_topic_that_is_not_there_is_named(run):
    with pytest.raises(CalibrationError, match='no message of head_on_wall'):
        read_estimator_recording('a')


def test_a_file_that_is_none_is_named(tmp_path):
    with pytest.raises(RecordError, match='cannot be read'):
        read_estimator_recording(tmp_path / 'none.mcap')
