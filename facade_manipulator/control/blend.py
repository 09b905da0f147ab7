"""Lead one course smoothly into another: their difference dies out, critically damped."""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import add, subtract

QUICKEST = 1e-3
DEAD_AFTER = 40.0  # time constants: 1e-16 of the remainder is left
NOWHERE = Pose(0.0, 0.0, 0.0)


class Course(NamedTuple):
    """Place [m, m, rad] and velocity [m/s, m/s, rad/s] at one instant."""

    place: Pose
    velocity: Pose

    def plus(self, other: Course) -> Course:
        """Return the sum, component by component."""
        if other is AT_REST:
            return self
        return Course(add(self.place, other.place), add(self.velocity, other.velocity))

    def minus(self, other: Course) -> Course:
        """Return the difference, component by component."""
        return Course(
            subtract(self.place, other.place), subtract(self.velocity, other.velocity))


AT_REST = Course(NOWHERE, NOWHERE)


class Blend:
    """
    The remainder of an old course, to be added to the new one.

    At its start the sum continues place and velocity of the old course; later it is the new one.

    Parameters
    ----------
    acceleration : tuple of float, shape (3,)
        Acceleration that the remainder adds at most, about: a long way takes longer
        [m/s², m/s², rad/s²].

    """

    def __init__(self, acceleration: tuple[float, ...]) -> None:
        self._acceleration = acceleration
        self.clear()

    def clear(self) -> None:
        """Forget the remainder."""
        self._start = self._end = -math.inf

    def begin(self, time: float, difference: Course, constant: float) -> None:
        """
        Take a new remainder in place of the present one.

        Parameters
        ----------
        time : float
            Now [s].
        difference : Course
            Old course less new course.
        constant : float
            Time constant of the decay [s], lengthened where the acceleration would be too high.

        """
        self._start = time
        self._axes = [
            _remainder(*axis, max(constant, QUICKEST))
            for axis in zip(*difference, self._acceleration, strict=True)]
        self._end = time + DEAD_AFTER * max(constant for _, _, constant in self._axes)

    def at(self, time: float) -> Course:
        """Return the remainder at a time [s]."""
        if time > self._end:
            return AT_REST
        elapsed = max(time - self._start, 0.0)
        x, y, theta = [_decayed(*axis, elapsed) for axis in self._axes]
        return Course(Pose(x[0], y[0], theta[0]), Pose(x[1], y[1], theta[1]))


def _remainder(
    place: float, velocity: float, acceleration: float, constant: float
) -> tuple[float, float, float]:
    """Return p, s and T of (p + s t) exp(−t/T)."""
    far = math.sqrt(abs(place) / acceleration)
    fast = 2.0 * abs(velocity) / acceleration
    constant = max(constant, far, fast)
    return place, velocity + place / constant, constant


def _decayed(
    place: float, slope: float, constant: float, elapsed: float
) -> tuple[float, float]:
    decay = math.exp(-elapsed / constant)
    place += slope * elapsed
    return place * decay, (slope - place / constant) * decay
