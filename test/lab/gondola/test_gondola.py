"""The gondola on its cables."""

from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.kinematics import GRAVITY
from facade_manipulator.lab.gondola.gondola import Gondola, GondolaSettings
from facade_manipulator.lab.gondola.wind import WindSettings

SETTINGS = GondolaSettings()
WIND = WindSettings()


def course(gondola, duration=120.0, period=0.05):
    return np.array([gondola.at(time) for time in np.arange(0.0, duration, period)])


@pytest.mark.parametrize('length', [10.0, 30.0, 100.0])
def test_the_first_mode_is_nearly_the_pendulum_of_cable_and_body(length):
    gondola = Gondola(replace(SETTINGS, cable_length=length), WIND)
    pendulum = math.sqrt(GRAVITY / (length + SETTINGS.body_height))
    assert gondola.frequencies[0] == pytest.approx(pendulum, rel=0.01)


def test_the_yaw_is_that_of_a_bifilar_pendulum():
    yaw = Gondola(replace(SETTINGS, guide_lever=0.0), WIND).frequencies[4]
    half = 0.5 * SETTINGS.cable_distance
    assert yaw == pytest.approx(
        half / SETTINGS.yaw_radius * math.sqrt(GRAVITY / SETTINGS.cable_length))


def test_a_guide_at_both_ends_stiffens_the_yaw():
    without, with_lever = (
        Gondola(replace(SETTINGS, guide_lever=lever), WIND).frequencies[4] for lever in (0.0, 0.6))
    inertia = SETTINGS.mass * SETTINGS.yaw_radius ** 2
    assert inertia * (with_lever ** 2 - without ** 2) == pytest.approx(600.0 * 0.6 ** 2)


@pytest.mark.long
def test_in_gusts_it_swings_about_its_place_in_the_mean_wind_at_its_own_frequency():
    gondola = Gondola(SETTINGS, WIND)
    poses = course(gondola, 400.0)
    assert (0.03, 0.003, 0.005) < tuple(poses.std(axis=0)) < (0.3, 0.05, 0.1)
    assert abs(poses.mean(axis=0)).max() < 0.02
    power = np.abs(np.fft.rfft(poses[:, 0] * np.hanning(len(poses)))) ** 2
    peak = np.fft.rfftfreq(len(poses), 0.05)[power.argmax()]
    assert peak == pytest.approx(gondola.frequencies[0] / math.tau, rel=0.15)


def test_the_motion_is_smooth():
    gondola = Gondola(SETTINGS, WIND)
    places = course(gondola, 5.0, 0.001)
    accelerations = np.diff(places, 2, axis=0) / 1e-6
    assert abs(accelerations).max() < 2.0


def test_the_past_can_be_asked_again():
    gondola = Gondola(SETTINGS, WIND)
    early = gondola.at(3.3)
    gondola.at(30.0)
    assert gondola.at(3.3) == early
    assert Gondola(SETTINGS, WIND).at(3.3) == pytest.approx(tuple(early), abs=1e-12)
