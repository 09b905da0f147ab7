"""Simulated sensors: an estimator, late, jittery, noisy, at times silent; a force sensor."""

import numpy as np
import pytest

from facade_manipulator.kinematics import Pose, Wrench
from facade_manipulator.lab.gondola.sensors import (
    EstimatorSettings,
    ForceSensor,
    ForceSensorSettings,
    SimulatedEstimator,
)


def motion(time):
    return Pose(0.1 * time, 0.0, -0.05 * time)


def listen(settings, duration=20.0, period=0.001):
    """Return (arrival, delivery) of everything that comes."""
    estimator = SimulatedEstimator(settings, motion, 0.0)
    return [(now, delivery) for now in np.arange(0.0, duration, period)
            for delivery in estimator.advance(now)]


def test_rate_latency_and_jitter_are_as_set():
    heard = listen(EstimatorSettings())
    ages = np.array([now - delivery.stamp for now, delivery in heard])
    assert len(heard) == pytest.approx(20 * 50, abs=4)
    assert ages.min() >= 0.04
    assert ages.max() <= 0.0611
    assert ages.mean() == pytest.approx(0.0505, abs=0.001)


def test_the_noise_has_the_variance_that_the_estimates_tell():
    heard = listen(EstimatorSettings())
    errors = np.array([np.subtract(d.pose, motion(d.stamp)) for _, d in heard])
    assert errors.var(axis=0) == pytest.approx(tuple(heard[0][1].variances), rel=0.2)
    assert abs(errors.mean(axis=0)) == pytest.approx((0.0, 0.0, 0.0), abs=2e-4)


def test_losses_and_silence_leave_gaps():
    lossy = listen(EstimatorSettings(loss=0.3))
    assert len(lossy) == pytest.approx(700, abs=60)
    silent = listen(EstimatorSettings(silent_from=5.0, silent_for=2.0))
    stamps = [delivery.stamp for _, delivery in silent]
    assert not [stamp for stamp in stamps if 5.0 <= stamp < 7.0]
    assert max(stamps) > 19.0


def test_lies_come_in_turn_and_a_scale_is_always_wrong():
    heard = listen(EstimatorSettings(
        position_noise=0.0, yaw_noise=0.0, scale=1.1, lie_period=5.0, lie_durations=(0.09, 0.19),
        lie_offset=(0.03, 0.0, 0.0), lie_scale=(1.0, 1.0, -1.0)))
    lies = np.array([(stamp, *np.subtract(pose, 1.1 * np.array(motion(stamp))))
                     for _, (stamp, pose, *_) in heard])
    told = np.flatnonzero(abs(lies[:, 1:]).max(axis=1) > 1e-9)
    assert lies[told, 0] == pytest.approx(np.concatenate([
        5.0 + 0.02 * np.arange(5), 10.0 + 0.02 * np.arange(10), 15.0 + 0.02 * np.arange(5)]))
    assert lies[told, 1] == pytest.approx(0.03) and (lies[:, 2] == 0.0).all()
    assert lies[told, 3] == pytest.approx(0.11 * lies[told, 0])


def test_the_noise_of_forces_is_as_strong_as_set():
    sensor, truth = ForceSensor(ForceSensorSettings()), Wrench(0.0, -10.0, 0.0)
    rows = np.array([sensor.measure(truth) for _ in range(5000)])
    assert rows.mean(axis=0) == pytest.approx(np.array(truth), abs=0.05)
    assert rows.std(axis=0) == pytest.approx([0.5, 0.5, 0.05], rel=0.05)
