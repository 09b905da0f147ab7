"""Estimates of the disturbance come out of the recorded sensors once more."""

from types import SimpleNamespace as Message

from estimator_plant import arrivals, BETTER, Day, Imu, LASERS, move, START, Wall
import numpy as np
import pytest
from recorded_messages import estimate, header

from facade_manipulator.blackbox import Received, RecordedRun
from facade_manipulator.errors import RecordError
from facade_manipulator.estimation import DisturbanceEstimator, EstimatorSetup, inputs, SensorNames
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import seconds
from facade_manipulator.parameters import settings_from
from facade_manipulator.tools.replay import replay_estimates
from facade_manipulator.tools.replay.parameters import changed

pytestmark = pytest.mark.long

DURATION = 30.0
PARAMETERS = {'imu.mounting': (*Imu().place, 0.0, 0.0, 0.0), 'poses': ('',),
              'range_1.mounting': (-0.5, 0.0, 0.0), 'range_2.mounting': (0.5, 0.0, 0.0),
              'fix_x.mounting': BETTER.place}
SENSORS = {'range_1': LASERS['left'], 'range_2': LASERS['right'], 'fix_x': BETTER}


def vector(x, y=0.0, z=0.0):
    return Message(x=x, y=y, z=z)


def message(name, stamp, value):
    if name == 'imu':
        return Message(header=header(stamp), angular_velocity=vector(*value[0]),
                       angular_velocity_covariance=[0.0] * 9,
                       linear_acceleration=vector(*value[1]),
                       linear_acceleration_covariance=[0.0] * 9)
    return Message(header=header(stamp), point=vector(value), range=value, min_range=0.1,
                   max_range=2.0)


@pytest.fixture(scope='module')
def run():
    """Return what the node would have published, beginning before the recording does."""
    day, run = Day(DURATION + 5.0, 2), RecordedRun(begin=START + 5.0, end=START + DURATION)
    run.parameters = {'disturbance_estimator': PARAMETERS}
    setup = EstimatorSetup.read(
        SensorNames(poses=('',)), lambda kind, prefix='': settings_from(kind, PARAMETERS, prefix))
    estimator, taken = DisturbanceEstimator(setup), inputs(setup)
    events, _ = arrivals(day, move(day), SENSORS, Imu(), Wall(day.seed))
    for arrival, name, stamp, value in events:
        now = START + arrival
        sent = message(name, START + stamp, value)
        taken[name].add(estimator, name, now, seconds(sent.header.stamp),
                        taken[name].numbers_of(sent))
        motion = estimator.advance(now) if name == 'imu' else None
        for topic, one in ((name, sent), (
                'disturbance_odometry', motion and estimate(motion.stamp, Pose(*motion.pose)))):
            if one is not None and run.begin <= now <= run.end:
                run.topics[topic].append(Received(now + 1e-3, one))
    return run


@pytest.fixture(scope='module')
def compared(run):
    return replay_estimates(run)


def test_the_recorded_sensors_give_the_recorded_estimates(compared):
    assert len(compared.errors) > 2000 and not compared.rejections
    assert (np.sqrt((compared.errors ** 2).mean(axis=0)) < (5e-4, 1e-4, 2e-4)).all()


@pytest.mark.parametrize('change', ['fix_x.delay=0.02', 'range_2.mounting=[0.45, 0.0, 0.0]'])
def test_another_parameter_of_the_estimator_gives_others(run, compared, change):
    other = replay_estimates(changed(run, [change])).errors
    assert (other.std(axis=0) > 2.0 * compared.errors.std(axis=0)).any()


def test_without_its_parameters_nothing_is_estimated():
    with pytest.raises(RecordError, match='disturbance_estimator'):
        replay_estimates(RecordedRun())
