"""
Decision whether estimates that deviate from the prediction are wrong or show a motion.

Generalised likelihood ratio of two hypotheses for an axis. z_i are the errors of the
estimates to the prediction, divided by their standard deviation σ_i:

- Jump: the estimator errs by a constant c since one of the last estimates. Least squares explain
  max over the last n of (Σ z/σ)² / Σ 1/σ² of the squared errors.
- Push: a force accelerates the gondola by a since a time t₀ before the error shows, so that the
  error is a (t₀ + t)²/2 [m or rad]. An error shows at 2 σ. For the strongest push A [m/s² or
  rad/s²] this is after t₀ = sqrt(4 σ/A). Pushes of A/4 and A/16 take 2 t₀ and 4 t₀. With q the
  errors of one of these pushes divided by σ, least squares with a standard normal prior of b
  explain b (2 Σ z q − b (Σ q² + 1)) for a share b of this push from −1 to 1.

The difference is twice the logarithm of the likelihood ratio. The estimates count as wrong while
it is above `ODDS`. Half sines and ramps of the errors are also nearer to a jump than to a push.
A smaller jump needs more estimates: at 50 Hz six for a jump of 3 σ, and two for 4 σ. An error that
lasts for `DECISION_TIME` is a step of the estimator if a jump explains it much better than a push
of any strength, with a difference above `STEP_ODDS`. Otherwise it is a motion, after which pushes
of any strength are possible for a while. The limit is higher for a step than for a wrong estimate.
A motion that counts as a step is compensated only after a fade. A step that counts as a motion
moves the head by at most a few standard deviations.

References
----------
A. S. Willsky, H. L. Jones, "A generalized likelihood ratio approach to the detection and
estimation of jumps in linear systems", IEEE Transactions on Automatic Control 21 (1976) 108-112,
https://doi.org/10.1109/TAC.1976.1101146.
"""

from __future__ import annotations

from collections import deque
import enum
import math

import numpy as np

DOUBT = 2.0  # standard deviations: estimates with a larger error are doubted
# s of doubt, after which the detector decides between motion and step
DECISION_TIME = 0.25


class JumpDecision(enum.Enum):
    """Decision about doubted estimates of an axis; all except undecided end the doubt."""

    UNDECIDED = enum.auto()  #: there is no doubt, or it continues
    NOISE = enum.auto()  #: the estimates were right
    WRONG = enum.auto()  #: the estimates were wrong; the newest estimate is right
    STEP = enum.auto()  #: the estimator errs by a constant from now on
    MOTION = enum.auto()  #: the gondola has moved


