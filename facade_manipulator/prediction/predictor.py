"""
Predict the disturbance: fixed filters, and a continuation of the motion that is learnt.

Everything that grows is bounded by what came: filters are stable, whatever they learnt; moves are
bounded by speed, what bends too sharply is drawn towards the mean, and so is what was not
predicted better than by it. So bounded estimates give a bounded prediction. The variances of the
predictions' errors are measured, too; they decide which estimates are outliers.
"""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.prediction.continuation import Continuation, FilterSample, UNKNOWN
from facade_manipulator.prediction.filters import (
    ACCELERATION,
    BANDWIDTHS,
    FEATURES,
    features,
    FilterBank,
    LEVEL,
)
from facade_manipulator.prediction.prior import HORIZONS, noise_moments
from facade_manipulator.prediction.settings import PredictionSettings

LONGEST_GAP = 1.1  # s without estimates, after which everything is learnt again
LEARNING_PERIOD = 0.14  # s
SAME_TIME = 1e-6  # s, what is closer together counts as one
FIRST_INTERVAL = 0.02  # s, taken for the mean one until there are two estimates
PEAK_TIME = 20.0  # s, time constant with which the strongest motion seen is forgotten
PEAK_SHARE = 0.1  # variance of the acceleration expected, by its peak's square
NOISE_PEAK = 9.0  # squares of an acceleration by its noise's variance that are no motion
LEAST_ROOM = 0.3  # of the acceleration that fits, below which even less is compensated
MEAN_TIME = 5.0  # s, of the mean that remains where nothing is predicted
BEND_TIME = 0.5  # s, time constant with which the sharpest bend is forgotten
MOST_STEPS = 100  # over a gap
OUTLIER = 8.0  # standard deviations
HOLD_TIME = 0.2  # s in which the velocity dies out beyond the last horizon
NEAR, FAR = slice(0, 4), slice(4, None)  # horizons, learnt apart: the near ones at once
FAR_TURN = 4  # every fourth learning is that of the far horizons
ACCELERATION_NOISE = BANDWIDTHS[LEVEL] ** 4 * noise_moments().features[
    ACCELERATION, ACCELERATION]  # variance of the level filter's acceleration, by noise density
FULL, MEAN, FINAL = range(3)  # kinds of forecasts: learnt, mean alone, and as it is given

# A cubic spline through the moves: 1, t, t², t³ and a cubic from each inner horizon but the outer
_KNOTS = HORIZONS[2:-2]
_POWERS = np.arange(4.0)
_SPLINE = np.linalg.inv(np.hstack([
    HORIZONS[:, None] ** _POWERS, np.maximum(HORIZONS[:, None] - _KNOTS, 0.0) ** 3]))


