"""A course near one instant as polynomials of time: cheap to ask often."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from facade_manipulator.control.blend import Course
from facade_manipulator.kinematics import Pose


class PolynomialCourse(NamedTuple):
    """
    A course expanded about an instant.

    Parameters
    ----------
    centre : float
        The instant [s].
    reach : float
        How far from it the expansion may be asked [s].
    coefficients : sequence of sequence of float, shape (3, degree + 1)
        For x, y and θ, of the highest power of the time since the centre first.

    """

    centre: float
    reach: float
    coefficients: Sequence[Sequence[float]]

    def covers(self, time: float) -> bool:
        """Tell whether the course may be asked for a time [s]."""
        return abs(time - self.centre) <= self.reach

    def at(self, time: float) -> Course:
        """Return place and velocity at a time [s]."""
        elapsed = time - self.centre
        x, y, theta = (_value_and_slope(axis, elapsed) for axis in self.coefficients)
        return Course(Pose(x[0], y[0], theta[0]), Pose(x[1], y[1], theta[1]))


def _value_and_slope(coefficients: Sequence[float], at: float) -> tuple[float, float]:
    """Return a polynomial and its derivative by Horner's rule."""
    value = slope = 0.0
    for coefficient in coefficients:
        slope = slope * at + value
        value = value * at + coefficient
    return value, slope
