"""
Learnt continuation of a motion: multi-step least squares with forgetting and a prior.

Model: for each horizon τ the move m = d(t + τ) − level(t) [m or rad] is Wᵀφ(t), with the features
φ of `filters`. The weights W solve

    (G + λ (a² G_sway + r G_noise)) W = M + λ (a² M_sway + r M_noise),

where G = ∫ φ φᵀ dt and M = ∫ φ mᵀ dt are sums over the past motion with exponential forgetting.
The other terms are a prior instead of a ridge. The prior has the weight of λ seconds of sway with
an RMS acceleration a [m/s²], and of noise with a density r [m² s]. `prior` computes the moments of
the prior. λ is `PRIOR_WEIGHT` divided by the learnt time: after 2 s, data and prior have the same
weight. For a given λ, W is the posterior mean of a Bayesian regression with that prior.

W predicts gusts. A fit of sines to the last minute predicts tones better (`tones`). The forecast
is therefore the continuation plus a share of the step to the tones. The share is the trust, by
least squares over the last seconds.

A direct forecast uses no other forecast. Over a gap, however, and while estimates count as wrong,
the filters follow the last trusted forecast (`predictor`).

References
----------
G. Chevillon, "Direct multi-step estimation and forecasting", Journal of Economic Surveys 21
(2007) 746-785, https://doi.org/10.1111/j.1467-6419.2007.00518.x.
A. E. Hoerl, R. W. Kennard, "Ridge regression", Technometrics 12 (1970) 55-67,
https://doi.org/10.1080/00401706.1970.10488634.
L. Breiman, "Stacked regressions", Machine Learning 24 (1996) 49-64,
https://doi.org/10.1007/BF00117832.
"""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.prediction.filters import FEATURES
from facade_manipulator.prediction.positions import Positions
from facade_manipulator.prediction.prior import HORIZONS, noise_moments, sway_moments

UNKNOWN_VARIANCE = 1.0  # m² or rad², variance of a forecast whose errors are unknown
STAMP_ROUNDING = 1e-6  # s, of stamps and of the times computed from them


class Sample(NamedTuple):
    """
    Forecast of all axes made after an estimate, with the features used.

    Parameters
    ----------
    stamp, interval : float
        Time of the estimate, and time since the previous estimate [s].
    level : numpy.ndarray, shape (axes,)
        Positions from which moves count [m or rad].
    seen : numpy.ndarray, shape (axes, FEATURES)
        Features φ [m or rad].
    forecasts : numpy.ndarray, shape (3, axes, HORIZONS)
        Positions, positions without tones, and the step from the latter towards the tones
        [m or rad].

    """

    stamp: float
    interval: float
    level: np.ndarray
    seen: np.ndarray
    forecasts: np.ndarray


