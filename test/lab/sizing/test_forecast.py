"""Forecasts against what theory says, and against closed loops of gondolas nobody tuned for."""

from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.gondola import (
    EstimatorSettings,
    GondolaSettings,
    load_scenario,
    MissionSettings,
    Scenario,
    wind_law,
    WindSettings,
)
from facade_manipulator.lab.gondola.bench.__main__ import run_scenario, with_seed
from facade_manipulator.lab.gondola.closed_loop import START
from facade_manipulator.lab.gondola.motion import SwaySettings
from facade_manipulator.lab.sizing.forecast import (
    forecast,
    gusts_bound,
    mean_age,
    OUTSIDE,
    power_of,
    SETTLED,
)

LINE = np.array([0.1]), np.array([[1e-2], [1e-4], [1e-4]])
SINES = ('x', 0.12), ('y', 0.02), ('yaw', 0.03)


def gondola(number):
    """Return one of the gondolas that nobody has tuned for: in the wind, or on sines."""
    random = np.random.default_rng(1000 + number)
    estimator = EstimatorSettings(
        rate=float(random.choice((20.0, 50.0, 100.0))), latency=random.uniform(0.03, 0.1),
        jitter=0.01, position_noise=random.uniform(0.5e-3, 2e-3),
        yaw_noise=math.radians(random.uniform(0.05, 0.2)))
    wind = WindSettings(mean_speed=random.uniform(2.0, 5.5), direction=random.uniform(0.1, 1.2))
    body = GondolaSettings(
        cable_length=random.uniform(15.0, 60.0), mass=random.uniform(300.0, 900.0),
        damping_ratio=random.uniform(0.01, 0.05), guide_lever=random.uniform(0.0, 0.6))
    sway = {}
    for axis, largest in SINES:
        count = int(random.integers(1, 4))
        sway |= {f'{axis}_amplitude': tuple(random.uniform(0.2, 0.7, count) * largest),
                 f'{axis}_frequency': tuple(random.uniform(0.08, 0.4, count)),
                 f'{axis}_phase': tuple(random.uniform(0.0, math.tau, count))}
    far = random.uniform(0.0, 0.18)
    mission = MissionSettings(
        motion='wind' if number % 2 else 'sway', duration=60.0,
        goals=(far, 0.25, 0.0, far, 0.22, 0.03, -far, 0.25, 0.0))
    return Scenario(mission=mission, sway=SwaySettings(**sway), gondola=body, wind=wind,
                    estimator=estimator)


def closed_loop(scenario, seeds):
    """Return what loops left [m, m, rad], and the share of the time with goals in reach."""
    squares, inside = [], []
    for seed in seeds:
        steps = [step for step in run_scenario(with_seed(scenario, seed)).steps
                 if step.sample.time - START > SETTLED]
        squares.append(np.mean([
            np.square(step.sample.error) for step in steps if step.sample.settled], axis=0))
        inside.append(np.mean([
            np.abs(step.corrected.saturation_error).max() <= OUTSIDE for step in steps]))
    return np.sqrt(np.mean(squares, axis=0)), float(np.mean(inside))


@pytest.mark.long
@pytest.mark.parametrize(('number', 'tolerance'), [(0, 0.5), (3, 0.2)])
def test_a_forecast_is_near_the_closed_loop(number, tolerance):
    scenario = gondola(number)
    left, inside = closed_loop(scenario, seeds=(7,))
    expected = forecast(Geometry(), scenario)
    assert expected.residual == pytest.approx(left, rel=tolerance)
    assert expected.inside == inside == 1.0


def test_an_estimator_without_noise_sees_what_is_coming_and_a_noisy_one_less():
    law = wind_law(GondolaSettings(), WindSettings())
    errors = [gusts_bound(*law, EstimatorSettings(position_noise=noise, yaw_noise=noise), 0.1)
              for noise in (1e-5, 1e-3, 1e-2, 1.0)]
    assert all((one < other).all() for one, other in zip(errors, errors[1:], strict=False))
    assert (errors[-1] <= np.sqrt(law[1].sum(axis=1))).all()


def test_later_estimates_leave_more():
    law = wind_law(GondolaSettings(), WindSettings())
    near, far = (gusts_bound(*law, EstimatorSettings(), ahead) for ahead in (0.05, 0.3))
    assert (near < far).all()
    old = replace(EstimatorSettings(), latency=0.2)
    assert mean_age(old) - mean_age(EstimatorSettings()) == pytest.approx(0.15)
    assert mean_age(EstimatorSettings(loss=0.5)) == pytest.approx(0.05 + 1.0 / 50.0)


def test_one_line_of_known_frequency_is_averaged_over_the_window():
    """Amplitude in phase and in quadrature from 500 estimates: variance 2 σ² / 500 each."""
    noise = 1e-3
    found = gusts_bound(*LINE, EstimatorSettings(position_noise=noise), 0.1)
    assert found[0] == pytest.approx(noise * math.sqrt(2.0 / 500.0), rel=0.05)


def test_the_power_of_a_motion_is_its_mean_square():
    scenario = load_scenario('breeze')
    motion = scenario.motion()
    _, power = power_of(motion, 60.0)
    values = np.array([motion(time) for time in np.arange(0.0, 60.0, 0.05)])
    assert power.sum(axis=1) == pytest.approx(values.var(axis=0), rel=0.1)


def test_drives_that_lag_more_than_is_assumed_leave_that_much_of_the_speed():
    scenario = load_scenario('breeze')
    right, late = (forecast(Geometry(), scenario, lag) for lag in (0.0, 0.02))
    rate = math.tau * math.sqrt((0.1 * 0.11) ** 2 + (0.02 * 0.3) ** 2) / math.sqrt(2.0)
    assert right.lagged == pytest.approx(0.0)
    assert late.lagged[0] == pytest.approx(0.02 * rate, rel=0.1)
    assert (late.residual > right.residual).all()


def test_goals_at_the_end_of_the_stroke_are_in_reach_for_a_share_of_the_time():
    scenario = load_scenario('breeze')
    shares = []
    for x in (0.0, 0.3, 2.0):
        mission = replace(scenario.mission, goals=(x, 0.25, 0.0))
        found = forecast(Geometry(), scenario._replace(mission=mission))
        shares.append(found.inside)
        assert (found.held_back[0] > 0.0) == (found.inside < 1.0)
    assert shares[0] == 1.0 and 0.0 < shares[1] < 1.0 and shares[2] == 0.0
