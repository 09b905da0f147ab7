"""Predictions that learn nothing: what the gain of learning is measured by."""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.kinematics import MotionState, Pose, Twist
from facade_manipulator.prediction import Variances

HORIZON = 0.12  # s, by which the plainest comes late
LONGEST_GAP = 3.0  # s without estimates, after which everything begins again
FIRST_VELOCITY = 0.3  # m/s or rad/s, standard deviation
FIRST_ACCELERATION = 0.3  # m/s² or rad/s²
JERK_DENSITY = 0.01  # m²/s⁵ or rad²/s⁵


class AccelerationPrediction:
    """Position, velocity and acceleration of each axis, driven by white jerk."""

    def __init__(self) -> None:
        self.stamp = self.since = -math.inf

    def update(self, stamp: float, values: Pose, variances: Variances) -> None:
        """Learn from an estimate of a stamp [s]."""
        last, self.stamp = self.stamp, stamp
        if not 0.0 < stamp - last <= LONGEST_GAP:
            self.since = stamp
            self._states = np.column_stack([values, np.zeros((3, 2))])
            self._covariances = np.stack([np.diag(
                [noise, FIRST_VELOCITY ** 2, FIRST_ACCELERATION ** 2]) for noise in variances])
            return
        step = _transition(stamp - last)
        states = self._states @ step.T
        covariances = step @ self._covariances @ step.T
        covariances += JERK_DENSITY * _jerk_covariance(stamp - last)
        gains = covariances[:, :, 0] / (covariances[:, 0, 0] + variances)[:, None]
        self._states = states + gains * (np.array(values) - states[:, 0])[:, None]
        self._covariances = covariances - gains[:, :, None] * covariances[:, None, 0, :]

    def predict(self, time: float) -> MotionState:
        """Extrapolate to a time [s], at most to the longest gap."""
        ahead = min(time - self.stamp, LONGEST_GAP)
        states = self._states @ _transition(ahead).T
        return MotionState(Pose(*states[:, 0].tolist()), Twist(*states[:, 1].tolist()))


class HeldPrediction(AccelerationPrediction):
    """The disturbance is taken as it was when last seen: it comes one horizon late."""

    def predict(self, time: float) -> MotionState:
        """Return where the disturbance was one horizon before a time [s]."""
        return super().predict(time - HORIZON)


def _transition(interval: float) -> np.ndarray:
    return np.array([
        [1.0, interval, 0.5 * interval ** 2], [0.0, 1.0, interval], [0.0, 0.0, 1.0]])


def _jerk_covariance(interval: float) -> np.ndarray:
    """Return what white jerk of density 1 adds over an interval [s]."""
    t = interval
    return np.array([
        [t ** 5 / 20.0, t ** 4 / 8.0, t ** 3 / 6.0],
        [t ** 4 / 8.0, t ** 3 / 3.0, t ** 2 / 2.0],
        [t ** 3 / 6.0, t ** 2 / 2.0, t]])
