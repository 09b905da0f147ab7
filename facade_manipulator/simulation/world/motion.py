"""Prescribed motions of the rail as functions of time: sums of sines."""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np

from facade_manipulator.simulation.world.scenario import Motion

#: poses of the rail in frame facade, shape (..., 3), at times since the start [s]
PoseFunction = Callable[[np.ndarray], np.ndarray]


def prescribed_motion(motion: Motion) -> PoseFunction | None:
    """Return the motion that a scenario prescribes, or None if the gondola hangs freely."""
    sines = (motion.x, motion.y, motion.theta)
    return sum_of_sines(*sines) if any(sines) else None


def sum_of_sines(*axes: tuple[tuple[float, float, float], ...]) -> PoseFunction:
    """Return the sum of the sines (amplitude, frequency [Hz], phase) of x, y and θ [m, m, rad]."""
    return lambda times: np.stack([
        sum((amplitude * np.sin(math.tau * frequency * times + phase)
             for amplitude, frequency, phase in sines), np.zeros(np.shape(times)))
        for sines in axes], axis=-1)
