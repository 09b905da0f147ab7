"""
Doubt about the estimates of each axis: compare them with the last trusted forecast.

`jumps` tests one axis. The forecast for this test does not use the estimates in doubt: the error
of predictions from predicted values would grow with every step.
"""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np

from facade_manipulator.prediction.jumps import (
    DECISION_TIME,
    DOUBT,
    JumpDecision,
    JumpDetector,
)
from facade_manipulator.prediction.spline import LAST_HORIZON, motion, Pieces


class Doubt:
    """
    State of doubt about the estimates of all axes.

    The predictor asks for the `expected` positions, decides about each estimate, and passes each
    new forecast.

    Attributes
    ----------
    is_doubted, is_wrong : numpy.ndarray, shape (axes,)
        Whether the estimates of an axis are doubted, and whether they count as wrong at present.
    is_any_doubted : bool

    """

    STRONGEST_PUSH = (0.5, 0.35, 0.7)  # m/s², m/s², rad/s²: 250 N and 175 N on 500 kg
    # m² or rad², variance of the first predictions: the gondola may already move at 0.04 m/s or
    # rad/s
    START_SPREAD = (0.04 * DECISION_TIME) ** 2

    def __init__(self, axes: int) -> None:
        self._detectors = [JumpDetector(push) for push in self.STRONGEST_PUSH]
        # m² or rad², variance of the estimates in the tests of jumps
        self._spread = np.full(axes, self.START_SPREAD)
        self._newest: list[Pieces] = []
        self._trusted: list[tuple[float, Pieces]] = []  # stamp and spline of each axis
        self.is_any_doubted = False
        self.is_doubted = np.zeros(axes, bool)
        self.is_wrong = np.zeros(axes, bool)

    def trust(self, stamp: float, newest: list[Pieces]) -> None:
        """Store the forecasts after an estimate; a doubted axis keeps its trusted forecast."""
        self._newest = newest
        trusted = []
        for axis, pieces in enumerate(newest):
            is_kept = self._detectors[axis].is_doubted
            trusted.append(self._trusted[axis] if is_kept else (stamp, pieces))
        self._trusted = trusted

    def expected(self, time: float) -> np.ndarray:
        """Return the positions [m, rad] that the last trusted forecasts predict for a time [s]."""
        positions = []
        for stamp, pieces in self._trusted:
            position, _ = motion(pieces, min(time - stamp, LAST_HORIZON))
            positions.append(position)
        return np.array(positions)

    def fade(self, mean_interval: float, noise: np.ndarray) -> None:
        """
        Let an increased variance of the estimates fade to the noise variance, for an interval [s].

        The prediction of an axis that was unknown is still poor, so that a large error is not a
        jump. After a start the variance of a gondola that already moves fades in the same way.
        """
        kept = math.exp(-mean_interval / DECISION_TIME)
        self._spread = np.maximum(noise, kept * self._spread)

    def decide(
        self,
        stamp: float,
        interval: float,
        values: np.ndarray,
        errors: np.ndarray,
        variance: Callable[[int, float], float],
    ) -> list[JumpDecision]:
        """
        Return a decision about the newest estimate of each axis.

        Parameters
        ----------
        stamp, interval : float
            Time of the estimate, and time since the previous estimate [s].
        values, errors : numpy.ndarray, shape (axes,)
            Estimates, and their errors to the `expected` positions [m or rad].
        variance : callable
            Takes an axis and a time [s], and returns the variance of the prediction after it.

        """
        spreads = self._spread.tolist()
        positions = values.tolist()
        decisions = []
        for axis, error in enumerate(errors.tolist()):
            detector = self._detectors[axis]
            spread = spreads[axis]
            ahead = stamp - self._trusted[axis][0]
            deviation = math.sqrt(variance(axis, ahead) + spread)

            is_followed = False
            # otherwise the newest forecast is also the last trusted one
            if detector.is_doubted:
                newest, _ = motion(self._newest[axis], min(interval, LAST_HORIZON))
                newest_deviation = math.sqrt(variance(axis, interval) + spread)
                difference = abs(positions[axis] - newest)
                is_followed = difference < DOUBT * newest_deviation

            decisions.append(detector.evaluate(stamp, error, deviation, is_followed))

        was_any_doubted = self.is_any_doubted
        doubted = [one.is_doubted for one in self._detectors]
        self.is_any_doubted = any(doubted)
        if was_any_doubted or self.is_any_doubted:  # otherwise nothing has changed
            self.is_doubted = np.array(doubted)
            self.is_wrong = np.array([one.is_wrong for one in self._detectors])
        return decisions
