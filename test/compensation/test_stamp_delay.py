"""The delay of the estimator's stamps, from the slip of the head while it runs."""

from dataclasses import replace
import math

import pytest

from facade_manipulator.compensation.contact import StampDelay
from facade_manipulator.lab.gondola.bench.__main__ import run_scenario
from facade_manipulator.lab.gondola.scenario import load_scenario


def regressed(delay, offset=0.0, amplitude=0.1, duration=60.0, rate=50):
    watch = StampDelay()
    for tick in range(round(duration * rate)):
        time = tick / rate
        speed = amplitude * math.cos(0.7 * time)
        watch.add(time, offset + delay * speed, speed)
    return watch


@pytest.mark.parametrize('delay', [-0.05, 0.0, 0.02])
def test_slip_in_time_with_the_speed_is_a_delay_whatever_its_offset(delay):
    for offset in (0.0, 0.3):
        assert regressed(delay, offset).found == pytest.approx((delay, 0.0), abs=1e-6)


def test_a_gondola_that_hangs_still_or_was_seen_for_seconds_shows_no_delay():
    assert regressed(0.02, amplitude=0.002).found is None
    watch = regressed(0.02, duration=15.0)
    assert watch.found is None
    watch = regressed(0.02)
    watch.begin()
    assert watch.found is None


@pytest.mark.long
def test_the_loop_finds_the_delay_of_its_estimator_while_it_runs_and_regulates_the_slip():
    scenario = load_scenario('breeze')
    compensator = run_scenario(scenario._replace(
        mission=replace(scenario.mission, duration=54.0),
        wall=replace(scenario.wall, slip_sensor=True),
        estimator=replace(scenario.estimator, stamp_error=0.02),
        compensator=scenario.compensator._replace(lateral=replace(
            scenario.compensator.lateral, enabled=True)))).loop.compensator
    delay, deviation = compensator.stamp_delay
    assert delay == pytest.approx(0.02, abs=3e-3)
    assert deviation < 3e-3
    compensator.change('estimate', replace(compensator.gate.settings, delay=0.02))
    assert compensator.stamp_delay is None  # the estimates mean another motion
