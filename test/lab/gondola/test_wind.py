"""Gusts: their spectrum, their strength, their seed."""

from dataclasses import replace
import math

import numpy as np
import pytest

from facade_manipulator.lab.gondola import wind

SETTINGS = wind.WindSettings()
SPECTRA = ('kaimal', 'von_karman')


@pytest.mark.long
@pytest.mark.parametrize('spectrum', SPECTRA)
@pytest.mark.parametrize('component', range(3))
def test_the_gusts_have_the_variance_of_their_spectrum(spectrum, component):
    settings = replace(SETTINGS, spectrum=spectrum)
    gusts = wind.Wind(settings).gusts(np.arange(0.0, 2000.0, 0.1))[:, component]
    frequencies = np.geomspace(0.004, 5.0, 4000)
    expected = np.trapezoid if hasattr(np, 'trapezoid') else np.trapz
    variance = expected(wind.spectral_density(settings, component, frequencies), frequencies)
    assert gusts.var() == pytest.approx(variance, rel=0.15)


@pytest.mark.parametrize('spectrum', SPECTRA)
def test_the_spectrum_falls_with_the_power_of_five_thirds(spectrum):
    settings = replace(SETTINGS, spectrum=spectrum)
    high, higher = wind.spectral_density(settings, 0, np.array([5.0, 50.0]))
    assert math.log10(higher / high) == pytest.approx(-5.0 / 3.0, abs=0.05)


def test_across_the_wind_isotropic_eddies_are_stronger_by_a_third_where_they_are_small():
    settings = replace(SETTINGS, spectrum='von_karman')
    along, *across = (
        wind.spectral_density(settings, component, np.array([50.0]))[0] for component in range(3))
    for density, share in zip(across, wind.ACROSS_SHARES[1:], strict=True):
        assert density / along == pytest.approx(4.0 / 3.0 * share ** 2, rel=1e-3)


@pytest.mark.parametrize('component', range(3))
def test_the_von_karman_spectrum_holds_the_whole_variance(component):
    settings = replace(SETTINGS, spectrum='von_karman')
    frequencies = np.geomspace(1e-6, 1e3, 20000)
    density = wind.spectral_density(settings, component, frequencies)
    deviation = 2.5 * wind.friction_velocity(settings) * wind.ACROSS_SHARES[component]
    variance = np.sum(0.5 * (density[1:] + density[:-1]) * np.diff(frequencies))
    assert variance == pytest.approx(deviation ** 2, rel=0.01)


def test_the_turbulence_is_of_the_usual_intensity():
    gusts = wind.Wind(SETTINGS).gusts(np.arange(0.0, 2000.0, 0.1))
    assert 0.1 < gusts[:, 0].std() / SETTINGS.mean_speed < 0.3
    assert gusts[:, 0].std() > gusts[:, 1].std() > gusts[:, 2].std()


def test_friction_velocity_follows_the_logarithmic_profile():
    settings = wind.WindSettings(mean_speed=10.0, height=10.0, roughness_length=0.1)
    assert wind.friction_velocity(settings) == pytest.approx(0.4 * 10.0 / math.log(100.0))


def test_the_same_seed_blows_the_same_wind():
    times = np.arange(0.0, 10.0, 0.5)
    assert np.array_equal(wind.Wind(SETTINGS).gusts(times), wind.Wind(SETTINGS).gusts(times))
    other = wind.Wind(replace(SETTINGS, seed=2)).gusts(times)
    assert not np.allclose(other, wind.Wind(SETTINGS).gusts(times))
