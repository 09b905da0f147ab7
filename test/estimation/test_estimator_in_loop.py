"""Error of the head on the wall with the estimator in the loop."""

from closed_loop import ClosedLoop, START
import numpy as np
import pytest
from sensor_record import GUSTS, replace

from facade_manipulator.kinematics import Pose

GOAL = Pose(0.0, 0.25, 0.0)
DURATION = 16.0  # s
SETTLED = 9.0  # s
pytestmark = pytest.mark.long


def run(raw_sensors=True, spoil=lambda time, measurement: measurement):
    """Return the loop and the RMS error of x, y, yaw [m, m, rad]."""
    loop = ClosedLoop(replace(GUSTS, raw_sensors=raw_sensors), GOAL)
    receive = loop.world.raw_sensors.receive

    def receive_spoilt(now):
        measurements = [spoil(now - START, one) for one in receive(now)]
        return [one for one in measurements if one is not None]

    loop.world.raw_sensors.receive = receive_spoilt
    cycles = loop.follow(GOAL, DURATION, 0.0)
    errors = np.array([one.error for one in cycles if one.time - START > SETTLED])
    return loop, np.sqrt((errors**2).mean(axis=0))


def test_raw_sensors_give_less_error_than_noisy_estimates():
    _, white = run(raw_sensors=False)
    loop, found = run()
    assert loop.follower.brakes == 0
    assert loop.rejections == []
    assert (found < np.array((0.9, 0.7, 0.5)) * white).all()


def test_silent_fix_stops_only_the_correction_of_x():
    def silence(time, one):
        return None if one.sensor == 'fix_x' and time > 8 else one

    loop, found = run(spoil=silence)
    assert loop.compensator.correction.usable == (False, True, True)
    assert found[0] > 0.01
    assert (found[1:] < (1e-3, 1e-3)).all()
