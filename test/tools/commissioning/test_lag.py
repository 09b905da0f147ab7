"""Command `lag`: the fits against known answers, then three simulated axes."""

from __future__ import annotations

import numpy as np
import pytest

from facade_manipulator.tools.commissioning.lag import (
    AxisDynamics,
    fit_friction,
    fit_sine,
    Response,
    response,
    unlike,
)
from facade_manipulator.tools.commissioning.machine import Machine
from facade_manipulator.tools.commissioning.motion import PERIOD

TIME = np.arange(400) * PERIOD


@pytest.mark.parametrize('frequency', [0.5, 2.0, 10.0])
@pytest.mark.parametrize(('gain', 'lag'), [(1.0, 0.0), (0.8, 0.012), (1.1, 0.02)])
def test_gain_and_lag_of_a_known_answer_come_back(frequency, gain, lag):
    angle = 2.0 * np.pi * frequency * TIME
    found = response(frequency, np.sin(angle),
                     gain * np.sin(angle - 2.0 * np.pi * frequency * lag) + 3.0)
    assert (found.gain, found.lag) == pytest.approx((gain, lag), abs=1e-9)


def test_a_sine_is_fitted_beside_an_offset_and_noise():
    noise = np.random.default_rng(0).normal(0.0, 0.1, len(TIME))
    found = fit_sine(2.0 * np.sin(2.0 * np.pi * TIME) + 5.0 + noise, 1.0)
    assert abs(found) == pytest.approx(2.0, abs=0.03)


def test_known_friction_comes_back_beside_inertia():
    sines = [speed * np.sin(2.0 * np.pi * TIME) for speed in (0.01, 0.02)]
    assert fit_friction([
        (sine, 6.0 * np.sign(sine) + 40.0 * sine + 3.0 * np.gradient(sine, PERIOD))
        for sine in sines]) == pytest.approx((6.0, 40.0), rel=1e-6)


def axis(lag, gain=1.0, coulomb=4.0):
    return AxisDynamics(tuple(
        Response(frequency, gain / np.hypot(1.0, 2.0 * np.pi * frequency * lag), lag, 0.0)
        for frequency in (1.0, 5.0, 20.0, 25.0)), coulomb, 10.0, 0.0)


def test_the_bandwidth_is_where_the_gain_falls_to_three_decibels():
    assert axis(0.01).bandwidth == pytest.approx(15.9, rel=0.15)
    assert axis(0.001).bandwidth is None


def test_without_slow_sines_the_lag_is_that_of_the_slowest():
    fast = axis(0.01)._replace(responses=axis(0.01).responses[1:])
    assert fast.lag == 0.01


def test_an_axis_unlike_the_others_is_named():
    found = {'q1': axis(0.005), 'q2': axis(0.005), 'q3': axis(0.02, coulomb=20.0)}
    warnings = unlike(found)
    assert len(warnings) == 2 and all(warning.startswith('q3') for warning in warnings)
    assert unlike(dict.fromkeys(('q1', 'q2', 'q3'), axis(0.005))) == []


@pytest.mark.long
def test_lag_of_the_simulated_axes_is_found_and_written(make_rig, capsys):
    rig = make_rig('--lag', '0.012').configured()
    status = rig.run('lag', '--links', 'uncoupled', '--frequencies', '1', '2')
    assert status == 0, capsys.readouterr()
    driver = Machine(rig.parameters).parameters
    assert driver['controller.drive_lag'] == pytest.approx(0.012, abs=0.004)


@pytest.mark.parametrize('frequency', ['0', '30', 'nan'])
def test_a_frequency_that_cannot_be_measured_moves_nothing(make_rig, capsys, frequency):
    rig = make_rig().configured()
    assert rig.run('lag', 'q1', '--links', 'uncoupled', '--frequencies', frequency) == 1
    assert 'is not between 0.1 and 25 Hz' in capsys.readouterr().err


@pytest.mark.parametrize('links', ['coupled', 'uncoupled'])
def test_an_axis_that_is_none_is_one_message(make_rig, rejected, links):
    rig = make_rig().configured()
    assert 'q9 is not one of q1, q2, q3' in rejected(rig.run, 'lag', 'q9', '--links', links)
