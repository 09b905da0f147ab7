"""
The wall as a sensor: while the head presses, force and moment say where the gondola is, too.

The head is at y_w + F / k̂ on a wall at y_w, its yaw at θ_w + 4 M / (k̂ w²), so the rail is where
that less the head's pose in its frame is. Of a stiff wall that is known ten times better than by
the estimator, but for where the wall is, which is learnt from the estimates.

With z = d + n by the estimator, z' = d − y_w + n' by the wall and y_w known as m ± √P, all that is
known of d is z + (m + z' − z) R / (R + P + R'), and y_w is m + (z − z' − m) P / (R + P + R').
Where the estimator has lost y or θ the wall alone tells, for as long as the head presses.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction.estimate import Estimate, Variances

LEARNING_TIME = 5.0  # s, in which the place of the wall is learnt: slower than any sway
SURPRISE_TIME = 1.0  # s, over which both are compared
SURPRISING = 1.6  # mean square of what they differ by, by what is expected: a force that is late
DISTRUST_TIME = 60.0  # s, time constant with which that is forgotten
CHANGED = 25.0  # squares of standard deviations: a frame, a recess, or an estimator that errs


class Deflection(NamedTuple):
    """By how much the wall is pressed in, and the standard deviations of it."""

    y: float  # m
    theta: float  # rad
    y_noise: float
    theta_noise: float


class WallPlace:
    """Where the wall is along one axis, seen from where the estimator counts."""

    def __init__(self) -> None:
        self._place, self._variance, self._stamp = 0.0, math.inf, -math.inf
        self._surprise, self._odd = 1.0, 0.0

    def forget(self) -> None:
        """Forget the wall: the head does not press on it."""
        self._variance, self._stamp = math.inf, -math.inf

    def fused(
        self, stamp: float, estimate: tuple[float, float, bool], seen: float, noise: float
    ) -> tuple[float, float, bool]:
        """
        Return where the gondola is at a stamp [s], the variance of that, whether it is known.

        By the same of the estimator [m or rad and its square], which the wall may do without, and
        by what is seen of the wall if that were at 0, with its standard deviation.
        """
        value, variance, known = estimate
        if not known:
            alone = self._variance + noise ** 2
            return (self._place + seen, alone, True) if alone < math.inf else estimate
        interval = max(stamp - self._stamp, 0.0)
        self._stamp = max(self._stamp, stamp)
        error, both = value - seen - self._place, variance + noise ** 2
        total = self._variance + both
        if not error ** 2 < CHANGED * total < math.inf:
            self._place, self._variance = value - seen, both
            return estimate
        self._surprise += min(interval / SURPRISE_TIME, 1.0) * (
            error ** 2 / total - self._surprise)
        self._odd = max(self._odd * math.exp(-interval / DISTRUST_TIME),
                        self._surprise - SURPRISING)
        both, total = both + total * self._odd, total + total * self._odd
        fused = value - variance / total * error, variance * (1.0 - variance / total), True
        self._place += self._variance / total * error
        self._variance *= both / total
        self._variance = max(self._variance, variance * min(interval / LEARNING_TIME, 1.0))
        return fused


class WallSense:
    """Improve estimates by the wall that the head presses on."""

    def __init__(self) -> None:
        self._y, self._theta = WallPlace(), WallPlace()

    def fused(
        self, estimate: Estimate, yaw: float, head: Pose | None, pressed: Deflection | None,
        is_holding: bool = True,
    ) -> Estimate:
        """
        Return the estimate with what the wall says of y and θ.

        The yaw [rad] is the rail's as predicted: with a noisy one the head's x would make noise of
        y. The head is in frame rail at the stamp of the estimate, and pressed in then; None where
        nobody knows that, or nothing touches. While the head does not hold, the wall is forgotten.
        """
        stamp, pose, variances, known = estimate
        if not is_holding:
            self._y.forget()
            self._theta.forget()
        if head is None or pressed is None:
            return estimate
        reach = math.sin(yaw) * head.x + math.cos(yaw) * head.y
        _, y, theta = zip(pose, variances, known, strict=True)
        theta = self._theta.fused(
            stamp, theta, pressed.theta - head.theta, pressed.theta_noise)
        if theta[2]:  # else nobody knows how far the head reaches
            y = self._y.fused(stamp, y, pressed.y - reach, pressed.y_noise)
        return Estimate(stamp, Pose(pose.x, y[0], theta[0]), Variances(
            variances.x, y[1], theta[1]), (known[0], y[2], theta[2]))
