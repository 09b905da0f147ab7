"""The best linear prediction: its law, and that nothing errs less."""

from __future__ import annotations

import numpy as np
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction import DisturbancePredictor, PredictionSettings
from facade_manipulator.simulation.gondola import Gondola, GondolaSettings
from facade_manipulator.simulation.oracle import law, OraclePrediction, sway_law, wind_law
from facade_manipulator.simulation.scenario import load_scenario, MissionSettings, Scenario
from facade_manipulator.simulation.sway import Sway, SwaySettings
from facade_manipulator.simulation.wind import WindSettings

INTERVAL, HORIZON, NOISE = 0.02, 0.12, 1e-3
VARIANCES = Pose(NOISE ** 2, NOISE ** 2, NOISE ** 2)


def errors(predictor, motion, duration=40.0, lost=0.0):
    random, found = np.random.default_rng(0), []
    for stamp in np.arange(0.0, duration, INTERVAL):
        values = np.array(motion(stamp)) + NOISE * random.standard_normal(3)
        if not found or random.random() >= lost:
            predictor.update(stamp, Pose(*values.tolist()), VARIANCES)
        found.append(np.subtract(predictor.predict(stamp + HORIZON).position,
                                 motion(stamp + HORIZON)))
    return np.sqrt((np.array(found)[len(found) // 2:] ** 2).mean(axis=0))


@pytest.mark.long
@pytest.mark.parametrize('name', ['breeze', 'three_tones', 'gusty'])
def test_no_other_prediction_errs_less(name):
    scenario = load_scenario(name)
    oracle = errors(OraclePrediction(law(scenario), INTERVAL, VARIANCES), scenario.motion())
    learnt = errors(DisturbancePredictor(PredictionSettings()), scenario.motion())
    assert (oracle < learnt).all()


def test_two_sines_are_known_to_a_tenth_of_the_noise():
    settings = SwaySettings()
    predictor = OraclePrediction(sway_law(settings), INTERVAL, VARIANCES)
    assert (errors(predictor, Sway(settings).at, 60.0) < 0.12 * NOISE).all()


def test_lost_estimates_are_made_up_for():
    settings = SwaySettings()
    predictor = OraclePrediction(sway_law(settings), INTERVAL, VARIANCES)
    assert (errors(predictor, Sway(settings).at, 60.0, lost=0.2) < 0.2 * NOISE).all()


@pytest.mark.long
def test_the_law_of_gusts_has_the_variance_of_the_gondola():
    gondola, wind = GondolaSettings(damping_ratio=0.1), WindSettings(mean_speed=2.0)
    found = []
    for seed in range(1, 9):
        swaying = Gondola(gondola, WindSettings(mean_speed=2.0, seed=seed))
        found.append([swaying.at(time) for time in np.arange(0.0, 120.0, 0.5)])
    expected = np.sqrt(wind_law(gondola, wind).power.sum(axis=1))
    assert np.std(found, axis=(0, 1)) == pytest.approx(expected, rel=0.3)


def test_a_recording_has_no_law():
    assert law(Scenario(mission=MissionSettings(motion='recording'))) is None
