"""Giving way to the wall: the desired force, without a bounce."""

from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.compensation import impedance
from facade_manipulator.compensation.impedance import (
    Impedance,
    ImpedanceSettings,
    YawImpedanceSettings,
)
from facade_manipulator.errors import ParameterError

SETTINGS = ImpedanceSettings(enabled=True)
PERIOD = 0.01
LATENCY = 8
HORIZON = 0.06


def press(settings, wall, duration, stiffness=600.0, until=math.inf, error=0.0):
    """Return offsets and forces of a head that reaches each offset when it should."""
    axis, offsets, forces = Impedance(settings), [], []
    for k in range(round(duration / PERIOD)):
        now = k * PERIOD
        axis.step(now, now + HORIZON, PERIOD, error)
        offsets.append(axis.offset)
        here = offsets[max(k - 6, 0)]
        forces.append(max(stiffness * (here - wall(now)), 0.0))
        late = k - LATENCY + 6
        if late >= 0 and now < until:
            axis.add_measurement(late * PERIOD, forces[late])
    return np.array(offsets), np.array(forces)


@pytest.mark.parametrize('stiffness', [500.0, 600.0, 900.0, 1200.0])
def test_the_desired_force_is_reached_without_a_bounce(stiffness):
    _, forces = press(SETTINGS, lambda _: 0.0, 6.0, stiffness)
    assert forces[-100:] == pytest.approx(SETTINGS.force, rel=0.02)
    touched = np.flatnonzero(forces > 0.0)[0]
    assert (forces[touched + 1:] > 0.0).all()
    assert forces.max() < 1.5 * SETTINGS.force


def test_a_step_of_the_wall_is_followed():
    def wall(time):
        return -0.02 * min(max((time - 4.0) / 0.3, 0.0), 1.0)

    _, forces = press(SETTINGS, wall, 8.0)
    assert forces[400:].max() < 1.5 * SETTINGS.force
    assert forces[400:].min() > 0.5 * SETTINGS.force
    assert forces[-100:] == pytest.approx(SETTINGS.force, rel=0.02)


def test_a_wall_that_sways_hardly_changes_the_force():
    _, forces = press(SETTINGS, lambda time: 1e-3 * math.sin(math.tau * 0.3 * time), 20.0)
    assert abs(forces[800:] - SETTINGS.force).max() < 0.02 * SETTINGS.force


def test_a_wall_out_of_reach_is_approached_slowly_and_no_further_than_the_range():
    offsets, forces = press(SETTINGS, lambda _: 1.0, 6.0)
    assert np.diff(offsets).max() <= SETTINGS.approach_speed * PERIOD + 1e-12
    assert offsets[-1] == pytest.approx(SETTINGS.range)
    assert not forces.any()


def test_with_stiffness_the_goal_pulls_back():
    settings = replace(SETTINGS, stiffness=600.0)
    offsets, forces = press(settings, lambda _: 0.0, 8.0)
    assert forces[-1] + settings.stiffness * offsets[-1] == pytest.approx(
        settings.force, rel=0.05)


def test_without_measurements_the_offset_returns_to_nothing():
    offsets, _ = press(SETTINGS, lambda _: 0.0, 10.0, until=5.0)
    assert offsets[490] > 0.03
    assert offsets[-1] == pytest.approx(0.0, abs=1e-6)
    assert abs(np.diff(offsets)).max() <= SETTINGS.speed * PERIOD


def test_disabled_nothing_gives_way():
    offsets, _ = press(replace(SETTINGS, enabled=False), lambda _: -0.03, 2.0)
    assert not offsets.any()


def test_at_the_workspace_limit_the_offset_goes_no_further():
    offsets, _ = press(SETTINGS, lambda _: 1.0, 2.0, error=0.001)
    assert not offsets.any()


def test_the_yaw_turns_until_the_wall_makes_no_moment():
    settings = YawImpedanceSettings(enabled=True)
    axis, offset = Impedance(settings), 0.0
    for k in range(400):
        now = k * PERIOD
        axis.add_measurement(now, 13.5 * (offset - 0.05))
        axis.step(now, now + HORIZON, PERIOD, 0.0)
        offset = axis.offset
    assert axis.offset == pytest.approx(0.05, abs=1e-4)


@pytest.mark.parametrize('values', [
    {'range': 0.0}, {'contact_stiffness': 0.0}, {'damping': -1.0}, {'force': math.nan}])
def test_settings_that_make_no_sense_are_rejected(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        ImpedanceSettings(**values)


@pytest.mark.parametrize('settings', [SETTINGS, YawImpedanceSettings(enabled=True, force=3.0)])
def test_an_axis_that_is_switched_off_comes_back_to_the_goal_and_idles(settings):
    axis = Impedance(settings)
    assert not axis.idle
    for k in range(100):
        axis.step(0.01 * k, 0.01 * k, PERIOD, 0.0)
        axis.add_measurement(0.01 * k, 0.0)
    assert axis.offset > 0.0
    axis.settings = replace(settings, enabled=False)
    assert not axis.idle
    for k in range(100, 3000):
        axis.step(0.01 * k, 0.01 * k, PERIOD, 0.0)
    assert axis.idle and axis.offset == 0.0


def test_what_the_wall_did_before_the_axis_idled_is_forgotten(monkeypatch):
    """Nobody steps an axis that idles, so a measurement after a pause begins again."""
    monkeypatch.setattr(impedance, 'OBSERVER_TIME', 2.0)
    settings = replace(SETTINGS, enabled=False)
    idle, stepped = Impedance(settings), Impedance(settings)
    for axis in (idle, stepped):
        axis.add_measurement(0.0, 70.0)
    stepped.step(0.6, 0.6, 0.6, 0.0)
    for axis in (idle, stepped):
        axis.settings = replace(settings, enabled=True)
        axis.add_measurement(0.7, 0.0)
        axis.step(0.71, 0.71, PERIOD, 0.0)
    assert idle.offset == stepped.offset
