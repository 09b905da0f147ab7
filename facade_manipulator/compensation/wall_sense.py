"""
The wall as a sensor: while the head presses, force and moment say where the gondola is, too.

The head is at y_w + F / k̂ on a wall at y_w, its yaw at θ_w + 4 M / (k̂ w²), so the rail is where
that less the head's pose in its frame is. Of a stiff wall that is known ten times better than by
the estimator, but for where the wall is, which is learnt from the estimates.

With z = d + n by the estimator, z' = d − y_w + n' by the wall and y_w known as m ± √P, all that is
known of d is z + (m + z' − z) R / (R + P + R'), and y_w is m + (z − z' − m) P / (R + P + R').
"""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.kinematics import Pose
from facade_manipulator.prediction import Estimate

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
        self, stamp: float, estimate: float, variance: float, seen: float, noise: float
    ) -> tuple[float, float]:
        """
        Return where the gondola is at a stamp [s] and the variance of that, by both.

        Parameters
        ----------
        estimate, variance : float
            By the estimator [m or rad and its square].
        seen, noise : float
            By the wall if that were at 0, and its standard deviation.

        """
        interval = max(stamp - self._stamp, 0.0)
        self._stamp = max(self._stamp, stamp)
        error, both = estimate - seen - self._place, variance + noise ** 2
        total = self._variance + both
        if not error ** 2 < CHANGED * total < math.inf:
            self._place, self._variance = estimate - seen, both
            return estimate, variance
        self._surprise += min(interval / SURPRISE_TIME, 1.0) * (
            error ** 2 / total - self._surprise)
        self._odd = max(self._odd * math.exp(-interval / DISTRUST_TIME),
                        self._surprise - SURPRISING)
        both, total = both + total * self._odd, total + total * self._odd
        fused = estimate - variance / total * error, variance * (1.0 - variance / total)
        self._place += self._variance / total * error
        self._variance *= both / total
        self._variance = max(self._variance, variance * min(interval / LEARNING_TIME, 1.0))
        return fused


class WallSense:
    """Improve estimates by the wall that the head presses on."""

    def __init__(self) -> None:
        self._y, self._theta = WallPlace(), WallPlace()

    def fused(
        self, estimate: Estimate, yaw: float, head: Pose | None, pressed: Deflection | None
    ) -> Estimate:
        """
        Return the estimate with what the wall says of y and θ.

        Parameters
        ----------
        estimate : Estimate
        yaw : float
            Of the rail, as predicted: with a noisy one the head's x would make noise of y [rad].
        head : Pose or None
            In frame rail at the stamp of the estimate; None where that is not known.
        pressed : Deflection or None
            Then; None where nobody knows it, or nothing touches.

        """
        stamp, pose, variances, known = estimate
        if head is None or pressed is None or not all(known):
            self._y.forget()
            self._theta.forget()
            return estimate
        reach = math.sin(yaw) * head.x + math.cos(yaw) * head.y
        y, y_variance = self._y.fused(
            stamp, pose.y, variances.y, pressed.y - reach, pressed.y_noise)
        theta, theta_variance = self._theta.fused(
            stamp, pose.theta, variances.theta, pressed.theta - head.theta, pressed.theta_noise)
        return Estimate(stamp, pose._replace(y=y, theta=theta),
                        variances._replace(y=y_variance, theta=theta_variance), known)
