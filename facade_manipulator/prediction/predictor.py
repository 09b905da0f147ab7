"""
Prediction of the disturbance: a learnt continuation of the motion, corrected by tones.

Each estimate passes through four parts:

1. `jumps` decides whether the estimate is wrong. A wrong estimate is replaced by the prediction.
2. `filters` take the estimate. Over a gap they follow the prediction.
3. `continuation` and `tones` forecast the positions at several horizons from the filters.
4. A cubic spline through these positions gives position and velocity at any time.

The filters are stable. A speed bounds the moves, and the noise bounds the steps towards tones.
Any learnt weights therefore give a bounded forecast. No forecast is made from another forecast,
except over a gap (up to `LONGEST_GAP`) and while estimates count as wrong (up to `DECISION_TIME`):
the filters then follow the last trusted forecast. No proof covers that case. Tests bound the
prediction there for random estimates. `EstimateGate` rejects jumps that would exceed the bound.
"""

from __future__ import annotations

from bisect import bisect
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import cycle
import math

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.prediction.continuation import Continuation, UNKNOWN
from facade_manipulator.prediction.filters import (
    ACCELERATION,
    BANDWIDTHS,
    FilterBank,
    LEVEL,
)
from facade_manipulator.prediction.jumps import (
    DECISION_TIME,
    DOUBT,
    JumpDecision,
    JumpDetector,
)
from facade_manipulator.prediction.prior import HORIZONS, noise_moments
from facade_manipulator.prediction.tones import Tones

STRONGEST_PUSH = (0.5, 0.35, 0.7)  # m/s², m/s², rad/s²: 250 N and 175 N on 500 kg
MOVES = 2.0 * HORIZONS  # m or rad, bound of the moves: a speed of 2 m/s or rad/s
LONGEST_GAP = 1.1  # s without estimates, after which learning starts again
LEARNING_PERIOD = 0.14  # s
FIRST_INTERVAL = 0.02  # s, assumed mean interval until there are two estimates
# m² or rad², variance of the first predictions: the gondola may already move at 0.04 m/s or rad/s
START_SPREAD = (0.04 * DECISION_TIME) ** 2
MAX_ACCELERATION = np.array(
    (1.0, 0.7, 1.4)
)  # m/s², m/s², rad/s²: more is compensated in part
MEAN_TIME = (
    5.0  # s, time constant of the mean position, towards which it is then reduced
)
BEND_TIME = (
    0.5  # s, time constant with which the largest forecast acceleration is forgotten
)
PEAK_TIME = (
    20.0  # s, time constant with which the largest estimated acceleration is forgotten
)
PEAK_SHARE = (
    0.1  # variance of the acceleration in the prior divided by the squared peak
)
NOISE_PEAK = 9.0  # squared acceleration divided by the variance of its noise: less is not a motion
GROWTH = 2.0  # of the squared acceleration, above which earlier learning weighs less
LARGEST_STEP = 3.0  # standard deviations, towards trusted tones; 1 towards others
INNOVATION_TIME = 2.0  # s, averaging time of the squared innovations
HOLD_TIME = 0.2  # s, time constant of the velocity beyond the last horizon
NEAR, FAR = (
    slice(0, 4),
    slice(4, None),
)  # groups of horizons: the near ones are learnt more often
ACCELERATION_NOISE = (
    BANDWIDTHS[LEVEL] ** 4 * noise_moments().features[ACCELERATION, ACCELERATION]
)  # variance of the level filter's acceleration / noise density

_LAST = float(HORIZONS[-1])  # s
_KNOTS = HORIZONS[2:-2].tolist()  # s, of the spline
# The spline is "not-a-knot": a cubic, and a multiple of (t − knot)³ after each knot. Here are the
# coefficients of 1, t, t², t³ in each of these terms.
_TERMS = np.vstack(
    (np.eye(4), [(-(knot**3), 3.0 * knot**2, -3.0 * knot, 1.0) for knot in _KNOTS])
)
_STARTS = np.array((*4 * [-math.inf], *_KNOTS))  # s, from which the terms apply
_VALUES = HORIZONS[:, None] ** np.arange(4.0) @ _TERMS.T * (HORIZONS[:, None] > _STARTS)
# from positions at the horizons to coefficients of 1, t, t², t³ between the knots
_SPLINE = np.hstack(
    [
        np.linalg.inv(_VALUES).T @ (_TERMS * (_STARTS <= start)[:, None])
        for start in (-math.inf, *_KNOTS)
    ]
)
_PIECES = (-1, len(_KNOTS) + 1, 4)  # shape: axes, pieces, coefficients
Pieces = list[list[float]]  # coefficients of the spline of an axis
_BEND = (
    np.array((1.0, -2.0, 1.0)) / HORIZONS[0] ** 2
)  # from the first positions: acceleration