class JumpDetector:
    """
    Detector of wrong estimates of one axis.

    Parameters
    ----------
    acceleration : float
        Strongest push of the gondola [m/s² or rad/s²].

    Attributes
    ----------
    is_doubted, is_wrong : bool
        Whether the estimates are doubted, and whether they count as wrong at present.

    """

    JUMP = 9.0  # squared errors explained by a jump, above which the end of the jump is awaited
    ODDS = 6.5  # twice the logarithm of the likelihood ratio above which estimates count as wrong
    # the same above which an error that lasts is a step: a wind that begins gives 15
    STEP_ODDS = 20.0
    MOVING_TIME = 2.0  # s after such a motion in which a push may have any strength
    # t₀ of a push, as multiples of its minimum
    PUSH_TIMES = np.array(((1.0,), (2.0,), (4.0,)))

    def __init__(self, acceleration: float) -> None:
        self._acceleration = acceleration
        self._since = math.inf  # begin of the doubt [s]
        self._moved = -math.inf  # last decision for a motion [s]
        # stamp, error, deviation
        self._past: deque[tuple[float, float, float]] = deque()
        self.is_doubted = False
        self.is_wrong = False

    def evaluate(
        self, stamp: float, error: float, deviation: float, is_followed: bool
    ) -> JumpDecision:
        """
        Evaluate an estimate together with the estimates of the last half second.

        Parameters
        ----------
        stamp : float
            Time of the estimate [s].
        error, deviation : float
            Error to the prediction from before the doubt, and its standard deviation [m or rad].
        is_followed : bool
            Whether the estimate agrees with the newest forecast, which uses all estimates except
            those that count as wrong.

        """
        self._past.append((stamp, error, deviation))
        while self._past[0][0] < stamp - 2.0 * DECISION_TIME:
            self._past.popleft()
        is_far = abs(error) > DOUBT * deviation
        if not (self.is_doubted or is_far):
            return JumpDecision.UNDECIDED

        if not self.is_doubted:
            self._since = stamp
        bound = self._bound(is_far)
        jump, odds = self._odds(bound)
        is_late = stamp - self._since >= DECISION_TIME
        is_small = jump < self.JUMP or abs(error) < 0.5 * DOUBT * deviation
        decision = self._decision(is_far, is_late, is_small, is_followed, odds)

        if is_late and decision is not JumpDecision.STEP:
            self._moved = stamp
        self.is_doubted = decision is JumpDecision.UNDECIDED
        self.is_wrong = self.is_doubted and not is_late and odds > bound
        # Errors that turned out to be noise are kept; explained errors are dropped.
        if decision not in (JumpDecision.UNDECIDED, JumpDecision.NOISE):
            self._past = deque((past, 0.0, spread) for past, _, spread in self._past)
        return decision

    def _decision(
        self,
        is_far: bool,
        is_late: bool,
        is_small: bool,
        is_followed: bool,
        odds: float,
    ) -> JumpDecision:
        """Return the first decision that applies, or undecided."""
        if not is_far and (self.is_wrong or not (is_late or is_followed)):
            return JumpDecision.WRONG
        if is_small and not (is_late or is_far):
            return JumpDecision.NOISE
        if is_late and self.is_wrong and odds > self.STEP_ODDS:
            return JumpDecision.STEP
        if is_late and is_followed and not self.is_wrong:
            return JumpDecision.MOTION
        return JumpDecision.UNDECIDED

    def _bound(self, is_far: bool) -> float:
        """Return the odds above which doubted estimates count as wrong."""
        if self.is_wrong:
            return 0.0
        return self.ODDS if is_far else math.inf

    def _odds(self, bound: float) -> tuple[float, float]:
        """
        Return the squared error that a jump explains, and its excess over other explanations.

        Other explanations are a push, and the end of an earlier jump that was not detected, whose
        errors have the opposite sign. These explanations only reduce the excess, so that they are
        not computed if the jump explains at most the bound.
        """
        stamps, errors, deviations = np.array(self._past).T
        weights = deviations**-2
        jump = float(abs(_explained(errors, weights)).max())
        if jump <= bound:
            return jump, jump
        since = self._since
        begin = stamps.searchsorted(since)

        # A push gives an error of 2 σ (1 + t/t₀)² with t₀ = sqrt(4 σ/A). Here q is this error
        # [m or rad], and the weights divide by σ².
        t0 = math.sqrt(4.0 * deviations[begin] / self._acceleration)
        risen = np.maximum(1.0 + (stamps - since) / (t0 * self.PUSH_TIMES), 0.0)
        q = 2.0 * deviations[begin] * risen**2

        # b (2 Σ z q − b (Σ q² + 1)), greatest for b = Σ z q/(Σ q² + 1)
        along = q @ (weights * errors)
        squares = q**2 @ weights + 1.0
        share = along / squares
        if since + DECISION_TIME > stamps[-1] > self._moved + self.MOVING_TIME:
            share = np.minimum(np.maximum(share, -1.0), 1.0)
        push = share * (2.0 * along - share * squares)

        ends = -np.sign(errors[-1]) * _explained(errors[:begin], weights[:begin])
        return jump, jump - float(push.max() + ends.max(initial=0.0))


def _explained(errors: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the signed squared error that a jump beginning at each estimate explains."""
    total = (weights * errors)[::-1].cumsum()
    return total * abs(total) / weights[::-1].cumsum()
