"""A course near one instant as polynomials of time: cheap to ask often."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from facade_manipulator.kinematics import MotionState, Pose


class PolynomialMotion(NamedTuple):
    """
    A course expanded about an instant.

    Parameters
    ----------
    centre : float
        The instant [s].
    reach : float
        How far from it the expansion may be asked [s].
    coefficients : sequence of sequence of float, shape (degree + 1, 3)
        Of x, y and θ, those of the highest power of the time since the centre first.

    """

    centre: float
    reach: float
    coefficients: Sequence[Sequence[float]]

    def covers(self, time: float) -> bool:
        """Tell whether the course may be asked for a time [s]."""
        return abs(time - self.centre) <= self.reach

    def at(self, time: float) -> MotionState:
        """Return place and velocity at a time [s], by Horner's rule, all axes in one go."""
        t = time - self.centre
        x = y = theta = x_rate = y_rate = theta_rate = 0.0
        for cx, cy, ctheta in self.coefficients:
            x_rate, x = x_rate * t + x, x * t + cx
            y_rate, y = y_rate * t + y, y * t + cy
            theta_rate, theta = theta_rate * t + theta, theta * t + ctheta
        return MotionState(Pose(x, y, theta), Pose(x_rate, y_rate, theta_rate))
