"""Noise, delay and faults of the simulated estimator."""

import math

import numpy as np
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.world.scenario import Estimator
from facade_manipulator.simulation.world.sensors import SimulatedEstimator

RAIL = Pose(0.1, -0.02, 0.03)
START = 1000.0
NO_NOISE = {'position_noise': 0.0, 'yaw_noise': 0.0}


def estimates(duration=60.0, **changes):
    """Return the arrivals and the estimates of a rail at rest."""
    settings = Estimator(**changes)
    estimator = SimulatedEstimator(settings, START, np.random.default_rng(1))
    received = []
    for number in range(round(duration * settings.rate)):
        now = START + number / settings.rate
        estimator.sample(now, RAIL)
        received += [(now, one) for one in estimator.receive(now)]
    return received


def test_noise_has_the_published_variances():
    poses = np.array([one.pose for _, one in estimates()])
    variances = estimates(1.0)[0][1].variances
    assert poses.mean(axis=0) == pytest.approx(RAIL, abs=1e-4)
    assert poses.var(axis=0) == pytest.approx(np.array(variances), rel=0.1)


def test_estimates_arrive_after_latency_and_jitter():
    received = estimates(rate=1000.0, duration=5.0)
    ages = np.array([now - one.stamp for now, one in received])
    assert ages.mean() == pytest.approx(0.0505, abs=5e-4)  # received in cycles of 1 ms
    assert ages.min() >= 0.04
    assert ages.max() <= 0.0611


def test_configured_share_of_estimates_is_lost():
    assert len(estimates(loss=0.1)) == pytest.approx(0.9 * 3000, rel=0.03)


def test_silent_estimator_loses_every_estimate():
    received = estimates(10.0, silent_from=4.0, silent_for=1.0)
    stamps = [one.stamp - START for _, one in received]
    assert not [stamp for stamp in stamps if 4.0 <= stamp < 5.0]
    assert max(np.diff(stamps)) == pytest.approx(1.02)


@pytest.mark.parametrize(
    ('changes', 'wrong'),
    [
        ({'wrong_offset': (0.03, 0.03, 0.03)}, np.add(RAIL, 0.03)),
        ({'wrong_scale': (-1.0, 1.0, 1.0)}, (-0.1, -0.02, 0.03)),
    ],
)
def test_each_fault_lasts_for_its_duration_in_turn(changes, wrong):
    received = estimates(
        16.0, wrong_every=5.0, wrong_for=(0.05, 0.09, 0.19), **NO_NOISE, **changes
    )
    off = [one for _, one in received if math.dist(one.pose, RAIL) > 1e-9]
    assert all(one.pose == pytest.approx(wrong) for one in off)
    seconds = [math.floor(one.stamp - START) for one in off]
    counts = [seconds.count(begin) for begin in (5, 10, 15)]
    assert counts == [3, 5, 10]
    assert len(off) == 18