class Continuation:
    """
    Learnt feature weights for every axis, for one group of horizons.

    `Learning` adds each sample, and learns and solves in turns.

    Parameters
    ----------
    axes : int
    group : slice
        Selects from `HORIZONS`. A sample is learnt when its longest horizon has passed.

    Attributes
    ----------
    learnt : numpy.ndarray, shape (axes,)
        Learnt time [s], which is the weight of the moments against the prior. A stronger motion
        reduces it.
    weights : numpy.ndarray, shape (axes, FEATURES, horizons)
    variances : numpy.ndarray, shape (axes, horizons)
        Variances of the prediction errors [m² or rad²].
    trust : numpy.ndarray, shape (axes, horizons)
        Share of the step towards the tones, from 0 to 1.

    """

    MEMORY = 60.0  # s, time constant of forgetting
    START_SHARE = 0.7  # time constant at the beginning, as a share of the elapsed time
    # s²; λ is this value divided by the learnt time, and equals the learnt time after 2 s
    PRIOR_WEIGHT = 4.0
    MIN_LEARNT = 0.04  # s, keeps λ finite before anything is learnt
    SCORE_TIME = 3.0  # s, time constant with which errors are forgotten
    # 1/s, squared step divided by the noise density; smaller steps earn little trust
    MIN_STEP = 0.1
    LONGEST_STEP = 0.15  # s between estimates; over a longer time the motion is unknown
    # scores: squared error, step times the ideal step, squared step
    SQUARED_ERROR, STEP_TIMES_IDEAL, SQUARED_STEP = range(3)

    def __init__(self, axes: int, group: slice) -> None:
        self._group = group
        self._horizons = HORIZONS[group]
        self._samples: deque[Sample] = deque()
        self._squares = np.zeros((axes, FEATURES, FEATURES))  # G
        self._moves = np.zeros((axes, FEATURES, len(self._horizons)))  # M
        self.learnt = np.zeros(axes)
        self._elapsed = 0.0  # s, without forgetting
        self._scores = np.zeros((3, axes, len(self._horizons)))
        self._scores[self.SQUARED_ERROR] = UNKNOWN_VARIANCE

    @property
    def begin(self) -> float:
        """Return the stamp of the oldest sample that is not yet learnt [s]."""
        return self._samples[0].stamp if self._samples else math.inf

    def add(self, sample: Sample) -> None:
        """Store a sample until its longest horizon has passed."""
        self._samples.append(sample)

    def weaken(self, share: np.ndarray) -> None:
        """Multiply the learnt time of each axis by a share."""
        self.learnt = self.learnt * share

    def learn(self, noise: np.ndarray, positions: Positions) -> None:
        """
        Learn from the samples whose longest horizon has passed.

        The method adds these samples to G and M, with positions interpolated at t + τ, and scores
        their forecasts.

        Parameters
        ----------
        noise : numpy.ndarray, shape (axes,)
            Variance of the estimates' noise [m² or rad²].
        positions : Positions
            Of all samples [m or rad].

        """
        stamps = np.array([sample.stamp for sample in self._samples])
        end = stamps[-1] - self._horizons[-1] + STAMP_ROUNDING
        count = int(stamps.searchsorted(end))
        if not count:
            return

        # positions that were reached after the horizons, and the variance of their noise
        later = stamps[:count, None] + self._horizons
        after = stamps.searchsorted(later)
        after = np.minimum(np.maximum(after, 1), len(stamps) - 1)
        steps = stamps[after] - stamps[after - 1]
        share = (later - stamps[after - 1]) / steps
        values = positions.since(stamps[0])
        reached = (1.0 - share) * values[:, after - 1] + share * values[:, after]
        spread = ((1.0 - share) ** 2 + share**2) * noise[:, None, None]

        samples = [self._samples.popleft() for _ in range(count)]
        intervals = np.array([sample.interval for sample in samples])
        intervals = np.minimum(intervals, self.LONGEST_STEP)
        duration = float(intervals.sum())
        self._elapsed += duration
        # samples with a gap at a horizon get the weight 0
        weights = intervals * (steps <= self.LONGEST_STEP).all(axis=1)
        self._score(samples, weights, reached, spread, noise)
        self._add_moments(samples, weights, reached, duration)

    def _score(
        self,
        samples: list[Sample],
        weights: np.ndarray,
        reached: np.ndarray,
        spread: np.ndarray,
        noise: np.ndarray,
    ) -> None:
        """Compare the forecasts of samples with the positions reached later."""
        forecasts = np.array([sample.forecasts for sample in samples])
        forecasts = forecasts.transpose(1, 2, 0, 3)[..., self._group]
        forecast, continued, step = forecasts
        error = (forecast - reached) ** 2 - spread
        right = step * (reached - continued)
        scores = np.array((error, right, step**2))

        known = max(weights.sum(), 1e-9)
        mean = np.einsum('c,kach->kah', weights / known, scores)
        share = known / min(self.SCORE_TIME, self._elapsed)
        self._scores += share * (mean - self._scores)
        # Estimates better than their variance do not compensate later errors.
        self._scores[self.SQUARED_ERROR] = np.maximum(
            self._scores[self.SQUARED_ERROR], -noise[:, None]
        )

    def _add_moments(
        self,
        samples: list[Sample],
        weights: np.ndarray,
        reached: np.ndarray,
        duration: float,
    ) -> None:
        """Reduce the moments according to a duration [s], and add the moments of samples."""
        features = np.array([sample.seen for sample in samples]).swapaxes(0, 1)
        level = np.array([sample.level for sample in samples])
        weighted = (features * weights[:, None]).swapaxes(1, 2)
        kept = math.exp(-duration / min(self.START_SHARE * self._elapsed, self.MEMORY))
        self._squares = kept * self._squares + weighted @ features
        self._moves = kept * self._moves + weighted @ (reached - level.T[..., None])
        self.learnt = kept * self.learnt + weights.sum()

    def solve(
        self, strength: np.ndarray, density: np.ndarray, tones: np.ndarray
    ) -> None:
        """
        Compute the weights, the trust and the variances from the moments.

        Parameters
        ----------
        strength : numpy.ndarray, shape (axes,)
            Variance of the acceleration in the prior, a² [m²/s⁴ or rad²/s⁴].
        density : numpy.ndarray, shape (axes,)
            Density of the estimates' noise, variance times interval, r [m² s or rad² s].
        tones : numpy.ndarray, shape (axes,)
            Variance of the fitted tones at present, divided by that density [1/s].

        """
        sway = sway_moments()
        white = noise_moments()
        group = self._group

        # the equation of the weights, with the prior's moments times λ a² and λ r
        prior = self.PRIOR_WEIGHT / np.maximum(self.learnt, self.MIN_LEARNT)  # λ [s]
        a = (prior * strength)[:, None, None]
        r = (prior * density)[:, None, None]
        squares = self._squares + a * sway.features + r * white.features
        moves = self._moves + (a * sway.moves + r * white.moves)[..., group]
        self.weights = np.linalg.solve(squares, moves)

        # trust k minimises the squared errors of continued + k step
        share = self._scores[self.STEP_TIMES_IDEAL] / (
            self._scores[self.SQUARED_STEP] + self.MIN_STEP * density[:, None]
        )
        self.trust = np.minimum(np.maximum(share, 0.0), 1.0)

        # Errors far below the noise cannot be measured: the propagated noise is the minimum.
        crossed = white.features @ self.weights - 2.0 * white.moves[:, group]
        continued = white.level_variance + (self.weights * crossed).sum(axis=1)
        gain = (1.0 - self.trust) ** 2 * continued + self.trust**2 * tones[:, None]
        self.variances = np.maximum(
            self._scores[self.SQUARED_ERROR], gain * density[:, None]
        )
