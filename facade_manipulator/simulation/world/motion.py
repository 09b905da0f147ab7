"""Prescribed motions of the rail as functions of time: sums of sines and recordings."""

from __future__ import annotations

from collections.abc import Callable
import math
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from facade_manipulator.errors import ParameterError
from facade_manipulator.simulation.world.scenario import Motion

#: poses of the rail in frame facade, shape (..., 3), at times since the start [s]
PoseFunction = Callable[[np.ndarray], np.ndarray]


def prescribed_motion(motion: Motion) -> PoseFunction | None:
    """
    Return the motion that a scenario prescribes, or None if the gondola hangs freely.

    Raises
    ------
    ParameterError
        If a recording cannot be used.

    """
    if motion.recording:
        return recorded_motion(Path(motion.recording))
    sines = (motion.x, motion.y, motion.theta)
    return sum_of_sines(*sines) if any(sines) else None


def sum_of_sines(*axes: tuple[tuple[float, float, float], ...]) -> PoseFunction:
    """Return the sum of the sines (amplitude, frequency [Hz], phase) of x, y and θ [m, m, rad]."""
    return lambda times: np.stack([
        sum((amplitude * np.sin(math.tau * frequency * times + phase)
             for amplitude, frequency, phase in sines), np.zeros(np.shape(times)))
        for sines in axes], axis=-1)


def recorded_motion(path: Path) -> PoseFunction:
    """Return a recording [m, m, rad] as cubic splines, played forth and back."""
    try:
        table = np.loadtxt(path, delimiter=',', skiprows=1, ndmin=2)
        times, x, y, theta = table.T
        spline = CubicSpline(times - times[0], np.column_stack([x, y, theta]))
    except (OSError, ValueError) as error:
        raise ParameterError(
            f'recording {path} rejected: {error}; next: write two or more rows of time, x, y, '
            'theta with ascending times') from error
    period = 2.0 * spline.x[-1]
    return lambda times: spline(abs(times - period * np.round(times / period)))
