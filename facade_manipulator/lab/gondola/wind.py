"""
Wind at a height: a mean and seeded gusts with the spectrum of the atmosphere's surface layer.

References
----------
J. C. Kaimal et al., "Spectral characteristics of surface-layer turbulence", Quarterly Journal of
the Royal Meteorological Society 98 (1972) 563-589, https://doi.org/10.1002/qj.49709841707.
T. von Kármán, "Progress in the statistical theory of turbulence", Proceedings of the National
Academy of Sciences 34 (1948) 530-539, https://doi.org/10.1073/pnas.34.11.530.
"""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import parameter, settings

VON_KARMAN_CONSTANT = 0.4
LOWEST_FREQUENCY = 0.004
HIGHEST_FREQUENCY = 5.0
TONES = 160
# Kaimal's n S / u*² = a f / (1 + b f^c)^d with f = n z / U: along the mean wind, across, upwards
KAIMAL = ((105.0, 33.0, 1.0, 5.0 / 3.0), (17.0, 9.5, 1.0, 5.0 / 3.0), (2.1, 5.3, 5.0 / 3.0, 1.0))
ACROSS_SHARES = (1.0, 0.75, 0.5)


@settings
class WindSettings:
    """Mean wind, turbulence and seed."""

    spectrum: str = parameter(
        'Spectrum of the gusts', default='kaimal', choices=('kaimal', 'von_karman'))
    mean_speed: float = parameter(
        'Mean wind at the height of the gondola', default=4.0, unit='m/s', minimum=0.1,
        maximum=40.0)
    height: float = parameter(
        'Height above ground', default=40.0, unit='m', minimum=1.0, maximum=1000.0)
    roughness_length: float = parameter(
        'Roughness length of the ground: 0.3 suburbs, 1 city', default=0.3, unit='m', minimum=1e-4,
        maximum=5.0)
    direction: float = parameter(
        'Angle of the mean wind from the wall: 0 blows along x, pi/2 onto the wall', default=0.5,
        unit='rad', minimum=-math.pi, maximum=math.pi)
    integral_length: float = parameter(
        'Length of the eddies of the von Kármán spectrum', default=60.0, unit='m', minimum=0.1,
        maximum=1000.0)
    seed: int = parameter('Seed of the gusts', default=1, minimum=0)

    def __post_init__(self) -> None:
        if self.height <= 2.0 * self.roughness_length:
            raise ParameterError(
                f'height = {self.height:g} m is not above twice roughness_length = '
                f'{self.roughness_length:g} m')


class Wind:
    """Gusts as sums of tones with random phases: a function of time, one for each seed."""

    def __init__(self, settings: WindSettings) -> None:
        random = np.random.default_rng(settings.seed)
        edges = np.geomspace(LOWEST_FREQUENCY, HIGHEST_FREQUENCY, TONES + 1)
        inside = random.uniform(0.0, 1.0, (3, TONES))
        self._frequencies = edges[:-1] * (edges[1:] / edges[:-1]) ** inside
        power = np.stack([
            spectral_density(settings, component, frequencies)
            for component, frequencies in enumerate(self._frequencies)])
        self._amplitudes = np.sqrt(2.0 * power * np.diff(edges))
        self._phases = random.uniform(0.0, math.tau, (3, TONES))

    def gusts(self, times: np.ndarray) -> np.ndarray:
        """Return the gusts at times [s]: along the mean wind, across, upwards [m/s], (n, 3)."""
        angles = math.tau * times[:, None, None] * self._frequencies + self._phases
        return (self._amplitudes * np.cos(angles)).sum(axis=-1)


def friction_velocity(settings: WindSettings) -> float:
    """Return u* [m/s] by the logarithmic profile."""
    return VON_KARMAN_CONSTANT * settings.mean_speed / math.log(
        settings.height / settings.roughness_length)


def spectral_density(
    settings: WindSettings, component: int, frequencies: np.ndarray
) -> np.ndarray:
    """
    Return the one-sided spectral density of a component of the gusts [m²/s] at frequencies [Hz].

    Components are 0 along the mean wind, 1 across, 2 upwards.
    """
    if settings.spectrum == 'kaimal':
        a, b, c, d = KAIMAL[component]
        reduced = frequencies * settings.height / settings.mean_speed
        shape = a * reduced / (1.0 + b * reduced ** c) ** d
        return shape * friction_velocity(settings) ** 2 / frequencies
    deviation = 2.5 * friction_velocity(settings) * ACROSS_SHARES[component]
    time = settings.integral_length / settings.mean_speed
    squares = (frequencies * time) ** 2
    if component == 0:
        return 4.0 * deviation ** 2 * time / (1.0 + 70.8 * squares) ** (5.0 / 6.0)
    # across the mean wind, with the eddies half as long there as along it (isotropic turbulence)
    return 2.0 * deviation ** 2 * time * (1.0 + 188.8 * squares) / (
        1.0 + 70.8 * squares) ** (11.0 / 6.0)
