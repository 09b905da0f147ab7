"""What remains on the wall with the estimator in the loop, on gondola and sensors of the tests."""

from contextlib import suppress

from closed_loop import ClosedLoop
from estimator_plant import (
    arrivals,
    BETTER,
    Day,
    feed,
    Imu,
    LASERS,
    LINE,
    move,
    replace,
    setup_of,
    START,
    Wall,
)
import numpy as np
import pytest

from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import Estimate, Variances
from facade_manipulator.simulation.world.scenario import Motion, Scenario

DAY, GOAL, SETTLED = Day(38.0, 2, strength=0.8), Pose(0.0, 0.25, 0.0), 15.0
CAMERA_ON_RAIL = {**LASERS, 'fix': BETTER}
pytestmark = pytest.mark.long


class OnRail:
    """The estimator as the world wants it: it reads the sensors of the tests."""

    def __init__(self, motion, sensors, wired):
        events, _ = arrivals(DAY, motion, wired or sensors, Imu(), Wall(DAY.seed))
        self._events = events[::-1]
        self.estimator = DisturbanceEstimator(setup_of(sensors, Imu()))

    def sample(self, stamp, rail):
        """Measure nothing more."""

    def receive(self, now):
        """Return an estimate from the measurements that have arrived."""
        while self._events and START + self._events[-1][0] <= now:
            arrival, name, stamp, value = self._events.pop()
            with suppress(InputError):
                feed(self.estimator, name, START + arrival, START + stamp, value)
        motion = self.estimator.advance(now)
        return [] if motion is None else [Estimate(
            motion.stamp, motion.pose, Variances(*np.diag(motion.covariance).tolist()))]


@pytest.fixture(scope='module')
def scenario(tmp_path_factory):
    """Return a scenario in which the gondola moves as in the tests of the estimator."""
    motion, path = move(DAY), tmp_path_factory.mktemp('day') / 'day.csv'
    rows = np.column_stack([motion.times, motion.place[:, :2], motion.euler[:, 2]])[::4]
    np.savetxt(path, rows, delimiter=',', header='time,x,y,theta')
    return Scenario(motion=Motion(recording=str(path)))


def run(scenario, sensors=None, wired=None, since=SETTLED):
    """Return what remains in mm, mm, degrees; the scenario's white estimates without sensors."""
    loop = ClosedLoop(scenario, GOAL)
    if sensors:
        loop.world.estimator = OnRail(move(DAY), sensors, wired)
    loop.send_goal(GOAL)
    cycles = loop.run(DAY.duration - 1.5)
    times = np.array([cycle.time - START for cycle in cycles])
    errors = np.array([cycle.error for cycle in cycles]) * (1e3, 1e3, 180.0 / np.pi)
    errors -= np.median(errors[times > SETTLED], axis=0)
    return loop, errors[times > since].std(axis=0)


@pytest.fixture(scope='module')
def white(scenario):
    """Return what remains with white estimates."""
    return run(scenario)[1]


@pytest.mark.parametrize(('fix', 'bounds'), [
    (BETTER, (0.6, 0.35, 0.35)), (LINE, (0.4, 0.35, 0.35))])
def test_raw_sensors_leave_a_share_of_what_white_estimates_leave(scenario, white, fix, bounds):
    _, remains = run(scenario, {**LASERS, 'fix': fix})
    assert (remains < np.array(bounds) * white).all()


def test_without_a_fix_x_alone_is_not_compensated(scenario, white):
    lost = {**LASERS, 'fix': replace(BETTER, lost=((20.0, 99.0),))}
    loop, remains = run(scenario, lost, since=28.0)
    assert loop.compensator.correction.known == (False, True, True)
    assert remains[0] > 10.0
    assert (remains[1:] < 0.5 * white[1:]).all()


def test_swapped_sides_end_the_correction(scenario):
    swapped = {**CAMERA_ON_RAIL, 'left': LASERS['right'], 'right': LASERS['left']}
    loop, _ = run(scenario, CAMERA_ON_RAIL, swapped)
    assert 'swapped' in loop.world.estimator.estimator.fault
    assert loop.compensator.correction.mode is CorrectionMode.SILENT
