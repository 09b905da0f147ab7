"""The rail as it was mounted: bowed, and with a middle slide that is not square to it."""

from __future__ import annotations

from math import tan

from facade_manipulator.kinematics.closure import CONVERGED, STEPS
from facade_manipulator.kinematics.geometry import Geometry


class Rail:
    """
    Height of the rail along its length, and how the slide on A3 leans.

    The height is h(Q) = bow (1 − t²), with t from −1 to 1 over the stroke. The slide leans with
    the rail and by the slide's own angle ψ: P stands at x = Q3 − (y − h) k, with
    k = tan ψ + dh/dQ.
    """

    def __init__(self, geometry: Geometry) -> None:
        self._bow = geometry.rail_bow
        self._middle = 0.5 * sum(geometry.stroke)
        self._curvature = -8.0 * geometry.rail_bow / geometry.stroke_length ** 2
        self._lean = tan(geometry.slide_angle)

    def height(self, q: float) -> float:
        """Return h of a position on the rail [m]."""
        return self._bow + 0.5 * self._curvature * (q - self._middle) ** 2

    def slope(self, q: float) -> float:
        """Return dh/dQ."""
        return self._curvature * (q - self._middle)

    def lean(self, q: float) -> float:
        """Return k of a slide that stands at a position."""
        return self._lean + self.slope(q)

    def rate(self, q: float, y: float) -> float:
        """Return dx/dQ3 at a y of P that does not change."""
        return 1.0 + self.slope(q) * self.lean(q) - (y - self.height(q)) * self._curvature

    def under(self, x: float, y: float) -> float:
        """Return Q3 of a place of P [m], by Newton's method."""
        q = x
        for _ in range(STEPS):
            step = (x + (y - self.height(q)) * self.lean(q) - q) / self.rate(q, y)
            q += step
            if abs(step) <= CONVERGED:
                break
        return q
