"""
Predict the disturbance: a continuation of the motion that is learnt, and tones beside it.

Everything that grows is bounded by what came: filters are stable, whatever they learnt; moves are
bounded by speed, steps towards tones by the noise; what bends too sharply is drawn towards the
mean, and so is what was not predicted better than by it. So bounded estimates give a bounded
prediction. The variances of the predictions' errors are measured, too; they decide which estimates
are outliers.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from itertools import cycle
import math
from operator import mul

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.prediction.continuation import Continuation, Sample, UNKNOWN
from facade_manipulator.prediction.estimate import Variances
from facade_manipulator.prediction.filters import ACCELERATION, BANDWIDTHS, FilterBank, LEVEL
from facade_manipulator.prediction.jumps import DISBELIEF, JumpDecision, JumpDetector, SUSPECT
from facade_manipulator.prediction.prior import HORIZONS, noise_moments
from facade_manipulator.prediction.tones import Tones

MEMORY = 60.0  # s, time constant with which what was learnt is forgotten
# beyond them a motion is compensated in part, or not predicted
ACCELERATION_LIMITS = np.array((1.0, 0.7, 1.4))  # m/s², m/s², rad/s²: x, y, theta
SPEED_LIMIT = 2.0  # m/s, rad/s
LONGEST_GAP = 1.1  # s without estimates, after which everything is learnt again
LEARNING_PERIOD = 0.14  # s
SAME_TIME = 1e-6  # s, what is closer together counts as one
FIRST_INTERVAL = 0.02  # s, taken for the mean one until there are two estimates
PEAK_TIME = 20.0  # s, time constant with which the strongest motion seen is forgotten
PEAK_SHARE = 0.1  # variance of the acceleration expected, by its peak's square
GROWTH = 2.0  # of the acceleration's square, beyond which what was learnt counts for less
NOISE_PEAK = 9.0  # squares of an acceleration by its noise's variance that are no motion
LEAST_ROOM = 0.3  # of the acceleration that fits, below which even less is compensated
MEAN_TIME = 5.0  # s, of the mean that remains where nothing is predicted
BEND_TIME = 0.5  # s, time constant with which the sharpest bend is forgotten
MOST_STEPS = 100  # over a gap
PUSH_SHARE = 0.5  # of the acceleration that is compensated, that a push has at most
LARGEST_STEP = 3.0  # standard deviations, towards tones that are trusted; 1 where they are not
HOLD_TIME = 0.2  # s in which the velocity dies out beyond the last horizon
NEAR, FAR = slice(0, 4), slice(4, None)  # horizons, learnt apart: the near ones soon and often
ACCELERATION_NOISE = BANDWIDTHS[LEVEL] ** 4 * noise_moments().features[
    ACCELERATION, ACCELERATION]  # variance of the level filter's acceleration, by noise density

FARTHEST = float(HORIZONS[-1])  # s
_INNER = HORIZONS[2:-2].tolist()  # s, where cubics of the spline begin


def _terms(ahead: float) -> list[float]:
    """
    Return what a spline's coefficients are multiplied by at a time [s].

    A cubic spline through the moves is 1, t, t², t³ and a cubic from each inner horizon but the
    outer. Plain numbers: in caches that turned cold numpy takes nearly twice as long.
    """
    later = [max(ahead - begin, 0.0) for begin in _INNER]
    return [1.0, ahead, ahead ** 2, ahead ** 3, *[t ** 3 for t in later]]


def _slopes(ahead: float) -> list[float]:
    """Return the derivatives of `_terms` [1/s]."""
    later = [max(ahead - begin, 0.0) for begin in _INNER]
    return [0.0, 1.0, 2.0 * ahead, 3.0 * ahead ** 2, *[3.0 * t ** 2 for t in later]]


def _sum(terms: list[float], coefficients: list[float]) -> float:
    return sum(map(mul, terms, coefficients))


# from a spline's values to its coefficients
_SPLINE = np.linalg.inv([_terms(horizon) for horizon in HORIZONS.tolist()]).T
_BEND = np.array((1.0, -2.0, 1.0)) / HORIZONS[0] ** 2  # acceleration, by the first positions


class DisturbancePredictor:
    """
    Predict the disturbance from its estimates.

    Parameters
    ----------
    memory : float
        Time constant with which what was learnt is forgotten [s].
    acceleration : numpy.ndarray, shape (3,)
        Acceleration beyond which a motion is compensated in part [m/s², m/s², rad/s²].
    speed : float
        Speed beyond which no motion is predicted [m/s, m/s, rad/s].

    Attributes
    ----------
    stamp, since : float
        Of the last estimate and of the first that was learnt from [s]; −∞ before any.

    """

    def __init__(
        self, memory: float = MEMORY, acceleration: np.ndarray = ACCELERATION_LIMITS,
        speed: float = SPEED_LIMIT,
    ) -> None:
        self.stamp = self.since = -math.inf
        self._memory, self._acceleration = memory, acceleration
        self._reach = speed * HORIZONS

    def update(self, stamp: float, values: Pose, variances: Variances) -> bool:
        """
        Learn from an estimate; return whether what the estimator measures from has stepped.

        Parameters
        ----------
        stamp : float
            When the disturbance was there [s]; if it is earlier than that of the estimate
            before, or much later, everything is learnt again.
        values : Pose
            Estimated disturbance.
        variances : Variances
            Variances of the estimate's noise, above 0.

        """
        measured, noise, stepped = np.array(values), np.array(variances), False
        if not 0.0 < stamp - self.stamp <= LONGEST_GAP:
            interval = self._interval = FIRST_INTERVAL
            self._start(stamp, measured, noise)
        else:
            interval = stamp - self.stamp
            self._interval += min(interval / (stamp - self.since), 1.0) * (
                interval - self._interval)
            stepped = self._follow(stamp, interval, measured, noise)
        self.stamp = stamp
        self._go_on(interval, noise)
        return stepped

    def predict(self, time: float) -> MotionState:
        """Return the disturbance to compensate at a time, of the past or the future [s]."""
        ahead = time - self.stamp
        within = min(max(ahead, 0.0), FARTHEST)
        terms, slopes = _terms(within), _slopes(within)
        decay = math.exp(min(FARTHEST - ahead, 0.0) / HOLD_TIME)
        held = HOLD_TIME * (1.0 - decay)
        velocities = [_sum(slopes, axis) for axis in self._final]
        return MotionState(
            Pose(*[_sum(terms, axis) + held * velocity for axis, velocity in zip(
                self._final, velocities, strict=True)]),
            Twist(*[decay * velocity for velocity in velocities]))

    def deviations(self, time: float) -> tuple[float, ...]:
        """Return the standard deviations of the errors at a time [s]: x, y, theta [m, m, rad]."""
        ahead = time - self.stamp
        return tuple([
            math.sqrt(np.interp(ahead, HORIZONS, variances)) for variances in self._variances])

    def _start(self, stamp: float, measured: np.ndarray, noise: np.ndarray) -> None:
        """Begin at rest where the gondola is, which is the origin of everything that is kept."""
        axes = len(measured)
        self.since, self._next_learning = stamp, stamp + LEARNING_PERIOD
        self._origin = measured
        self._believed, self._spread = np.full(axes, stamp), np.zeros(axes)
        self._bank, self._suspected = FilterBank(axes), FilterBank(axes)  # all, suspected
        self._jumps = JumpDetector(PUSH_SHARE * self._acceleration)
        self._left_out: list[tuple[np.ndarray, np.ndarray]] = []  # of values, during a doubt
        near, far = self._continuations = [
            Continuation(axes, group, self._memory) for group in (NEAR, FAR)]
        self._turns = zip(cycle((near, near, near, far)), cycle(range(axes)), strict=False)
        self._tones = Tones(axes)
        self._undecided: deque[tuple[float, np.ndarray]] = deque()  # not in the tones yet
        self._values, self._mean, self._peak, self._bend = np.zeros((4, axes))
        self._forecast = self._led = np.zeros((axes, len(_SPLINE.T)))
        self._known = noise * (self._interval * ACCELERATION_NOISE)
        self._solve(self._continuations, noise)

    def _follow(
        self, stamp: float, interval: float, measured: np.ndarray, noise: np.ndarray
    ) -> bool:
        """
        Lead the filters to an estimate; a gap along the prediction, corrected to end there.

        What doubted estimates do to the filters, which are linear, is kept apart, so that it can
        be taken out of them. Return whether what the estimator measures from has stepped.
        """
        expected, lied = self._expected(stamp), self._jumps.lies
        error = measured - self._origin - expected
        wrong, stepped = self._evaluate(stamp, interval, measured - self._origin, error, noise)
        self._origin = self._origin + np.where(stepped, error, 0.0)
        error[stepped] = 0.0
        suspected, is_any = self._jumps.is_open, self._jumps.is_any
        if (wrong | stepped).any():
            self._bank.modes[wrong | stepped] -= self._suspected.modes[wrong | stepped]
        self._suspected.modes[~suspected] = 0.0
        steps = min(max(round(interval / self._interval), 1), MOST_STEPS)
        for share in [step / steps for step in range(1, steps + 1)]:
            between = expected if share == 1.0 else self._expected(
                stamp - (1.0 - share) * interval)
            self._bank.update(interval / steps, between + share ** 2 * error)
            if is_any:
                self._suspected.update(interval / steps, share ** 2 * error * suspected)
        self._believed[~suspected] = stamp
        self._take(expected, error, lied & ~(wrong | stepped))
        # a doubt that comes to nothing corrects the values of the last moment
        self._undecided.append((stamp, self._values))
        while self._undecided[0][0] < stamp - DISBELIEF:
            self._tones.add(*self._undecided.popleft())
        return bool(stepped.any())

    def _take(self, expected: np.ndarray, error: np.ndarray, believed: np.ndarray) -> None:
        """Take an estimate for true as far as it does not lie, and others with it that did not."""
        lies = self._jumps.lies
        for values, left_out in self._left_out:
            values += left_out * (believed & ~lies)  # what was learnt from is what was kept
            left_out *= lies
        left_out = np.where(lies, error, 0.0)
        self._values = expected + error - left_out
        self._left_out = [*self._left_out, (self._values, left_out)] if self._jumps.is_any else []

    def _evaluate(
        self, stamp: float, interval: float, values: np.ndarray, error: np.ndarray,
        noise: np.ndarray,
    ) -> JumpDecision:
        """
        Judge an estimate by what was expected before the doubt, and by what it led to.

        It counts as hardly more certain than those a moment before: of an axis that has just
        been found again little is predicted yet, and what differs from that is no lie.
        """
        self._spread = np.maximum(noise, math.exp(-self._interval / DISBELIEF) * self._spread)
        if not self._jumps.is_any and interval <= HORIZONS[0]:
            deviation = np.sqrt(self._variances[:, 0] + self._spread)
            return self._jumps.evaluate(stamp, error, deviation, abs(error) < SUSPECT * deviation)
        later = np.stack((stamp - self._believed, np.full(len(values), interval)), axis=1)
        known = np.array([np.interp(times, HORIZONS, variances, right=UNKNOWN)
                          for times, variances in zip(later, self._variances, strict=True)])
        deviation, at_once = np.sqrt(known.T + self._spread)
        led = abs(values - self._led @ _terms(min(interval, FARTHEST)))
        return self._jumps.evaluate(stamp, error, deviation, led < SUSPECT * at_once)

    def _expected(self, time: float) -> np.ndarray:
        """
        Return the positions at a time [s] by the last estimates that were believed.

        What was predicted from a prediction would grow with every step.
        """
        return np.array([
            _sum(_terms(min(time - believed, FARTHEST)), axis)
            for believed, axis in zip(
                self._believed.tolist(), self._forecast.tolist(), strict=True)])

    def _go_on(self, interval: float, noise: np.ndarray) -> None:
        """Predict from the filters as they are, and keep what to learn from."""
        seen, level = self._bank.features(
            self._jumps.lies[:, None, None] * self._suspected.modes if self._jumps.is_any else 0.0)
        floor = noise * (self._interval * ACCELERATION_NOISE)
        self._peak = np.maximum(
            math.exp(-interval / PEAK_TIME) * self._peak,
            BANDWIDTHS[LEVEL] ** 4 * seen[:, ACCELERATION] ** 2 - NOISE_PEAK * floor)
        if self.stamp > self._next_learning - SAME_TIME:
            self._next_learning = self.stamp + LEARNING_PERIOD
            self._learn(noise, floor)
        self._mean = self._mean + (1.0 - math.exp(-interval / MEAN_TIME)) * (
            self._values - self._mean)
        moves = (seen[:, None] @ self._weights)[:, 0]
        continued = level[:, None] + np.minimum(np.maximum(moves, -self._reach), self._reach)
        most = np.sqrt(noise)[:, None] * (1.0 + (LARGEST_STEP - 1.0) * self._trust)
        step = np.minimum(np.maximum(
            self._tones.at(self.stamp, HORIZONS) - continued, -most), most)
        full = continued + self._trust * step
        mean = np.repeat(self._mean[:, None], len(HORIZONS), axis=1)
        self._led = full @ _SPLINE
        self._forecast = np.where(self._jumps.is_open[:, None], self._forecast, self._led)
        final = mean + self._room(interval, full) * self._share * (full - mean)
        coefficients = final @ _SPLINE
        coefficients[:, 0] += self._origin
        self._final = coefficients.tolist()
        sample = Sample(
            self.stamp, interval, self._values, level, seen, (full, mean, final, continued, step))
        for continuation in self._continuations:
            continuation.add(sample)

    def _learn(self, noise: np.ndarray, floor: np.ndarray) -> None:
        """Let near and far horizons learn in turn; what much weaker motion has shown fades."""
        strongest = floor + self._peak
        share = np.minimum(GROWTH * self._known / strongest, 1.0)
        for continuation in self._continuations:
            continuation.weaken(share)
        self._known = np.minimum(np.maximum(self._known, strongest / GROWTH), strongest)
        learner, axis = next(self._turns)
        self._tones.fit(axis, noise[axis])
        learner.learn(noise)
        self._solve([learner], noise)

    def _solve(self, learners: Iterable[Continuation], noise: np.ndarray) -> None:
        """Take what some groups of horizons have learnt, and how well they did."""
        for learner in learners:
            learner.solve(PEAK_SHARE * self._peak, noise * self._interval, self._tones.noise_gain)
        self._weights, self._variances, self._share, self._trust = (
            np.concatenate([getattr(one, part) for one in self._continuations], axis=-1)
            for part in ('weights', 'variances', 'share', 'trust'))

    def _room(self, interval: float, full: np.ndarray) -> np.ndarray:
        """Return the share of a motion that bends sharply which is compensated, (axes, 1)."""
        bend = np.abs(full[:, :3] @ _BEND)
        self._bend = np.maximum(math.exp(-interval / BEND_TIME) * self._bend, bend)
        room = np.minimum(self._acceleration / np.maximum(self._bend, 1e-9), 1.0)
        return (room * np.minimum(room / LEAST_ROOM, 1.0))[:, None]
