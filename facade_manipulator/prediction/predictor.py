"""
Prediction of the disturbance: a learnt continuation of the motion, corrected by tones.

Each estimate passes through four parts:

1. `jumps` decides whether the estimate is wrong. A wrong estimate is replaced by the prediction.
2. `filters` take the estimate. Over a gap they follow the prediction.
3. `continuation` and `tones` forecast the positions at several horizons from the filters.
4. A cubic spline through these positions gives position and velocity at any time.

The filters are stable. A speed bounds the moves, and the noise bounds the steps towards tones.
Bounded estimates therefore give a bounded prediction for any learnt weights.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from itertools import cycle
import math
from operator import mul

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.prediction.continuation import Continuation, UNKNOWN
from facade_manipulator.prediction.filters import ACCELERATION, BANDWIDTHS, FilterBank, LEVEL
from facade_manipulator.prediction.jumps import DECISION_TIME, DOUBT, JumpDecision, JumpDetector
from facade_manipulator.prediction.prior import HORIZONS, noise_moments
from facade_manipulator.prediction.tones import Tones

STRONGEST_PUSH = np.array((0.5, 0.35, 0.7))  # m/s², m/s², rad/s²: 250 N and 175 N on 500 kg
MOVES = 2.0 * HORIZONS  # m or rad, bound of the moves: a speed of 2 m/s or rad/s
LONGEST_GAP = 1.1  # s without estimates, after which learning starts again
LEARNING_PERIOD = 0.14  # s
FIRST_INTERVAL = 0.02  # s, assumed mean interval until there are two estimates
MAX_ACCELERATION = np.array((1.0, 0.7, 1.4))  # m/s², m/s², rad/s²: more is compensated in part
MEAN_TIME = 5.0  # s, time constant of the mean position that replaces the rest of such a motion
BEND_TIME = 0.5  # s, time constant with which the largest acceleration is forgotten
PEAK_TIME = 20.0  # s, time constant with which the strongest acceleration is forgotten
PEAK_SHARE = 0.1  # variance of the acceleration in the prior divided by the squared peak
NOISE_PEAK = 9.0  # squared acceleration divided by the variance of its noise: less is not a motion
GROWTH = 2.0  # of the squared acceleration, above which earlier learning weighs less
MOST_STEPS = 100  # of the filters over a gap
LARGEST_STEP = 3.0  # standard deviations, towards trusted tones; 1 towards others
HOLD_TIME = 0.2  # s, time constant of the velocity beyond the last horizon
NEAR, FAR = slice(0, 4), slice(4, None)  # groups of horizons: the near ones are learnt more often
ACCELERATION_NOISE = BANDWIDTHS[LEVEL] ** 4 * noise_moments().features[
    ACCELERATION, ACCELERATION]  # variance of the level filter's acceleration, by noise density

_LAST = float(HORIZONS[-1])  # s
_INNER = HORIZONS[2:-2].tolist()  # s, knots of the spline


def _terms(ahead: float) -> list[float]:
    """
    Return the terms of the spline at a time ahead [s]: 1, t, t², t³ and a cubic from each knot.

    Plain numbers are twice as fast as numpy when the caches are cold.
    """
    later = [max(ahead - knot, 0.0) for knot in _INNER]
    return [1.0, ahead, ahead ** 2, ahead ** 3, *[t ** 3 for t in later]]


def _slopes(ahead: float) -> list[float]:
    """Return the derivatives of `_terms` [1/s]."""
    later = [max(ahead - knot, 0.0) for knot in _INNER]
    return [0.0, 1.0, 2.0 * ahead, 3.0 * ahead ** 2, *[3.0 * t ** 2 for t in later]]


def _sum(terms: list[float], coefficients: list[float]) -> float:
    return sum(map(mul, terms, coefficients))


# from positions at the horizons to coefficients of the terms
_SPLINE = np.linalg.inv([_terms(horizon) for horizon in HORIZONS.tolist()]).T
_BEND = np.array((1.0, -2.0, 1.0)) / HORIZONS[0] ** 2  # from the first positions: acceleration


class DisturbancePredictor:
    """
    Predictor of the disturbance from its estimates.

    Attributes
    ----------
    stamp, since : float
        Stamps of the last estimate and of the first learnt estimate [s]; −∞ before any estimate.

    """

    def __init__(self) -> None:
        self.stamp = self.since = -math.inf
        self._interval = FIRST_INTERVAL
        self._weights = self._variances = self._trust = np.empty(0)  # of all groups of horizons

    def update(self, stamp: float, values: Pose, variances: Sequence[float]) -> bool:
        """
        Learn from an estimate; return whether the estimator has stepped.

        Parameters
        ----------
        stamp : float
            Time of the disturbance [s]. Learning starts again if it is earlier than the previous
            stamp, or later by more than `LONGEST_GAP`.
        values : Pose
            Estimated disturbance [m, m, rad].
        variances : sequence of float
            Variances of the noise, above 0 [m², m², rad²].

        """
        measured, noise, has_stepped = np.array(values), np.array(variances), False
        interval = stamp - self.stamp
        if 0.0 < interval <= LONGEST_GAP:
            self._interval += min(interval / (stamp - self.since), 1.0) * (
                interval - self._interval)
            has_stepped = self._follow(stamp, interval, measured, noise)
        else:
            interval = self._interval = FIRST_INTERVAL
            self._start(stamp, measured, noise)
        self.stamp = stamp
        self._forecast(interval, noise)
        return has_stepped

    def predict(self, time: float) -> MotionState:
        """Return the motion of the rail at a past or future time [s]."""
        ahead = time - self.stamp
        within = min(max(ahead, 0.0), _LAST)
        terms, slopes = _terms(within), _slopes(within)
        decay = math.exp(min(_LAST - ahead, 0.0) / HOLD_TIME)
        held = HOLD_TIME * (1.0 - decay)
        velocities = [_sum(slopes, axis) for axis in self._coefficients]
        return MotionState(
            Pose(*[_sum(terms, axis) + held * velocity for axis, velocity in zip(
                self._coefficients, velocities, strict=True)]),
            Twist(*[decay * velocity for velocity in velocities]))

    def deviations(self, time: float) -> tuple[float, ...]:
        """Return the standard deviations of the prediction errors at a time [s], [m, m, rad]."""
        ahead = time - self.stamp
        return tuple([
            math.sqrt(np.interp(ahead, HORIZONS, variances)) for variances in self._variances])

    def _start(self, stamp: float, measured: np.ndarray, noise: np.ndarray) -> None:
        """Start at rest at the measured position, the origin of all stored positions [m, rad]."""
        axes = len(measured)
        self.since, self._next_learning = stamp, stamp + LEARNING_PERIOD
        self._origin = measured
        self._trusted_stamp, self._spread = np.full(axes, stamp), np.zeros(axes)
        # The filters are linear: the effect of doubted estimates is stored separately.
        self._bank, self._doubted = FilterBank(axes), FilterBank(axes)
        self._jumps = JumpDetector(STRONGEST_PUSH)
        near, far = self._continuations = [Continuation(axes, group) for group in (NEAR, FAR)]
        self._turns = zip(cycle((near, near, near, far)), cycle(range(axes)), strict=False)
        self._tones = Tones(axes)
        # Values and errors that are not in the filters.
        self._left_out: list[tuple[np.ndarray, np.ndarray]] = []
        self._undecided: deque[tuple[float, np.ndarray]] = deque()  # values not in the tones yet
        self._values, self._mean, self._peak, self._bend = np.zeros((4, axes))
        self._trusted = self._led = np.zeros((axes, len(HORIZONS)))
        self._known = noise * (self._interval * ACCELERATION_NOISE)
        self._solve(self._continuations, noise)

    def _follow(
        self, stamp: float, interval: float, measured: np.ndarray, noise: np.ndarray
    ) -> bool:
        """
        Update the filters with an estimate; return whether the estimator has stepped.

        Over a gap the filters follow the prediction plus a constant acceleration to the estimate.
        """
        expected, was_wrong = self._expected(stamp), self._jumps.is_wrong
        error = measured - self._origin - expected
        were_wrong, has_stepped = self._decide(
            stamp, interval, measured - self._origin, error, noise)
        self._origin = self._origin + np.where(has_stepped, error, 0.0)
        error[has_stepped] = 0.0
        is_doubted, removed = self._jumps.is_doubted, were_wrong | has_stepped
        self._bank.modes[removed] -= self._doubted.modes[removed]
        self._doubted.modes[~is_doubted] = 0.0
        steps = min(max(round(interval / self._interval), 1), MOST_STEPS)
        for share in [step / steps for step in range(1, steps + 1)]:
            between = expected if share == 1.0 else self._expected(
                stamp - (1.0 - share) * interval)
            self._bank.update(interval / steps, between + share ** 2 * error)
            if self._jumps.is_any:
                self._doubted.update(interval / steps, share ** 2 * error * is_doubted)
        self._trusted_stamp[~is_doubted] = stamp
        self._record(expected, error, was_wrong & ~removed & ~self._jumps.is_wrong)
        self._undecided.append((stamp, self._values))  # the values may still change
        while self._undecided[0][0] < stamp - DECISION_TIME:
            self._tones.add(*self._undecided.popleft())
        return bool(has_stepped.any())

    def _record(self, expected: np.ndarray, error: np.ndarray, were_right: np.ndarray) -> None:
        """
        Record the position to learn: the estimate, or the prediction if the estimate is wrong.

        Earlier estimates that were right return to their samples.
        """
        is_wrong = self._jumps.is_wrong
        for values, left_out in self._left_out:
            values += left_out * were_right
            left_out *= is_wrong
        left_out = np.where(is_wrong, error, 0.0)
        self._values = expected + error - left_out
        self._left_out = [*self._left_out, (self._values, left_out)] if self._jumps.is_any else []

    def _decide(
        self, stamp: float, interval: float, values: np.ndarray, error: np.ndarray,
        noise: np.ndarray,
    ) -> JumpDecision:
        """
        Test an estimate against the prediction from before the doubt, and from the filters.

        The variance is at least that of the previous moment. The prediction of an axis that was
        unknown is still poor, so that a large error is not a jump.
        """
        self._spread = np.maximum(noise, math.exp(-self._interval / DECISION_TIME) * self._spread)
        if not self._jumps.is_any and interval <= HORIZONS[0]:  # this saves 7 % of most updates
            deviation = np.sqrt(self._variances[:, 0] + self._spread)
            return self._jumps.evaluate(stamp, error, deviation, abs(error) < DOUBT * deviation)
        later = np.stack((stamp - self._trusted_stamp, np.full(len(values), interval)), axis=1)
        known = np.array([np.interp(times, HORIZONS, variances, right=UNKNOWN)
                          for times, variances in zip(later, self._variances, strict=True)])
        deviation, at_once = np.sqrt(known.T + self._spread)
        led = abs(values - self._led @ _terms(min(interval, _LAST)))
        return self._jumps.evaluate(stamp, error, deviation, led < DOUBT * at_once)

    def _expected(self, time: float) -> np.ndarray:
        """
        Return the positions [m, rad] predicted for a time [s] from the last undoubted estimates.

        A prediction from predicted values would grow with every step.
        """
        return np.array([
            _sum(_terms(min(time - stamp, _LAST)), axis) for stamp, axis in zip(
                self._trusted_stamp.tolist(), self._trusted.tolist(), strict=True)])

    def _forecast(self, interval: float, noise: np.ndarray) -> None:
        """Forecast positions with the filters, and store the sample for learning."""
        seen, level = self._bank.features(
            self._jumps.is_wrong[:, None, None] * self._doubted.modes)
        floor = noise * (self._interval * ACCELERATION_NOISE)
        self._peak = np.maximum(
            math.exp(-interval / PEAK_TIME) * self._peak,
            BANDWIDTHS[LEVEL] ** 4 * seen[:, ACCELERATION] ** 2 - NOISE_PEAK * floor)
        if self.stamp > self._next_learning - 1e-6:  # s, rounding
            self._next_learning = self.stamp + LEARNING_PERIOD
            self._learn(noise, floor)
        # np.clip takes twice as long as minimum and maximum.
        moves = np.minimum(np.maximum((seen[:, None] @ self._weights)[:, 0], -MOVES), MOVES)
        continued = level[:, None] + moves
        bound = np.sqrt(noise)[:, None] * (1.0 + (LARGEST_STEP - 1.0) * self._trust)
        step = np.minimum(np.maximum(
            self._tones.at(self.stamp, HORIZONS) - continued, -bound), bound)
        forecast = continued + self._trust * step
        self._led = forecast @ _SPLINE
        self._trusted = np.where(self._jumps.is_doubted[:, None], self._trusted, self._led)
        self._mean = self._mean + (1.0 - math.exp(-interval / MEAN_TIME)) * (
            self._values - self._mean)
        mean = self._mean[:, None]
        # The prediction follows only the share of the motion within the maximum acceleration.
        self._bend = np.maximum(
            math.exp(-interval / BEND_TIME) * self._bend, abs(forecast[:, :3] @ _BEND))
        share = MAX_ACCELERATION / np.maximum(self._bend, MAX_ACCELERATION)
        final = mean + share[:, None] * (forecast - mean)
        coefficients = final @ _SPLINE
        coefficients[:, 0] += self._origin
        self._coefficients = coefficients.tolist()
        forecasts = np.stack((final, continued, step))
        for continuation in self._continuations:
            continuation.add(self.stamp, interval, self._values, level, seen, forecasts)

    def _learn(self, noise: np.ndarray, floor: np.ndarray) -> None:
        """Learn one group of horizons and the tones of one axis, in turn."""
        strongest = floor + self._peak
        share = np.minimum(GROWTH * self._known / strongest, 1.0)
        for continuation in self._continuations:
            continuation.weaken(share)
        self._known = np.minimum(np.maximum(self._known, strongest / GROWTH), strongest)
        continuation, axis = next(self._turns)
        self._tones.fit(axis, noise[axis])
        continuation.learn(noise)
        self._solve([continuation], noise)

    def _solve(self, continuations: Iterable[Continuation], noise: np.ndarray) -> None:
        """Solve groups of horizons and join the results of all groups."""
        for one in continuations:
            one.solve(PEAK_SHARE * self._peak, noise * self._interval, self._tones.noise_gain)
        self._weights, self._variances, self._trust = (
            np.concatenate([getattr(one, part) for one in self._continuations], axis=-1)
            for part in ('weights', 'variances', 'trust'))