class DisturbancePredictor:
    """
    Predictor of the disturbance from its estimates.

    Attributes
    ----------
    stamp, since : float
        Stamps of the last estimate and of the first learnt estimate [s]; −∞ before any estimate.
    innovations : numpy.ndarray, shape (3,)
        Mean squared errors of the forecasts of the next estimate [m², m², rad²], without wrong
        estimates: the noise of the estimates and the error of the prediction.

    """

    def __init__(self) -> None:
        self.stamp = self.since = -math.inf
        self._interval = FIRST_INTERVAL

    def update(self, stamp: float, values: Pose, variances: Sequence[float]) -> bool:
        """
        Learn from an estimate; return whether the estimator has stepped.

        Parameters
        ----------
        stamp : float
            Time of the disturbance [s]. Learning starts again if it is not later than the
            previous stamp, or later by more than `LONGEST_GAP`.
        values : Pose
            Estimated disturbance [m, m, rad].
        variances : sequence of float
            Variances of the noise, above 0 [m², m², rad²].

        """
        measured, noise, has_stepped = np.array(values), np.array(variances), False
        interval = stamp - self.stamp
        if 0.0 < interval <= LONGEST_GAP:
            self._interval += min(interval / (stamp - self.since), 1.0) * (
                interval - self._interval
            )
            has_stepped = self._follow(stamp, interval, measured, noise)
        else:
            interval = self._interval = FIRST_INTERVAL
            self._start(stamp, measured, noise)
        self.stamp = stamp
        self._forecast(interval, noise)
        return has_stepped

    def predict(self, time: float) -> MotionState:
        """
        Return the predicted motion of the rail at a time [s].

        Before the stamp of the newest estimate, the motion is that at the stamp. Beyond the last
        horizon, the velocity decays.
        """
        ahead = time - self.stamp
        t = min(max(ahead, 0.0), _LAST)
        decay = math.exp(min(_LAST - ahead, 0.0) / HOLD_TIME)
        held = HOLD_TIME * (1.0 - decay)
        motions = [_motion(pieces, t) for pieces in self._splines]
        return MotionState(
            Pose(*[position + held * velocity for position, velocity in motions]),
            Twist(*[decay * velocity for _, velocity in motions]),
        )

    def deviations(self, time: float) -> tuple[float, ...]:
        """Return the standard deviations of the prediction errors at a time [s], [m, m, rad]."""
        ahead = time - self.stamp
        return tuple(
            [
                math.sqrt(np.interp(ahead, HORIZONS, variances))
                for variances in self._variances
            ]
        )

    def _start(self, stamp: float, measured: np.ndarray, noise: np.ndarray) -> None:
        """Start at rest at the measured position, the origin of all stored positions [m, rad]."""
        axes = len(measured)
        self.since, self._next_learning = stamp, stamp + LEARNING_PERIOD
        self._origin = measured
        # m² or rad², variance of the estimates in the tests of jumps
        self._spread = np.full(axes, START_SPREAD)
        # The filters are linear: the effect of doubted estimates is stored separately.
        self._bank, self._doubted = FilterBank(axes), FilterBank(axes)
        self._jumps = [JumpDetector(push) for push in STRONGEST_PUSH]
        self._is_wrong = np.zeros(axes, bool)
        near, far = self._continuations = [
            Continuation(axes, group) for group in (NEAR, FAR)
        ]
        self._turns = zip(
            cycle((near, near, near, far)), cycle(range(axes)), strict=False
        )
        self._tones = Tones(axes)
        # Values and errors that are not in the filters.
        self._left_out: list[tuple[np.ndarray, np.ndarray]] = []
        self._undecided: deque[tuple[float, np.ndarray]] = (
            deque()
        )  # values not in the tones yet
        self._values, self._mean, self._peak, self._bend = np.zeros((4, axes))
        # Splines of the newest forecast; stamps and splines of the last trusted forecasts.
        self._newest: list[Pieces] = []
        self._trusted: list[tuple[float, Pieces]] = []
        self._known = noise * (self._interval * ACCELERATION_NOISE)
        self.innovations = noise.copy()
        self._solve(self._continuations, noise)

    def _follow(
        self, stamp: float, interval: float, measured: np.ndarray, noise: np.ndarray
    ) -> bool:
        """
        Update the filters with an estimate; return whether the estimator has stepped.

        Over a gap the filters follow the prediction plus a constant acceleration to the estimate.
        """
        expected = self._expected(stamp)
        error = measured - self._origin - expected
        has_stepped = self._decide(
            stamp, interval, measured - self._origin, error, noise
        )
        is_doubted = [jump.is_doubted for jump in self._jumps]
        self._is_wrong = np.array([jump.is_wrong for jump in self._jumps])
        steps = max(round(interval / self._interval), 1)
        if steps == 1:  # not over a gap
            weights = interval / INNOVATION_TIME * ~self._is_wrong
            self.innovations += weights * (error**2 - self.innovations)
        for share in [step / steps for step in range(1, steps + 1)]:
            between = (
                expected
                if share == 1.0
                else self._expected(stamp - (1.0 - share) * interval)
            )
            self._bank.update(interval / steps, between + share**2 * error)
            if any(is_doubted):
                self._doubted.update(interval / steps, share**2 * error * is_doubted)
        # The position to learn is the estimate, or the prediction if the estimate is wrong.
        left_out = error * self._is_wrong
        self._values = expected + error - left_out
        self._left_out = (
            [*self._left_out, (self._values, left_out)] if any(is_doubted) else []
        )
        self._undecided.append((stamp, self._values))  # the values may still change
        while self._undecided[0][0] < stamp - DECISION_TIME:
            self._tones.add(*self._undecided.popleft())
        return has_stepped

    def _decide(
        self,
        stamp: float,
        interval: float,
        values: np.ndarray,
        error: np.ndarray,
        noise: np.ndarray,
    ) -> bool:
        """
        Test an estimate against the last trusted forecast, and against the newest forecast.

        Return whether the estimator has stepped. Where it has, change the origin by the error, and
        set the error to 0. A large variance of earlier estimates fades: the prediction of an axis
        that was unknown is still poor, so that a large error is not a jump. After a start the
        variance of a gondola that already moves fades in the same way.
        """
        self._spread = np.maximum(
            noise, math.exp(-self._interval / DECISION_TIME) * self._spread
        )
        has_stepped = False
        for axis, (jump, value, excess, spread) in enumerate(
            zip(
                self._jumps,
                values.tolist(),
                error.tolist(),
                self._spread.tolist(),
                strict=True,
            )
        ):
            deviation = math.sqrt(
                self._variance(axis, stamp - self._trusted[axis][0]) + spread
            )
            is_followed = False
            if (
                jump.is_doubted
            ):  # otherwise the newest forecast is also the last trusted one
                newest_deviation = math.sqrt(self._variance(axis, interval) + spread)
                newest, _ = _motion(self._newest[axis], min(interval, _LAST))
                is_followed = abs(value - newest) < DOUBT * newest_deviation
            decision = jump.evaluate(stamp, excess, deviation, is_followed)
            were_wrong = decision in (JumpDecision.WRONG, JumpDecision.STEP)
            if were_wrong:
                self._bank.modes[axis] -= self._doubted.modes[axis]
            if decision is JumpDecision.STEP:
                has_stepped = True
                self._origin[axis] += excess
                error[axis] = 0.0
            if not jump.is_doubted:
                self._doubted.modes[axis] = 0.0
            if not jump.is_wrong:
                for past, left_out in self._left_out:
                    # Earlier estimates that were right return to their samples.
                    past[axis] += 0.0 if were_wrong else left_out[axis]
                    left_out[axis] = 0.0
        return has_stepped

    def _variance(self, axis: int, ahead: float) -> float:
        """Return the variance of the prediction of an axis after a time [s]."""
        if ahead <= HORIZONS[0]:  # as usual: interpolation takes ten times as long
            return self._variances[axis][0]
        return float(np.interp(ahead, HORIZONS, self._variances[axis], right=UNKNOWN))

    def _expected(self, time: float) -> np.ndarray:
        """
        Return the positions [m, rad] predicted for a time [s] from the last undoubted estimates.

        The error of predictions from predicted values would grow with every step.
        """
        return np.array(
            [
                _motion(pieces, min(time - stamp, _LAST))[0]
                for stamp, pieces in self._trusted
            ]
        )

    def _forecast(self, interval: float, noise: np.ndarray) -> None:
        """Learn if it is due, forecast the positions, and store the sample for later learning."""
        seen, level = self._bank.features(
            self._is_wrong[:, None, None] * self._doubted.modes
        )
        floor = noise * (self._interval * ACCELERATION_NOISE)
        self._peak = np.maximum(
            math.exp(-interval / PEAK_TIME) * self._peak,
            BANDWIDTHS[LEVEL] ** 4 * seen[:, ACCELERATION] ** 2 - NOISE_PEAK * floor,
        )
        if self.stamp > self._next_learning - 1e-6:  # s, rounding
            self._learn(noise, floor + self._peak)
        # Step from the continuation towards the tones; both steps are bounded. (np.clip would take
        # twice as long as minimum and maximum.)
        moves = np.minimum(
            np.maximum((seen[:, None] @ self._weights)[:, 0], -MOVES), MOVES
        )
        continued = level[:, None] + moves
        bound = np.sqrt(noise)[:, None] * (1.0 + (LARGEST_STEP - 1.0) * self._trust)
        step = np.minimum(
            np.maximum(self._tones.at(self.stamp, HORIZONS) - continued, -bound), bound
        )
        forecast = continued + self._trust * step
        self._newest = (forecast @ _SPLINE).reshape(_PIECES).tolist()
        self._trusted = [
            self._trusted[axis] if jump.is_doubted else (self.stamp, self._newest[axis])
            for axis, jump in enumerate(self._jumps)
        ]
        self._mean += (1.0 - math.exp(-interval / MEAN_TIME)) * (
            self._values - self._mean
        )
        mean = self._mean[:, None]
        # The prediction follows only the share of the motion within the maximum acceleration.
        self._bend = np.maximum(
            math.exp(-interval / BEND_TIME) * self._bend, abs(forecast[:, :3] @ _BEND)
        )
        share = MAX_ACCELERATION / np.maximum(self._bend, MAX_ACCELERATION)
        final = mean + share[:, None] * (forecast - mean)
        splines = (final @ _SPLINE).reshape(_PIECES)
        splines[..., 0] += self._origin[:, None]
        self._splines: list[Pieces] = splines.tolist()
        forecasts = np.array((final, continued, step))
        for continuation in self._continuations:
            continuation.add(self.stamp, interval, self._values, level, seen, forecasts)

    def _learn(self, noise: np.ndarray, strongest: np.ndarray) -> None:
        """
        Learn one group of horizons and the tones of one axis.

        Earlier learning weighs less if the strongest squared acceleration [m²/s⁴ or rad²/s⁴] has
        grown.
        """
        self._next_learning = self.stamp + LEARNING_PERIOD
        for one in self._continuations:
            one.learnt *= np.minimum(GROWTH * self._known / strongest, 1.0)
        self._known = np.minimum(np.maximum(self._known, strongest / GROWTH), strongest)
        continuation, axis = next(self._turns)
        self._tones.fit(axis, noise[axis])
        continuation.learn(noise)
        self._solve([continuation], noise)

    def _solve(self, continuations: Iterable[Continuation], noise: np.ndarray) -> None:
        """Solve groups of horizons and join the results of all groups."""
        for one in continuations:
            one.solve(
                PEAK_SHARE * self._peak, noise * self._interval, self._tones.noise_gain
            )
        self._weights, variances, self._trust = (
            np.concatenate([getattr(one, part) for one in self._continuations], axis=-1)
            for part in ('weights', 'variances', 'trust')
        )
        self._variances: list[list[float]] = variances.tolist()


def _motion(pieces: Pieces, t: float) -> tuple[float, float]:
    """
    Return position and velocity on a spline at a time after the estimate [s].

    Plain numbers are twice as fast as numpy when the caches are cold.
    """
    a, b, c, d = pieces[bisect(_KNOTS, t)]
    return a + t * (b + t * (c + t * d)), b + t * (2.0 * c + t * 3.0 * d)
