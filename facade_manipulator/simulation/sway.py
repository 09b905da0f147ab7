"""The gondola's motion as sums of sines."""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.parameters import parameter, settings

DEGREE = math.pi / 180.0


@settings
class SwaySettings:
    """Amplitudes, frequencies and phases of the sines of each axis; empty for a still axis."""

    x_amplitude: tuple[float, ...] = parameter(
        (0.1, 0.02), 'Amplitudes along the rail', unit='m', minimum=0.0, maximum=2.0)
    x_frequency: tuple[float, ...] = parameter(
        (0.11, 0.3), 'Frequencies along the rail', unit='Hz', minimum=0.0, maximum=20.0)
    x_phase: tuple[float, ...] = parameter((0.3, 1.0), 'Phases along the rail', unit='rad')
    y_amplitude: tuple[float, ...] = parameter(
        (0.015,), 'Amplitudes towards the wall', unit='m', minimum=0.0, maximum=2.0)
    y_frequency: tuple[float, ...] = parameter(
        (0.2,), 'Frequencies towards the wall', unit='Hz', minimum=0.0, maximum=20.0)
    y_phase: tuple[float, ...] = parameter((0.5,), 'Phases towards the wall', unit='rad')
    yaw_amplitude: tuple[float, ...] = parameter(
        (2.0 * DEGREE,), 'Amplitudes of the yaw', unit='rad', minimum=0.0, maximum=0.5)
    yaw_frequency: tuple[float, ...] = parameter(
        (0.15,), 'Frequencies of the yaw', unit='Hz', minimum=0.0, maximum=20.0)
    yaw_phase: tuple[float, ...] = parameter((0.0,), 'Phases of the yaw', unit='rad')

    def __post_init__(self) -> None:
        for axis in ('x', 'y', 'yaw'):
            lengths = {len(values) for values in self.sines(axis)}
            if len(lengths) > 1:
                raise ParameterError(
                    f'{axis}_amplitude, {axis}_frequency and {axis}_phase differ in length')

    def sines(self, axis: str) -> tuple[tuple[float, ...], ...]:
        """Return amplitudes, frequencies [Hz] and phases of ``'x'``, ``'y'`` or ``'yaw'``."""
        return tuple(
            getattr(self, f'{axis}_{part}') for part in ('amplitude', 'frequency', 'phase'))


class Sway:
    """
    The disturbance as a function of time.

    Parameters
    ----------
    settings : SwaySettings

    Attributes
    ----------
    amplitudes : numpy.ndarray, shape (3, n)
        Of all sines [m, m, rad], 0 along the axes to which they do not belong.
    rates, phases : numpy.ndarray, shape (n,)
        [rad/s, rad].

    """

    def __init__(self, settings: SwaySettings) -> None:
        sines = [np.array(settings.sines(axis)) for axis in ('x', 'y', 'yaw')]
        axes = np.repeat(np.arange(len(sines)), [part.shape[1] for part in sines])
        amplitudes, frequencies, self.phases = np.concatenate(sines, axis=1)
        self.amplitudes = amplitudes * (axes == np.arange(len(sines))[:, None])
        self.rates = math.tau * frequencies

    def at(self, time: float) -> Pose:
        """Return the pose of the rail in the façade's frame at a time [s]."""
        return Pose(*(self.amplitudes @ np.sin(self.rates * time + self.phases)).tolist())
