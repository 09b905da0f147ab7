"""Reduction of forecasts that contain more acceleration than a gondola can have."""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.prediction.prior import HORIZONS


class Reduction:
    """
    Mean position and maximum forecast acceleration of each axis.

    The predictor passes each forecast. A forecast within the maximum acceleration is not changed.
    """

    # m/s², m/s², rad/s²; a larger acceleration is compensated in part
    MAX_ACCELERATION = np.array((1.0, 0.7, 1.4))
    # s, time constant of the mean position, towards which a forecast is reduced
    MEAN_TIME = 5.0
    # s, time constant with which the largest forecast acceleration is forgotten
    BEND_TIME = 0.5
    # from the first positions of a forecast to their acceleration
    _BEND = np.array((1.0, -2.0, 1.0)) / HORIZONS[0] ** 2

    def __init__(self, axes: int) -> None:
        self._mean = np.zeros(axes)
        self._bend = np.zeros(axes)  # [m/s² or rad/s²]

    def update(self, interval: float, values: np.ndarray) -> None:
        """Update the mean with positions, after an interval [s]."""
        share = 1.0 - math.exp(-interval / self.MEAN_TIME)
        self._mean = self._mean + share * (values - self._mean)

    def reduced(self, interval: float, forecast: np.ndarray) -> np.ndarray:
        """Reduce a forecast, shape (axes, HORIZONS), to the permitted acceleration."""
        forgotten = math.exp(-interval / self.BEND_TIME) * self._bend
        self._bend = np.maximum(forgotten, abs(forecast[:, :3] @ self._BEND))
        share = self.MAX_ACCELERATION / np.maximum(self._bend, self.MAX_ACCELERATION)
        mean = self._mean[:, None]
        return mean + share[:, None] * (forecast - mean)
