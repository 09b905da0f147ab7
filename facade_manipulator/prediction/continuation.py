"""
Learn how a motion goes on: direct multi-step least squares with forgetting and a physical prior.

For each horizon τ the move m = d(t + τ) − level is forecast as Wᵀφ(t). W solves

    (G + λ (s² G_sway + r G_noise)) W = M + λ (s² M_sway + r M_noise),

where G = ∫ φ φᵀ dt and M = ∫ φ mᵀ dt are what was seen, forgotten exponentially, and the rest is a
prior in place of a ridge: λ seconds of sway of acceleration s and of noise of density r. This is
the mean of a Bayesian regression whose prior was learnt from made-up data.

Gusts are learnt so as well as anybody can; tones may be known better, from much longer. So the
forecast is a step away from the continuation towards that of tones, none to all of it, as would
have been best in the last seconds. Relatives in the prediction of heave and tremor are
autoregressive models and BMFLC; this one has neither a recursion nor frequencies that it needs,
so that nothing in it can become unstable.

References
----------
G. Chevillon, "Direct multi-step estimation and forecasting", Journal of Economic Surveys 21
(2007) 746-785, https://doi.org/10.1111/j.1467-6419.2007.00518.x.
A. E. Hoerl, R. W. Kennard, "Ridge regression", Technometrics 12 (1970) 55-67,
https://doi.org/10.1080/00401706.1970.10488634.
L. Breiman, "Stacked regressions", Machine Learning 24 (1996) 49-64,
https://doi.org/10.1007/BF00117832.
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

PRIOR_TIME = 4.0  # s after which as much was learnt as the prior says
LEAST_LEARNT = 0.04  # s: the prior is worth 100 s at most
START_SHARE = 0.7  # of the time learnt, the memory at first
SCORE_TIME = 3.0  # s, time constant with which errors are forgotten
UNKNOWN = 1.0  # m² or rad², of errors of which nothing is known yet
LEAST_STEP = 0.1  # 1/s, squares of steps by the density of noise, below which none counts
LONGEST_STEP = 0.15  # s between estimates, beyond which the motion between is not known
FULL, MEAN, FINAL, RIGHT, STEP = range(5)  # what is scored: errors, and steps towards tones


class Sample(NamedTuple):
    """What was known at an estimate: times [s] and, by axis, positions [m or rad]."""

    stamp: float
    interval: float  # since the estimate before
    values: np.ndarray
    level: np.ndarray
    features: np.ndarray  # (axes, FEATURES)
    forecasts: tuple[np.ndarray, ...]  # full, mean, final, continuation, step: (axes, HORIZONS)


class Continuation:
    """
    Learnt weights of the features for every axis and some horizons.

    Parameters
    ----------
    axes : int
    chosen : slice
        Of `HORIZONS`; the longest decides how late all are learnt.
    memory : float
        Time constant of forgetting [s].

    Attributes
    ----------
    weights : numpy.ndarray, shape (axes, FEATURES, horizons)
    variances : numpy.ndarray, shape (axes, horizons)
        Of the predictions' errors.
    trust : numpy.ndarray, shape (axes, horizons)
        Of the steps towards tones, that is right.
    share : numpy.ndarray, shape (axes, horizons)
        Of the forecast that is worth more than the mean.

    """

    def __init__(self, axes: int, chosen: slice, memory: float) -> None:
        self.chosen, self._horizons, self._memory = chosen, HORIZONS[chosen], memory
        self._samples: deque[Sample] = deque()
        self._squares = np.zeros((axes, FEATURES, FEATURES))
        self._moves = np.zeros((axes, FEATURES, len(self._horizons)))
        self._learnt, self._elapsed = np.zeros(axes), 0.0
        self._scores = np.zeros((5, axes, len(self._horizons)))
        self._scores[[FULL, MEAN, FINAL]] = UNKNOWN

    def add(self, sample: Sample) -> None:
        """Keep a sample until all that it forecast has come."""
        self._samples.append(sample)

    def weaken(self, share: np.ndarray) -> None:
        """Let what was learnt count for a share of its time: it was learnt of weaker motion."""
        self._learnt = self._learnt * share

    def learn(self, noise: np.ndarray) -> None:
        """Learn from the samples of which every horizon has passed, and forget them."""
        stamps = np.array([sample.stamp for sample in self._samples])
        count = int(np.searchsorted(stamps, stamps[-1] - self._horizons[-1] + 1e-6))
        if not count:
            return
        values = np.stack([sample.values for sample in self._samples], axis=1)
        later = stamps[:count, None] + self._horizons
        after = np.clip(np.searchsorted(stamps, later), 1, len(stamps) - 1)
        steps = stamps[after] - stamps[after - 1]
        share = (later - stamps[after - 1]) / steps
        came = (1.0 - share) * values[:, after - 1] + share * values[:, after]
        spread = ((1.0 - share) ** 2 + share ** 2) * noise[:, None, None]
        _, intervals, _, level, features, forecasts = (
            np.array(part) for part in zip(
                *(self._samples.popleft() for _ in range(count)), strict=True))
        intervals = np.minimum(intervals, LONGEST_STEP)
        duration = float(intervals.sum())
        self._elapsed += duration
        weights = intervals * (steps <= LONGEST_STEP).all(axis=1)
        self._score(weights, came, spread, forecasts.transpose(1, 2, 0, 3)[..., self.chosen])
        # estimates that were better than they said are no credit for others that are better
        self._scores[:RIGHT] = np.maximum(self._scores[:RIGHT], -noise[:, None])
        kept = math.exp(-duration / min(START_SHARE * self._elapsed, self._memory))
        features = features.swapaxes(0, 1)
        weighted = (features * weights[:, None]).swapaxes(1, 2)
        self._squares = kept * self._squares + weighted @ features
        self._moves = kept * self._moves + weighted @ (came - level.T[..., None])
        self._learnt = kept * self._learnt + weights.sum()

    def _score(
        self, weights: np.ndarray, came: np.ndarray, spread: np.ndarray, forecasts: np.ndarray
    ) -> None:
        """Score the forecasts by the estimates that followed."""
        *whole, continued, step = forecasts
        scores = np.stack((
            *((forecast - came) ** 2 - spread for forecast in whole),
            step * (came - continued), step ** 2))
        known = max(weights.sum(), 1e-9)
        self._scores += known / min(SCORE_TIME, self._elapsed) * (
            np.einsum('c,kach->kah', weights / known, scores) - self._scores)

    def solve(self, strength: np.ndarray, noise: np.ndarray, tones: np.ndarray) -> None:
        """
        Find the weights, and how good they are.

        Parameters
        ----------
        strength : numpy.ndarray, shape (axes,)
            Variance of the acceleration that the prior expects [m²/s⁴].
        noise : numpy.ndarray, shape (axes,)
            Density of the estimates' noise, variance times interval [m² s].
        tones : numpy.ndarray, shape (axes,)
            Variance of the tones by that density [1/s].

        """
        sway, white = sway_moments(), noise_moments()
        prior = PRIOR_TIME / np.maximum(self._learnt, LEAST_LEARNT)
        s, r = ((prior * part)[:, None, None] for part in (strength, noise))
        self.weights = np.linalg.solve(
            self._squares + s * sway.features + r * white.features,
            self._moves + (s * sway.moves + r * white.moves)[..., self.chosen])
        self.trust = np.clip(
            self._scores[RIGHT] / (self._scores[STEP] + LEAST_STEP * noise[:, None]), 0.0, 1.0)
        gain = (1.0 - self.trust) ** 2 * self.noise_gain() + self.trust ** 2 * tones[:, None]
        full, mean, self.variances = np.maximum(self._scores[:RIGHT], gain * noise[:, None])
        self.share = np.minimum(mean / full, 1.0)

    def noise_gain(self) -> np.ndarray:
        """Return the variance of predictions by the density of noise [1/s], (axes, horizons)."""
        white = noise_moments()
        crossed = white.features @ self.weights - 2.0 * white.moves[:, self.chosen]
        return white.level + (self.weights * crossed).sum(axis=1)
