"""
Whether estimates that leave what was expected of them lie, or tell of a motion.

An estimator that errs jumps: its error is c at once, and stays so. What pushes a gondola bends its
course: when that shows, at two standard deviations σ, it has lasted for t₀ = sqrt(4 σ/s), and the
error is a (t₀ + t)²/2; slower pushes have lasted longer. By least squares jumps explain (Σz)²/n of
the squared errors, z the errors by σ and n since when. Pushes explain b (2 Σz q − b (Σq² + 1)), q
what a = s would make of them and b the best up to 1: a gondola is too heavy for stronger ones, so
that half sines and ramps, which no push explains, are nearer to a jump. The difference is twice
the logarithm of how much likelier that is. The smaller a jump, the more estimates it takes to
show: 5 at 4 σ. What lasts is a step if a jump explains more of it than a push of any strength,
else a motion, after which pushes may be of any strength for a while.

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

SUSPECT = 2.0  # standard deviations, from which on an estimate is doubted
JUMP = 9.0  # squared errors that a jump explains, from which on one may be under way
ODDS = 6.5  # twice the logarithm of a jump's odds, from which on estimates lie
DECIDED = 0.18  # s of a doubt, after which nobody begins to believe in a jump
DISBELIEF = 0.25  # s: what lasts longer is true, a motion or a step of the estimator's
MOVING = 2.0  # s after a motion that was doubted, in which a push may be of any strength
HIDDEN = np.array((1.0, 2.0, 4.0))[:, None]  # by t₀, how long pushes may have lasted


class JumpDecision(NamedTuple):
    """What became of doubts: in which axes estimates have been wrong until now, or stepped."""

    wrong: np.ndarray
    stepped: np.ndarray


class JumpDetector:
    """
    The doubts in several axes.

    Parameters
    ----------
    acceleration : numpy.ndarray, shape (axes,)
        The greatest that a push gives the gondola [m/s² or rad/s²].

    Attributes
    ----------
    lies : numpy.ndarray of bool, shape (axes,)
        Where what was expected is to be followed; elsewhere estimates are, also doubted ones.
    is_any : bool
        Whether there is a doubt in any axis.

    """

    def __init__(self, acceleration: np.ndarray) -> None:
        self._acceleration = acceleration
        self._since = np.full(len(acceleration), math.inf)
        self._moved = -self._since  # when a doubt last was a motion
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self.lies, self.is_any = np.zeros(len(acceleration), bool), False
        self._nothing = JumpDecision(self.lies, self.lies)

    @property
    def is_open(self) -> np.ndarray:
        """In which axes nothing is decided yet."""
        return self._since < math.inf

    def evaluate(
        self, stamp: float, error: np.ndarray, deviation: np.ndarray, is_led: np.ndarray
    ) -> JumpDecision:
        """
        Judge estimates by those of the last half second.

        Parameters
        ----------
        stamp : float
            Of the estimates [s].
        error, deviation : numpy.ndarray, shape (axes,)
            By how much they leave what was expected before the doubt, and the standard deviation
            of that [m or rad].
        is_led : numpy.ndarray of bool, shape (axes,)
            Where they are as expected of filters that all estimates have led.

        """
        self._past.append((stamp, error.copy(), deviation))
        while self._past[0][0] < stamp - 2.0 * DISBELIEF:
            self._past.popleft()
        far = abs(error) > SUSPECT * deviation
        if not (self.is_any or far.any()):
            return self._nothing
        self._since = np.where(far, np.minimum(self._since, stamp), self._since)
        suspected, lied, age = self.is_open, self.lies, stamp - self._since
        jump, odds = np.zeros((2, len(error)))
        for axis in np.flatnonzero(suspected):
            jump[axis], odds[axis] = self._odds(int(axis))
        lasts, likely = age >= DISBELIEF, np.where(far & (age < DECIDED), ODDS, math.inf)
        as_before = (jump < JUMP) | (abs(error) < 0.5 * SUSPECT * deviation)
        returned = suspected & ~far & (lied | ~lasts & (as_before | ~is_led))
        stepped = lied & lasts & far & (odds > 0.0)
        self._moved[suspected & lasts & ~stepped] = stamp
        ended = returned | stepped | (suspected & ~lied & lasts & is_led)
        verdict = JumpDecision(returned & (lied | ~is_led), stepped)
        self.lies = suspected & ~ended & ~lasts & (odds > np.where(lied, 0.0, likely))
        self._since[ended] = math.inf
        self.is_any = bool(self.is_open.any())
        for _, errors, _ in self._past:  # a doubt that came to nothing leaves them as they were
            errors[ended & (verdict.wrong | ~returned)] = 0.0
        return verdict

    def _odds(self, axis: int) -> tuple[float, float]:
        """
        Return what a jump explains of an axis's errors, and how much more than all else does.

        That is a push, and the end of a lie that was not found: errors to the other side before.
        """
        stamps, errors, deviations = (np.array(part) for part in zip(*(
            (stamp, errors[axis], deviations[axis]) for stamp, errors, deviations in self._past),
            strict=True))
        weights = deviations ** -2
        begin = stamps.searchsorted(self._since[axis])
        t0 = math.sqrt(4.0 * deviations[begin] / self._acceleration[axis])
        q = 2.0 * deviations[begin] * np.maximum(
            1.0 + (stamps - self._since[axis]) / (t0 * HIDDEN), 0.0) ** 2
        along, squares = q @ (weights * errors), q ** 2 @ weights + 1.0
        share = along / squares
        if self._since[axis] + DISBELIEF > stamps[-1] > self._moved[axis] + MOVING:
            share = np.clip(share, -1.0, 1.0)
        push = share * (2.0 * along - share * squares)
        back = _explained(-np.sign(errors[-1]) * errors[:begin], weights[:begin])
        jump = max(_explained(side * errors, weights) for side in (1.0, -1.0))
        return jump, jump - push.max() - back


def _explained(errors: np.ndarray, weights: np.ndarray) -> float:
    """Return what a jump upwards explains of squared errors, since when it explains most."""
    total = np.maximum((weights * errors)[::-1].cumsum(), 0.0)
    return float((total ** 2 / weights[::-1].cumsum()).max(initial=0.0))