class DisturbancePredictor:
    """
    Predict the disturbance from its estimates.

    Parameters
    ----------
    settings : PredictionSettings

    Attributes
    ----------
    stamp, since : float or None
        Of the last estimate and of the first that was learnt from [s].

    """

    def __init__(self, settings: PredictionSettings) -> None:
        self.settings = settings
        self.stamp: float | None = None
        self.since: float | None = None
        self._reach = np.array(settings.speed)[:, None] * HORIZONS
        self._acceleration = np.array(settings.acceleration)

    def update(self, stamp: float, values: Pose, variances: Pose) -> None:
        """
        Learn from an estimate.

        Parameters
        ----------
        stamp : float
            When the disturbance was there [s]; if it is earlier than that of the estimate
            before, or much later, everything is learnt again.
        values : Pose
            Estimated disturbance.
        variances : Pose
            Variances of the estimate's noise, above 0.

        """
        measured, noise = np.array(values), np.array(variances)
        if self.stamp is None or not 0.0 < stamp - self.stamp <= LONGEST_GAP:
            self._start(stamp, measured, noise)
        else:
            interval = stamp - self.stamp
            measured = self._plausible(interval, measured, noise)
            self._bridge(interval, measured)
            self._interval += min(interval / (stamp - self.since), 1.0) * (
                interval - self._interval)
            self._go_on(stamp, interval, measured, noise)

    def predict(self, time: float) -> MotionState:
        """Return the disturbance to compensate at a time, of the past or the future [s]."""
        ahead = time - self.stamp
        position, velocity = self._at(min(max(ahead, 0.0), HORIZONS[-1]))
        if ahead > HORIZONS[-1]:
            decay = math.exp((HORIZONS[-1] - ahead) / HOLD_TIME)
            position = position + HOLD_TIME * (1.0 - decay) * velocity
            velocity = decay * velocity
        return MotionState(Pose(*position.tolist()), Twist(*velocity.tolist()))

    def deviations(self, time: float) -> tuple[float, ...]:
        """Return the standard deviations of the errors at a time [s]: x, y, theta [m, m, rad]."""
        ahead = time - self.stamp
        return tuple([
            math.sqrt(np.interp(ahead, HORIZONS, variances)) for variances in self._variances])

    def _start(self, stamp: float, measured: np.ndarray, noise: np.ndarray) -> None:
        axes = len(measured)
        self.since = self._next_learning = stamp
        self._interval = FIRST_INTERVAL
        self._bank, self._mean = FilterBank(measured), measured
        self._near, self._far = self._continuations = [
            Continuation(axes, group, self.settings.memory) for group in (NEAR, FAR)]
        self._learnings = 0
        self._peak, self._learnt_peak, self._bend, self._suspected = np.zeros((4, axes))
        self._weights = np.zeros((axes, FEATURES, len(HORIZONS)))
        self._variances = np.full((axes, len(HORIZONS)), UNKNOWN)
        self._share = np.ones((axes, len(HORIZONS)))
        for continuation in self._continuations:
            self._solve(continuation, noise * self._interval)
        self._go_on(stamp, self._interval, measured, noise)

    def _plausible(self, interval: float, measured: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Return an estimate with the prediction in place of outliers; a second one is true."""
        ahead = min(interval, HORIZONS[-1])
        expected, _ = self._at(ahead)
        index = int(np.searchsorted(HORIZONS, ahead))
        bound = OUTLIER ** 2 * (self._variances[:, index] + noise)
        suspected = (measured - expected) ** 2 > bound
        suspected &= interval <= HORIZONS[-1]  # after longer gaps anything may be true
        outliers = suspected & ~self._suspected.astype(bool)
        self._suspected = suspected
        return np.where(outliers, expected, measured)

    def _bridge(self, interval: float, measured: np.ndarray) -> None:
        """Lead the filters to an estimate; a gap along the prediction, corrected to end there."""
        steps = min(max(round(interval / self._interval), 1), MOST_STEPS)
        error = measured - self._at(min(interval, HORIZONS[-1]))[0]
        for share in np.arange(1, steps) / steps:
            between = self._at(min(share * interval, HORIZONS[-1]))[0]
            self._bank.update(interval / steps, between + share ** 2 * error)
        self._bank.update(interval / steps, measured)

    def _go_on(
        self, stamp: float, interval: float, measured: np.ndarray, noise: np.ndarray
    ) -> None:
        """Predict from the filters as they are, and keep what to learn from."""
        self.stamp = stamp
        seen, level = features(self._bank.states())
        floor = noise * (self._interval * ACCELERATION_NOISE)
        self._peak = np.maximum(
            math.exp(-interval / PEAK_TIME) * self._peak,
            BANDWIDTHS[LEVEL] ** 4 * seen[:, ACCELERATION] ** 2 - NOISE_PEAK * floor)
        if stamp > self._next_learning - SAME_TIME:
            self._next_learning = stamp + LEARNING_PERIOD
            self._learn(noise, floor)
        self._mean = self._mean + (1.0 - math.exp(-interval / MEAN_TIME)) * (measured - self._mean)
        forecasts = self._forecast(interval, seen, level)
        self._coefficients = forecasts[FINAL] @ _SPLINE.T
        sample = FilterSample(stamp, interval, measured, seen, level, forecasts)
        for continuation in self._continuations:
            continuation.add(sample)

    def _learn(self, noise: np.ndarray, floor: np.ndarray) -> None:
        """Let near and far horizons learn in turn; what weaker motion has shown fades."""
        share = np.minimum((floor + self._learnt_peak) / (floor + self._peak), 1.0)
        self._learnt_peak = self._peak
        for continuation in self._continuations:
            continuation.weaken(share)
        self._learnings += 1
        learner = self._near if self._learnings % FAR_TURN else self._far
        learner.learn(noise)
        self._solve(learner, noise * self._interval)

    def _solve(self, learner: Continuation, density: np.ndarray) -> None:
        """Take what one group of horizons has learnt, and how well it did."""
        learner.solve(PEAK_SHARE * self._peak, density)
        self._weights[..., learner.chosen] = learner.weights
        full, mean, final = np.maximum(
            learner.errors, learner.noise_gain() * density[:, None])
        self._variances[:, learner.chosen] = final
        self._share[:, learner.chosen] = np.minimum(mean / full, 1.0)

    def _forecast(self, interval: float, seen: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Return the positions at the horizons: as learnt, the mean, and what is given."""
        forecasts = np.empty((3, *self._share.shape))
        moves = (seen[:, None] @ self._weights)[:, 0]
        forecasts[FULL] = level[:, None] + np.minimum(np.maximum(moves, -self._reach), self._reach)
        full, mean = forecasts[FULL], self._mean[:, None]
        forecasts[MEAN] = mean
        bend = np.abs(full[:, 0] - 2.0 * full[:, 1] + full[:, 2]) / HORIZONS[0] ** 2
        self._bend = np.maximum(math.exp(-interval / BEND_TIME) * self._bend, bend)
        room = np.minimum(self._acceleration / np.maximum(self._bend, 1e-9), 1.0)
        room *= np.minimum(room / LEAST_ROOM, 1.0)
        forecasts[FINAL] = mean + room[:, None] * self._share * (full - mean)
        return forecasts

    def _at(self, ahead: float) -> tuple[np.ndarray, np.ndarray]:
        """Return position and velocity on the spline at a time after the last estimate [s]."""
        after = np.maximum(ahead - _KNOTS, 0.0)
        basis = np.concatenate((ahead ** _POWERS, after ** 3))
        slopes = np.array((0.0, 1.0, 2.0 * ahead, 3.0 * ahead * ahead, *(3.0 * after ** 2)))
        return self._coefficients @ basis, self._coefficients @ slopes
