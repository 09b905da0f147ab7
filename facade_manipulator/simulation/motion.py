"""Motions as functions of time, and smooth curves through equidistant samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from facade_manipulator.kinematics import Pose

Motion = Callable[[float], Pose]  #: the rail in the façade's frame at a time [s]


def catmull_rom(
    before: np.ndarray, here: np.ndarray, there: np.ndarray, after: np.ndarray, share: float
) -> np.ndarray:
    """Interpolate between the inner two of four points; `share` is 0 at `here`, 1 at `there`."""
    slope, next_slope = 0.5 * (there - before), 0.5 * (after - here)
    chord = there - here
    square = 3.0 * chord - 2.0 * slope - next_slope
    cube = slope + next_slope - 2.0 * chord
    return here + share * (slope + share * (square + share * cube))
