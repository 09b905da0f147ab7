"""Forecasts beside the driver on simulated drives, of gondolas nobody tuned for."""

from dataclasses import replace
import math

from driven_gondola import DrivenGondola
import numpy as np
import pytest

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.lab import gondola
from facade_manipulator.lab.gondola import Scenario
from facade_manipulator.lab.gondola.motion import SwaySettings
from facade_manipulator.lab.sizing import forecast
from facade_manipulator.resources import config_path

pytestmark = pytest.mark.long

MACHINE = config_path('manipulator.yaml')
SINES = ('x', 0.12), ('y', 0.02), ('yaw', 0.03)


def made_up(number):
    """Return one of the gondolas that nobody has tuned for: in the wind, or on sines."""
    random = np.random.default_rng(3500 + number)
    estimator = gondola.EstimatorSettings(
        rate=float(random.choice((20.0, 50.0, 100.0))), latency=random.uniform(0.03, 0.1),
        jitter=0.01, position_noise=random.uniform(0.5e-3, 2e-3),
        yaw_noise=math.radians(random.uniform(0.05, 0.2)))
    wind = gondola.WindSettings(
        mean_speed=random.uniform(2.0, 5.5), direction=random.uniform(0.1, 1.2))
    body = gondola.GondolaSettings(
        cable_length=random.uniform(15.0, 60.0), mass=random.uniform(300.0, 900.0),
        damping_ratio=random.uniform(0.01, 0.05), guide_lever=random.uniform(0.0, 0.6))
    sway = {}
    for axis, largest in SINES:
        count = int(random.integers(1, 4))
        sway |= {f'{axis}_amplitude': tuple(random.uniform(0.2, 0.7, count) * largest),
                 f'{axis}_frequency': tuple(random.uniform(0.08, 0.4, count)),
                 f'{axis}_phase': tuple(random.uniform(0.0, math.tau, count))}
    far = random.uniform(0.0, 0.2) if number < 6 else random.uniform(0.31, 0.36)
    mission = gondola.MissionSettings(
        motion='wind' if number % 2 else 'sway',
        goals=(far, 0.25, 0.0, far, 0.22, 0.03, -far, 0.25, 0.0))
    return Scenario(mission=mission, sway=SwaySettings(**sway), gondola=body, wind=wind,
                    estimator=estimator)


def driven(scenario):
    """Return what the driver leaves on simulated drives."""
    return forecast.residual_of([
        one for one in DrivenGondola(scenario).run() if one.elapsed >= forecast.SETTLED])


@pytest.mark.parametrize('number', [1, 6])
def test_what_is_forecast_is_what_the_driver_leaves_on_simulated_drives(number):
    scenario = made_up(number).with_seed(7)
    scenario = scenario._replace(mission=replace(scenario.mission, duration=30.0))
    expected, came = forecast.residual(scenario, MACHINE), driven(scenario)
    assert came.moves == pytest.approx(expected.moves, rel=0.02)
    assert came.left == pytest.approx(expected.left, rel=0.1)
    assert came.inside == pytest.approx(expected.inside, rel=0.02)


def test_goals_at_the_end_of_the_stroke_are_in_reach_for_a_share_of_the_time():
    scenario = gondola.load_scenario('breeze')
    for x, least, most in ((0.0, 1.0, 1.0), (0.3, 0.2, 0.9)):
        mission = replace(scenario.mission, goals=(x, 0.25, 0.0), duration=30.0)
        found = forecast.residual(scenario._replace(mission=mission), MACHINE)
        assert least <= found.inside <= most
        assert (found.left[0] > 1e-3) == (found.inside < 1.0)
    beyond = replace(scenario.mission, goals=(2.0, 0.25, 0.0))
    with pytest.raises(ManipulatorError, match='a goal is out of reach: q2 = 2.1'):
        forecast.residual(scenario._replace(mission=beyond), MACHINE)


def test_runs_are_summed_up_with_the_best_and_the_worst_of_them():
    runs = [forecast.Residual(np.full(3, moves), np.full(3, left), inside)
            for moves, left, inside in ((0.03, 1e-3, 1.0), (0.04, 7e-3, 0.5))]
    (axis, x), _, (_, theta) = forecast.rows(runs)
    assert axis == 'x'
    assert x == pytest.approx((math.sqrt(1250.0), 5.0, 1.0, 7.0, 75.0))
    assert theta[1] == pytest.approx(math.degrees(5e-3))
