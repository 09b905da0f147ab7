"""Predictions without continuation."""

import math

import numpy as np
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.lab.gondola.bench.plain import AccelerationPrediction, HeldPrediction
from facade_manipulator.prediction import DisturbancePredictor, PredictionSettings

VARIANCES = Pose(1e-6, 1e-6, 1e-6)
STILL = Pose(0.0, 0.0, 0.0)


def sway(time):
    return Pose(0.1 * math.sin(0.7 * time), 0.02 * math.sin(1.3 * time), 0.03 * math.cos(time))


def errors(predictor, noise=0.0):
    random, found = np.random.default_rng(0), []
    for stamp in np.arange(1000.0, 1020.0, 0.02):
        measured = np.array(sway(stamp)) + noise * random.standard_normal(3)
        predictor.update(stamp, Pose(*measured), VARIANCES)
        found.append(np.subtract(predictor.predict(stamp + 0.12).position, sway(stamp + 0.12)))
    return np.sqrt((np.array(found)[250:] ** 2).mean(axis=0))


def test_each_prediction_knows_more_than_the_one_before():
    none, acceleration, learnt = (errors(predictor, 1e-3) for predictor in (
        HeldPrediction(), AccelerationPrediction(), DisturbancePredictor(PredictionSettings())))
    assert (acceleration < 0.6 * none).all()
    assert (learnt < 0.7 * acceleration).all()


def test_a_steady_acceleration_is_predicted():
    predictor = AccelerationPrediction()
    for stamp in np.arange(1000.0, 1010.0, 0.02):
        predictor.update(stamp, Pose(0.005 * (stamp - 1000.0) ** 2, 0.0, 0.0), VARIANCES)
    course = predictor.predict(1010.1)
    assert course.position.x == pytest.approx(0.005 * 10.1 ** 2, abs=1e-3)
    assert course.velocity.x == pytest.approx(0.01 * 10.1, abs=2e-3)


@pytest.mark.parametrize('predictor', [HeldPrediction(), AccelerationPrediction()])
def test_after_a_long_gap_they_learn_again(predictor):
    predictor.update(1000.0, Pose(0.1, 0.0, 0.0), VARIANCES)
    predictor.update(1100.0, STILL, VARIANCES)
    assert predictor.since == 1100.0
    assert predictor.predict(1100.1).position == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
