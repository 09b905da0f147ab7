"""
Prediction of the disturbance: a learnt continuation of the motion plus sinusoidal tones.

Each estimate y(t) of an axis passes through these steps, in the order of the code:

1. Expect. The last trusted forecast gives ŷ(t); the error is e = y − ŷ.
2. Decide (`doubt`, `jumps`). While e is large and explained by a jump, the estimate counts as
   wrong, and ŷ is learnt instead of y. If the estimator has stepped, the origin of all positions
   moves.
3. Filter (`filters`). Linear filters of four bandwidths take ŷ + e. Over a gap they take the
   forecast plus a constant acceleration to the estimate. Their states are the features φ and the
   level, a smooth position. If the estimates were wrong, the part that they caused is subtracted,
   because the filters are linear.
4. Learn (`learning`). Least squares give W, so that Wᵀφ(t) predicts the moves d(t + τ) − level(t)
   at seven horizons τ (`continuation`, with the `prior`), and the sines of the last minute
   (`tones`). Trust k is the share of the step towards the tones that would have been best.
5. Forecast. With the bounds v of a speed and n of the noise,

       continued = level + clip(Wᵀφ, ±v τ),
       forecast = continued + k clip(tones − continued, ±n).

6. Reduce (`reduction`). A forecast that accelerates more than a gondola can is drawn to the mean.
7. Interpolate (`spline`). A cubic spline gives position and velocity at any time.

The filters are stable. A speed bounds the moves, and the noise bounds the steps towards tones.
Any learnt weights therefore give a bounded forecast. No forecast is made from another forecast,
except over a gap (up to `LONGEST_GAP_OF_ESTIMATES`) and while estimates count as wrong (up to
`DECISION_TIME`): the filters then follow the last trusted forecast. No proof covers this case.
Tests bound the prediction in this case for random estimates. `EstimateGate` rejects jumps that
would exceed the bound.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.prediction.continuation import Sample
from facade_manipulator.prediction.doubt import Doubt
from facade_manipulator.prediction.filters import FilterBank
from facade_manipulator.prediction.jumps import DECISION_TIME, JumpDecision
from facade_manipulator.prediction.learning import Learning
from facade_manipulator.prediction.positions import Positions
from facade_manipulator.prediction.prior import HORIZONS
from facade_manipulator.prediction.reduction import Reduction
from facade_manipulator.prediction.spline import LAST_HORIZON, motion, Pieces, splines


class DisturbancePredictor:
    """
    Predictor of the disturbance from its estimates.

    The correction of the compensator passes each estimate, and asks for the motion in each cycle.

    Attributes
    ----------
    stamp, since : float
        Stamps of the last estimate and of the first learnt estimate [s]; −∞ before any estimate.
    innovations : numpy.ndarray, shape (3,)
        Mean squared errors of the forecasts of the next estimate [m², m², rad²], without wrong
        estimates: the noise of the estimates and the error of the prediction.

    """

    MOVES = 2.0 * HORIZONS  # m or rad, bound of the moves: a speed of 2 m/s or rad/s
    # s without estimates, after which learning starts again
    LONGEST_GAP_OF_ESTIMATES = 1.1
    FIRST_INTERVAL = 0.02  # s, assumed mean interval until there are two estimates
    LARGEST_STEP = 3.0  # standard deviations, towards trusted tones; 1 towards others
    INNOVATION_TIME = 2.0  # s, averaging time of the squared innovations
    HOLD_TIME = 0.2  # s, time constant of the velocity beyond the last horizon

    def __init__(self) -> None:
        self.stamp = -math.inf
        self.since = -math.inf
        self._interval = self.FIRST_INTERVAL  # mean between estimates [s]

    def update(self, stamp: float, values: Pose, variances: Sequence[float]) -> bool:
        """
        Learn from an estimate; return whether a step of the estimator was detected.

        Parameters
        ----------
        stamp : float
            Time of the disturbance [s]. Learning starts again if it is not later than the
            previous stamp, or later by more than `LONGEST_GAP_OF_ESTIMATES`.
        values : Pose
            Estimated disturbance [m, m, rad].
        variances : sequence of float
            Variances of the noise, above 0 [m², m², rad²].

        """
        measured = np.array(values)
        noise = np.array(variances)
        interval = stamp - self.stamp
        has_stepped = False
        if 0.0 < interval <= self.LONGEST_GAP_OF_ESTIMATES:
            share = min(interval / (stamp - self.since), 1.0)
            self._interval += share * (interval - self._interval)
            has_stepped = self._follow(stamp, interval, measured, noise)
        else:
            interval = self.FIRST_INTERVAL
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
        t = min(max(ahead, 0.0), LAST_HORIZON)
        decay = math.exp(min(LAST_HORIZON - ahead, 0.0) / self.HOLD_TIME)
        held = self.HOLD_TIME * (1.0 - decay)
        positions = []
        velocities = []
        for pieces in self._splines:
            position, velocity = motion(pieces, t)
            positions.append(position + held * velocity)
            velocities.append(decay * velocity)
        return MotionState(Pose(*positions), Twist(*velocities))

    def deviations(self, time: float) -> tuple[float, ...]:
        """Return the standard deviations of the prediction errors at a time [s], [m, m, rad]."""
        ahead = time - self.stamp
        found = []
        for variances in self._learning.variances:
            found.append(math.sqrt(np.interp(ahead, HORIZONS, variances)))
        return tuple(found)

    def _start(self, stamp: float, measured: np.ndarray, noise: np.ndarray) -> None:
        """Start at rest at the measured position, which becomes the origin [m, rad]."""
        axes = len(measured)
        self.since = stamp
        self.innovations = noise.copy()
        self._interval = self.FIRST_INTERVAL
        self._origin = measured
        # the newest positions, those of wrong axes expected
        self._values = np.zeros(axes)
        self._left_out = np.zeros(axes)  # errors of wrong axes, which are not in them
        self._positions = Positions()
        self._bank = FilterBank(axes)
        self._doubt = Doubt(axes)
        self._learning = Learning(stamp, noise, self._interval)
        self._reduction = Reduction(axes)

    def _follow(
        self, stamp: float, interval: float, measured: np.ndarray, noise: np.ndarray
    ) -> bool:
        """Forecast, decide and filter; return whether a step of the estimator was detected."""
        expected = self._doubt.expected(stamp)
        values = measured - self._origin
        error = values - expected
        variance = self._learning.variance
        was_doubted = self._doubt.is_any_doubted
        self._doubt.fade(self._interval, noise)
        decisions = self._doubt.decide(stamp, interval, values, error, variance)

        has_stepped = False
        if was_doubted:  # otherwise no doubt can end
            steps = self._end_doubts(decisions, error)
            error = np.where(steps, 0.0, error)
            has_stepped = bool(steps.any())

        is_wrong = self._doubt.is_wrong
        self._filter(stamp, interval, expected, error)
        self._left_out = error * is_wrong
        self._values = expected + error - self._left_out
        for decided in self._positions.decided(stamp - DECISION_TIME):
            self._learning.tones.add(*decided)
        return has_stepped

    def _end_doubts(
        self, decisions: list[JumpDecision], error: np.ndarray
    ) -> np.ndarray:
        """Apply decisions that end doubts; return the axes with a step of the estimator."""
        has_stepped = np.array([one is JumpDecision.STEP for one in decisions])
        were_wrong = np.array([one is JumpDecision.WRONG for one in decisions])
        were_wrong |= has_stepped

        self._origin = np.where(has_stepped, self._origin + error, self._origin)
        self._bank.end_doubt(were_wrong, self._doubt.is_doubted)
        self._positions.settle(~self._doubt.is_wrong, ~were_wrong)
        return has_stepped

    def _filter(
        self, stamp: float, interval: float, expected: np.ndarray, error: np.ndarray
    ) -> None:
        """
        Update the filters and the mean squared innovations.

        Over a gap the filters follow the prediction plus a constant acceleration to the estimate.
        """
        steps = max(round(interval / self._interval), 1)
        if steps == 1:  # not over a gap
            weights = interval / self.INNOVATION_TIME * ~self._doubt.is_wrong
            changes = weights * (error**2 - self.innovations)
            self.innovations = self.innovations + changes

        for step in range(1, steps + 1):
            share = step / steps
            between = expected
            if step < steps:
                between = self._doubt.expected(stamp - (1.0 - share) * interval)
            part = share**2 * error
            doubted = None
            if self._doubt.is_any_doubted:
                doubted = part * self._doubt.is_doubted
            self._bank.update(interval / steps, between + part, doubted)

    def _forecast(self, interval: float, noise: np.ndarray) -> None:
        """Learn if due, forecast the positions, and store the sample for later learning."""
        learning = self._learning
        wrong = None
        if self._doubt.is_any_doubted:
            wrong = self._doubt.is_wrong[:, None, None] * self._bank.doubted
        seen, level = self._bank.features(wrong)
        learning.update(
            self.stamp, interval, seen, noise, self._interval, self._positions
        )

        # moves of the continuation, then the step from there towards the tones
        moves = _clipped((seen[:, None] @ learning.weights)[:, 0], self.MOVES)
        continued = level[:, None] + moves
        bound = 1.0 + (self.LARGEST_STEP - 1.0) * learning.trust
        bound = np.sqrt(noise)[:, None] * bound
        tones = learning.tones.at(self.stamp)
        step = _clipped(tones - continued, bound)
        forecast = continued + learning.trust * step

        self._reduction.update(interval, self._values)
        final = self._reduction.reduced(interval, forecast)
        pieces = splines(np.array((forecast, final)))
        pieces[1, ..., 0] += self._origin[:, None]
        newest, at_origin = pieces.tolist()
        self._doubt.trust(self.stamp, newest)
        self._splines: list[Pieces] = at_origin

        is_doubted = self._doubt.is_any_doubted
        self._positions.add(self.stamp, self._values, self._left_out, is_doubted)
        forecasts = np.array((final, continued, step))
        learning.add(Sample(self.stamp, interval, level, seen, forecasts))


def _clipped(values: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Return values clipped to ± bounds; np.clip would take twice as long."""
    return np.minimum(np.maximum(values, -bounds), bounds)
