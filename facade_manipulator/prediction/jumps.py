"""
Decision whether estimates that leave the prediction are wrong or show a motion.

Generalised likelihood ratio of two hypotheses for an axis. z_i are the errors of the
estimates to the prediction, divided by their standard deviation σ_i:

- Jump: the estimator errs by a constant c since one of the last estimates. Least squares explain
  max over the last n of (Σ z/σ)² / Σ 1/σ² of the squared errors.
- Push: a force accelerates the gondola by a since a time t₀ before the error shows, so that the
  error is a (t₀ + t)²/2 [m or rad]. An error shows at 2 σ. For the strongest push s [m/s² or
  rad/s²] this is after t₀ = sqrt(4 σ/s); weaker pushes have lasted for up to 4 t₀. With q the
  errors by σ for a = s, least squares explain b (2 Σ z q − b (Σ q² + 1)) for a share b = a/s from
  −1 to 1.

The difference is twice the logarithm of the likelihood ratio. The estimates count as wrong while
it is above `ODDS`. Half sines and ramps of the errors are also nearer to a jump than to a push.
The smaller a jump is, the more estimates are needed: five at 4 σ. An error that lasts for
`DECISION_TIME` is a step of the estimator if a jump explains it better than a push of any
strength. Otherwise it is a motion, after which pushes of any strength are possible for a while.

References
----------
A. S. Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems", IEEE Transactions on Automatic Control 21 (1976) 108-112,
https://doi.org/10.1109/TAC.1976.1101146.
"""

from __future__ import annotations

from collections import deque
import math
from typing import NamedTuple

import numpy as np

DOUBT = 2.0  # standard deviations: estimates with a larger error are doubted
JUMP = 9.0  # squared errors explained by a jump, above which the end of the jump is awaited
ODDS = 6.5  # twice the logarithm of the likelihood ratio above which estimates count as wrong
DECISION_TIME = 0.25  # s of doubt, after which the detector decides between motion and step
MOVING_TIME = 2.0  # s after such a motion in which a push may have any strength
PUSH_TIMES = np.array((1.0, 2.0, 4.0))[:, None]  # t₀ of a push, as multiples of its minimum


class JumpDecision(NamedTuple):
    """Decision about an axis: its doubted estimates were wrong, or the estimator stepped."""

    were_wrong: bool
    has_stepped: bool


UNDECIDED = JumpDecision(False, False)


class JumpDetector:
    """
    Detector of wrong estimates of an axis.

    Parameters
    ----------
    acceleration : float
        Strongest push of the gondola [m/s² or rad/s²].

    Attributes
    ----------
    is_doubted, is_wrong : bool
        Whether the estimates are doubted, and whether they count as wrong at present.

    """

    def __init__(self, acceleration: float) -> None:
        self._acceleration = acceleration
        self._since = math.inf  # begin of the doubt [s]
        self._moved = -math.inf  # last decision for a motion [s]
        self._past: deque[tuple[float, float, float]] = deque()  # stamp, error, deviation
        self.is_doubted = self.is_wrong = False

    def evaluate(
        self, stamp: float, error: float, deviation: float, is_followed: bool
    ) -> JumpDecision:
        """
        Test an estimate together with the estimates of the last half second.

        Parameters
        ----------
        stamp : float
            Time of the estimate [s].
        error, deviation : float
            Error to the prediction from before the doubt, and its standard deviation [m or rad].
        is_followed : bool
            Whether the estimate agrees with filters that have followed all estimates.

        """
        self._past.append((stamp, error, deviation))
        while self._past[0][0] < stamp - 2.0 * DECISION_TIME:
            self._past.popleft()
        is_far, was_wrong = abs(error) > DOUBT * deviation, self.is_wrong
        if not (self.is_doubted or is_far):
            return UNDECIDED
        if not self.is_doubted:
            self.is_doubted, self._since = True, stamp
        jump, odds = self._odds()
        is_late = stamp - self._since >= DECISION_TIME
        is_back = jump < JUMP or abs(error) < 0.5 * DOUBT * deviation
        has_returned = not is_far and (was_wrong or not is_late and (is_back or not is_followed))
        has_stepped = was_wrong and is_late and is_far and odds > 0.0
        if is_late and not has_stepped:
            self._moved = stamp
        has_ended = has_returned or has_stepped or (not was_wrong and is_late and is_followed)
        decision = JumpDecision(has_returned and (was_wrong or not is_followed), has_stepped)
        bound = 0.0 if was_wrong else ODDS if is_far else math.inf
        self.is_wrong = not (has_ended or is_late) and odds > bound
        self.is_doubted = not has_ended
        # Past errors keep doubted noise, and drop explained errors.
        if has_ended and (decision.were_wrong or not has_returned):
            self._past = deque((past, 0.0, spread) for past, _, spread in self._past)
        return decision

    def _odds(self) -> tuple[float, float]:
        """
        Return the squared errors explained by a jump, and their excess over other explanations.

        Other explanations are a push, and the end of an earlier jump that was not detected, whose
        errors have the opposite sign.
        """
        stamps, errors, deviations = np.array(self._past).T
        weights, since = deviations ** -2, self._since
        begin = stamps.searchsorted(since)
        t0 = math.sqrt(4.0 * deviations[begin] / self._acceleration)
        q = 2.0 * deviations[begin] * np.maximum(
            1.0 + (stamps - since) / (t0 * PUSH_TIMES), 0.0) ** 2
        along, squares = q @ (weights * errors), q ** 2 @ weights + 1.0
        share = along / squares
        if since + DECISION_TIME > stamps[-1] > self._moved + MOVING_TIME:
            share = np.clip(share, -1.0, 1.0)
        push = share * (2.0 * along - share * squares)
        end = _explained(-np.sign(errors[-1]) * errors[:begin], weights[:begin])
        jump = max(_explained(sign * errors, weights) for sign in (1.0, -1.0))
        return jump, jump - push.max() - end


def _explained(errors: np.ndarray, weights: np.ndarray) -> float:
    """Return the squared errors that the most likely positive jump explains [1]."""
    total = np.maximum((weights * errors)[::-1].cumsum(), 0.0)
    return float((total ** 2 / weights[::-1].cumsum()).max(initial=0.0))
