"""
Learn how a motion goes on: direct multi-step least squares with forgetting and a physical prior.

For each horizon τ the move m = d(t + τ) − level is forecast as Wᵀφ(t). W solves

    (G + λ (s² G_sway + r G_noise)) W = M + λ (s² M_sway + r M_noise),

where G = ∫ φ φᵀ dt and M = ∫ φ mᵀ dt are what was seen, forgotten exponentially, and the rest is a
prior in place of a ridge: λ seconds of sway of acceleration s and of noise of density r. This is
the mean of a Bayesian regression whose prior was learnt from made-up data. Relatives in the
prediction of heave and tremor are autoregressive models and BMFLC; this one has neither a
recursion nor frequencies to adapt, so that nothing in it can become unstable.

References
----------
G. Chevillon, "Direct multi-step estimation and forecasting", Journal of Economic Surveys 21
(2007) 746-785, https://doi.org/10.1111/j.1467-6419.2007.00518.x.
A. E. Hoerl, R. W. Kennard, "Ridge regression", Technometrics 12 (1970) 55-67,
https://doi.org/10.1080/00401706.1970.10488634.
K. C. Veluvolu, W. T. Ang, "Estimation of physiological tremor from accelerometers for real-time
applications", Sensors 11 (2011) 3020-3036, https://doi.org/10.3390/s110303020.
"""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.prediction.filters import FEATURES
from facade_manipulator.prediction.prior import HORIZONS, noise_moments, sway_moments

PRIOR_TIME = 2.0  # s after which as much was learnt as the prior says
PRIOR_POWER = 3  # with which its share falls
MOST_PRIOR = 100.0  # s
START_SHARE = 0.5  # of the time learnt, the memory at first: filters begin at rest
SCORE_TIME = 5.0  # s, time constant with which errors are forgotten
KINDS = 3  # of forecasts
UNKNOWN = 1.0  # m² or rad², of errors of which nothing is known yet
LONGEST_STEP = 0.15  # s between estimates, beyond which the motion between is not known


class FilterSample(NamedTuple):
    """
    What was known at an estimate.

    Parameters
    ----------
    stamp, interval : float
        [s], the interval since the estimate before.
    values : numpy.ndarray, shape (axes,)
    features : numpy.ndarray, shape (axes, FEATURES)
    level : numpy.ndarray, shape (axes,)
    forecasts : numpy.ndarray, shape (kinds, axes, HORIZONS)
        Positions that were predicted then.

    """

    stamp: float
    interval: float
    values: np.ndarray
    features: np.ndarray
    level: np.ndarray
    forecasts: np.ndarray


class Continuation:
    """
    Learnt weights of the features for every axis and some horizons.

    Parameters
    ----------
    axes : int
    horizons : slice
        Of `HORIZONS`; the longest decides how late all are learnt.
    memory : float
        Time constant of forgetting [s].

    Attributes
    ----------
    chosen : slice
        The horizons.
    weights : numpy.ndarray, shape (axes, FEATURES, horizons)
    errors : numpy.ndarray, shape (kinds, axes, horizons)
        Mean squares of the forecasts' errors, without the estimates' noise.

    """

    def __init__(self, axes: int, horizons: slice, memory: float) -> None:
        self.chosen, self._horizons, self._memory = horizons, HORIZONS[horizons], memory
        self._samples: deque[FilterSample] = deque()
        self._features = np.zeros((axes, FEATURES, FEATURES))
        self._moves = np.zeros((axes, FEATURES, len(self._horizons)))
        self._learnt = np.zeros(axes)
        self._elapsed = 0.0
        self.weights = np.zeros_like(self._moves)
        self.errors = np.full((KINDS, axes, len(self._horizons)), UNKNOWN)

    def add(self, sample: FilterSample) -> None:
        """Keep a sample until all that it forecast has come."""
        self._samples.append(sample)

    def weaken(self, share: np.ndarray) -> None:
        """Let what was learnt count for a share of its time: it was learnt of weaker motion."""
        self._learnt *= share

    def learn(self, noise: np.ndarray) -> None:
        """Learn from the samples of which every horizon has passed, and forget them."""
        if not self._samples:
            return
        stamps = np.array([sample.stamp for sample in self._samples])
        count = int(np.searchsorted(stamps, stamps[-1] - self._horizons[-1] + 1e-6))
        if not count:
            return
        values = np.stack([sample.values for sample in self._samples])
        later = stamps[:count, None] + self._horizons
        after = np.clip(np.searchsorted(stamps, later), 1, len(stamps) - 1)
        steps = (stamps[after] - stamps[after - 1])[..., None]
        share = (later - stamps[after - 1])[..., None] / steps
        came = (1.0 - share) * values[after - 1] + share * values[after]
        noise = ((1.0 - share) ** 2 + share ** 2) * noise
        samples = [self._samples.popleft() for _ in range(count)]
        intervals = np.minimum([sample.interval for sample in samples], LONGEST_STEP)
        weights = intervals * (steps[..., 0] <= LONGEST_STEP).all(axis=1)
        self._regress(samples, came.transpose(2, 0, 1), weights, float(intervals.sum()))
        self._score(samples, came, noise, weights)

    def _regress(
        self, samples: list[FilterSample], came: np.ndarray, weights: np.ndarray, duration: float
    ) -> None:
        self._elapsed += duration
        kept = math.exp(-duration / min(START_SHARE * self._elapsed, self._memory))
        features = np.stack([sample.features for sample in samples], axis=1)
        levels = np.stack([sample.level for sample in samples], axis=1)
        weighted = (features * weights[:, None]).swapaxes(1, 2)
        self._features = kept * self._features + weighted @ features
        self._moves = kept * self._moves + weighted @ (came - levels[..., None])
        self._learnt = kept * self._learnt + weights.sum()

    def _score(
        self, samples: list[FilterSample], came: np.ndarray, noise: np.ndarray, weights: np.ndarray
    ) -> None:
        forecasts = np.stack([sample.forecasts for sample in samples])[..., self.chosen]
        squares = (forecasts - came.swapaxes(1, 2)[:, None]) ** 2 - noise.swapaxes(1, 2)[:, None]
        known = max(weights.sum(), 1e-9)
        mean = (weights @ squares.reshape(len(weights), -1)).reshape(self.errors.shape) / known
        self.errors += known / min(SCORE_TIME, self._elapsed) * (mean - self.errors)

    def solve(self, strength: np.ndarray, noise: np.ndarray) -> None:
        """
        Find the weights.

        Parameters
        ----------
        strength : numpy.ndarray, shape (axes,)
            Variance of the acceleration that the prior expects [m²/s⁴].
        noise : numpy.ndarray, shape (axes,)
            Density of the estimates' noise, variance times interval [m² s].

        """
        sway, white = sway_moments(), noise_moments()
        share = PRIOR_TIME / np.maximum(self._learnt, 1e-3)
        prior = np.minimum(share ** PRIOR_POWER, MOST_PRIOR)
        s, r = (prior * strength)[:, None, None], (prior * noise)[:, None, None]
        self.weights = np.linalg.solve(
            self._features + s * sway.features + r * white.features,
            self._moves + s * sway.moves[:, self.chosen] + r * white.moves[:, self.chosen])

    def noise_gain(self) -> np.ndarray:
        """Return the variance of predictions by the density of noise [1/s], (axes, horizons)."""
        white, weights = noise_moments(), self.weights
        crossed = white.features @ weights - 2.0 * white.moves[:, self.chosen]
        return white.level + (weights * crossed).sum(axis=1)
