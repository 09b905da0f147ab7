"""Gusts with the documented spectrum."""

import math

import numpy as np
import pytest

from facade_manipulator.simulation.world.scenario import Gondola, Wind
from facade_manipulator.simulation.world.wind import drag, Gusts, spectral_density

WIND = Wind(mean_speed=5.0, direction=0.5)


def gusts(seed, duration=600.0, step=0.05, wind=WIND):
    """Return gusts along and across the mean wind [m/s]."""
    source = Gusts(wind, np.random.default_rng(seed))
    times = np.arange(0.0, duration, step)
    velocities = np.array([source.velocity(time) for time in times])
    cosine = math.cos(wind.direction)
    sine = math.sin(wind.direction)
    return velocities @ np.array([[cosine, -sine], [sine, cosine]])


def test_gusts_have_mean_and_deviation_of_the_wind():
    # many winds at few instants, because the slowest gusts last for hours
    series = np.array([gusts(seed, 100.0, 20.0) for seed in range(400)])
    mean = series.mean(axis=(0, 1))
    deviation = series.std(axis=(0, 1))
    assert mean == pytest.approx((5.0, 0.0), abs=0.1)
    assert deviation == pytest.approx((0.9, 0.72), rel=0.06)


def test_gust_power_in_a_band_matches_the_spectrum():
    step = 0.05
    band = (0.1, 0.5)
    frequencies = np.fft.rfftfreq(12000, step)
    inside = (frequencies >= band[0]) & (frequencies < band[1])
    powers = []
    for seed in range(4):
        spectrum = np.fft.rfft(gusts(seed)[:, 0])
        powers.append((np.abs(spectrum[inside]) ** 2).sum())
    power = np.mean(powers)
    grid = np.linspace(*band, 2000)
    expected = np.trapezoid(spectral_density(WIND, grid)[0], grid)
    assert 2.0 * power / 12000**2 == pytest.approx(expected, rel=0.15)


def test_drag_grows_with_the_square_of_the_wind():
    push = drag(Gondola(drag_area=2.0), np.array([3.0, 4.0]))
    assert push == pytest.approx((18.0, 24.0))
