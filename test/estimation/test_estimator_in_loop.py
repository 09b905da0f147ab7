"""What remains on the wall with the estimator in the loop, on gondola and sensors of the tests."""

from contextlib import suppress
from functools import cache

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
    STEP,
    Wall,
)
import numpy as np
import pytest

from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.lab.gondola.closed_loop import ClosedLoop
from facade_manipulator.lab.gondola.scenario import Scenario
from facade_manipulator.prediction.estimate import Estimate, Variances

DAY, GOAL, SETTLED = Day(38.0, 2, strength=0.8), Pose(0.0, 0.25, 0.0), 15.0
CAMERA_ON_RAIL = {**LASERS, 'fix': BETTER}
pytestmark = pytest.mark.long


class OnRail:
    """The estimator as the loop wants it: what has come until now, in the order of arrival."""

    def __init__(self, motion, sensors, wired):
        events, _ = arrivals(DAY, motion, wired or sensors, Imu(), Wall(DAY.seed))
        self._events = events[::-1]
        self.estimator = DisturbanceEstimator(setup_of(sensors, Imu()))

    def advance(self, now):
        while self._events and START + self._events[-1][0] <= now:
            arrival, name, stamp, value = self._events.pop()
            with suppress(InputError):
                feed(self.estimator, name, START + arrival, START + stamp, value)
        motion = self.estimator.advance(now)
        return [] if motion is None else [Estimate(
            motion.stamp, motion.pose, Variances(*np.diag(motion.covariance).tolist()))]


def run(sensors=None, wired=None, since=SETTLED):
    """Return what remains in mm, mm, degrees; the scenario's white estimates without sensors."""
    motion = move(DAY)
    places = np.column_stack([motion.place[:, :2], motion.euler[:, 2]])
    loop = ClosedLoop(
        Geometry(), Scenario(), lambda time: Pose(*places[max(round(time / STEP), 0)]), GOAL)
    if sensors:
        loop.estimator = OnRail(motion, sensors, wired)
    loop.send_goal(GOAL)
    steps = loop.run(DAY.duration - 1.5)
    times = np.array([step.sample.time - START for step in steps])
    errors = np.array([step.sample.error for step in steps]) * (1e3, 1e3, 180.0 / np.pi)
    errors -= np.median(errors[times > SETTLED], axis=0)
    return loop, errors[times > since].std(axis=0)


@cache
def with_white_estimates():
    return run()[1]


@pytest.mark.parametrize(('fix', 'bounds'), [
    (BETTER, (0.6, 0.35, 0.35)), (LINE, (0.4, 0.35, 0.35))])
def test_raw_sensors_leave_a_share_of_what_white_estimates_leave(fix, bounds):
    _, remains = run({**LASERS, 'fix': fix})
    assert (remains < np.array(bounds) * with_white_estimates()).all()


def test_without_a_fix_x_alone_is_not_compensated():
    lost = {**LASERS, 'fix': replace(BETTER, lost=((20.0, 99.0),))}
    loop, remains = run(lost, since=28.0)
    assert loop.compensator.correction.known == (False, True, True)
    assert remains[0] > 10.0
    assert (remains[1:] < 0.5 * with_white_estimates()[1:]).all()


def test_swapped_sides_end_the_correction_in_place_of_misleading_the_head():
    swapped = {**CAMERA_ON_RAIL, 'left': LASERS['right'], 'right': LASERS['left']}
    loop, _ = run(CAMERA_ON_RAIL, swapped)
    assert 'swapped' in loop.estimator.estimator.fault
    assert loop.compensator.correction.mode is CorrectionMode.SILENT
