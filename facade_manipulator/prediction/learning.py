"""
Schedule of learning: all axes of a group of horizons, then the tones of one axis.

Because of these turns, no estimate takes much longer to learn from than any other estimate. The
near horizons are learnt three times as often as the far horizons. The prior of the continuation
needs the strength of the motion: the largest squared acceleration that the level filter has shown,
with slow forgetting.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import cycle
import math

import numpy as np

from facade_manipulator.prediction.continuation import (
    Continuation,
    Sample,
    STAMP_ROUNDING,
    UNKNOWN_VARIANCE,
)
from facade_manipulator.prediction.filters import (
    ACCELERATION_FEATURE,
    BANDWIDTHS,
    LEVEL_FILTER,
)
from facade_manipulator.prediction.positions import Positions
from facade_manipulator.prediction.prior import HORIZONS, noise_moments
from facade_manipulator.prediction.tones import Tones


class Learning:
    """
    Quantities learnt about the motion since a start.

    The predictor passes each estimate to `update`, and the forecast that follows to `add`.

    Parameters
    ----------
    stamp : float
        Time of the start [s].
    noise : numpy.ndarray, shape (axes,)
        Variance of the estimates' noise [m² or rad²].
    mean_interval : float
        Mean time between estimates [s].

    Attributes
    ----------
    tones : Tones
    weights : numpy.ndarray, shape (axes, FEATURES, HORIZONS)
    trust : numpy.ndarray, shape (axes, HORIZONS)
        Share of the step towards the tones.
    variances : list of list of float
        Variances of the prediction errors of each axis at each horizon [m² or rad²].

    """

    NEAR_HORIZONS = slice(0, 4)  # groups of horizons
    FAR_HORIZONS = slice(4, None)
    LEARNING_PERIOD = 0.14  # s
    PEAK_TIME = 20.0  # s, with which the largest estimated acceleration is forgotten
    # variance of the acceleration in the prior divided by the squared peak
    PEAK_SHARE = 0.1
    # minimum squared acceleration of a motion, divided by the variance of its noise
    NOISE_PEAK = 9.0
    # growth of the squared acceleration, above which earlier learning weighs less
    GROWTH = 2.0
    # from the level filter's feature a/ω² to the squared acceleration
    _SQUARED = BANDWIDTHS[LEVEL_FILTER] ** 4
    # variance of the level filter's acceleration / noise density
    ACCELERATION_NOISE = (
        _SQUARED * noise_moments().features[ACCELERATION_FEATURE, ACCELERATION_FEATURE]
    )

    def __init__(self, stamp: float, noise: np.ndarray, mean_interval: float) -> None:
        axes = len(noise)
        near = Continuation(axes, self.NEAR_HORIZONS)
        far = Continuation(axes, self.FAR_HORIZONS)
        self._groups = (near, far)
        self._turns = zip(
            cycle((near, near, near, far)), cycle(range(axes)), strict=False
        )
        self.tones = Tones(axes, HORIZONS)
        self._next = stamp + self.LEARNING_PERIOD  # s, when learning is due
        self._peak = np.zeros(axes)  # of the squared acceleration
        # peak learnt so far
        self._known = noise * (mean_interval * self.ACCELERATION_NOISE)
        self._solve(self._groups, noise, mean_interval)

    def variance(self, axis: int, ahead: float) -> float:
        """Return the variance of an axis's prediction after a time [s]."""
        if ahead <= HORIZONS[0]:  # interpolation would take ten times as long
            return self.variances[axis][0]
        return float(
            np.interp(ahead, HORIZONS, self.variances[axis], right=UNKNOWN_VARIANCE)
        )

    def add(self, sample: Sample) -> None:
        """Store the forecast after an estimate for later learning."""
        for group in self._groups:
            group.add(sample)

    def update(
        self,
        stamp: float,
        interval: float,
        seen: np.ndarray,
        noise: np.ndarray,
        mean_interval: float,
        positions: Positions,
    ) -> None:
        """Update the strength of the motion from the features; learn if learning is due."""
        floor = noise * (mean_interval * self.ACCELERATION_NOISE)
        forgotten = math.exp(-interval / self.PEAK_TIME) * self._peak
        squared = self._SQUARED * seen[:, ACCELERATION_FEATURE] ** 2
        self._peak = np.maximum(forgotten, squared - self.NOISE_PEAK * floor)
        if stamp <= self._next - STAMP_ROUNDING:
            return

        self._next = stamp + self.LEARNING_PERIOD
        self._weaken(floor + self._peak)
        group, axis = next(self._turns)
        self.tones.fit(axis, noise[axis])
        group.learn(noise, positions)
        self._solve([group], noise, mean_interval)
        positions.forget(min(one.begin for one in self._groups))

    def _weaken(self, strongest: np.ndarray) -> None:
        """Reduce the weight of earlier learning if the greatest squared acceleration has grown."""
        share = np.minimum(self.GROWTH * self._known / strongest, 1.0)
        for group in self._groups:
            group.weaken(share)
        self._known = np.maximum(self._known, strongest / self.GROWTH)
        self._known = np.minimum(self._known, strongest)

    def _solve(
        self, groups: Iterable[Continuation], noise: np.ndarray, mean_interval: float
    ) -> None:
        """Solve the given groups of horizons, then join the results of all groups."""
        strength = self.PEAK_SHARE * self._peak
        density = noise * mean_interval
        for group in groups:
            group.solve(strength, density, self.tones.noise_gain)

        near, far = self._groups
        self.weights = np.concatenate((near.weights, far.weights), axis=-1)
        self.trust = np.concatenate((near.trust, far.trust), axis=-1)
        variances = np.concatenate((near.variances, far.variances), axis=-1)
        self.variances: list[list[float]] = variances.tolist()
