"""
Gusts with a Kaimal spectrum, and the wind force on the gondola.

The one-sided spectral density of component k at frequency f [Hz] is

    S_k(f) = 4 σ_k² (L_k / U) / (1 + 6 f L_k / U)^(5/3)

with mean wind U, σ_u = I U along the wind and σ_v = 0.8 σ_u across, L_u = 8.1 Λ, L_v = 2.7 Λ, and
Λ = 0.7 z for a height z up to 60 m.

References
----------
IEC 61400-1:2019, "Wind energy generation systems – Part 1: Design requirements", annex C.3.
"""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.simulation.world.scenario import Gondola, Wind

SHARES = np.array([1.0, 0.8])  # σ_k / σ_u
HEIGHT = 40.0  # m above ground
GUST_LENGTHS = np.array([8.1, 2.7]) * 0.7 * HEIGHT  # L_k [m]


def spectral_density(wind: Wind, frequencies: np.ndarray) -> np.ndarray:
    """Return S [m²/s] along and across the mean wind at frequencies [Hz], shape (2, n)."""
    times = GUST_LENGTHS / wind.mean_speed
    variances = (wind.turbulence * wind.mean_speed * SHARES) ** 2
    decay = (1.0 + 6.0 * np.outer(times, frequencies)) ** (5.0 / 3.0)
    return 4.0 * (variances * times)[:, None] / decay


class Gusts:
    """Wind velocity as a function of time: mean wind plus tones with seeded random phases."""

    FREQUENCIES = (1e-4, 5.0)  # Hz; 4 % of the variance at 5 m/s is outside
    TONES = 250

    def __init__(self, wind: Wind, random: np.random.Generator) -> None:
        edges = np.geomspace(*self.FREQUENCIES, self.TONES + 1)
        # a random frequency in each band, so that the gusts do not repeat
        frequencies = edges[:-1] * (edges[1:] / edges[:-1]) ** random.random(self.TONES)
        # a tone of amplitude √(2 S Δf) has the variance S Δf of its band
        density = spectral_density(wind, frequencies)
        self._amplitudes = np.sqrt(2.0 * density * np.diff(edges))
        self._rates = math.tau * frequencies
        self._phases = random.uniform(0.0, math.tau, (2, self.TONES))

        cosine = math.cos(wind.direction)
        sine = math.sin(wind.direction)
        self._turn = np.array([[cosine, -sine], [sine, cosine]])
        self.mean = self._turn @ (wind.mean_speed, 0.0)  #: along x and y [m/s]

    def velocity(self, time: float) -> np.ndarray:
        """Return the wind velocity along x and y [m/s] at a time [s]."""
        waves = np.cos(self._rates * time + self._phases)
        return self.mean + self._turn @ (self._amplitudes * waves).sum(axis=1)


AIR_DENSITY = 1.2  # kg/m³


def drag(gondola: Gondola, wind: np.ndarray) -> np.ndarray:
    """Return the force ½ ρ c A |v| v along x and y [N] of wind with velocity v [m/s]."""
    return 0.5 * AIR_DENSITY * gondola.drag_area * math.hypot(*wind) * wind
