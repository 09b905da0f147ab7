"""
Prescribed motions of the gondola as functions of time: sums of sines, spectra, recordings.

What else is known at equidistant samples alone becomes a motion by `catmull_rom`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import math
from pathlib import Path

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.tools.calibration.tables import read_table

DEGREE = math.pi / 180.0
STEP = 0.01  # s, between the samples of a recording
DENSITIES = 'x_density', 'y_density', 'theta_density'  # columns, in m²/Hz and rad²/Hz
Motion = Callable[[float], Pose]  #: the rail in the façade's frame at a time [s]


@settings
class SwaySettings:
    """Amplitudes, frequencies and phases of the sines of each axis; empty for a still axis."""

    x_amplitude: tuple[float, ...] = parameter(
        'Amplitudes along the rail', default=(0.1, 0.02), unit='m', minimum=0.0, maximum=2.0)
    x_frequency: tuple[float, ...] = parameter(
        'Frequencies along the rail', default=(0.11, 0.3), unit='Hz', minimum=0.0, maximum=20.0)
    x_phase: tuple[float, ...] = parameter('Phases along the rail', default=(0.3, 1.0), unit='rad')
    y_amplitude: tuple[float, ...] = parameter(
        'Amplitudes towards the wall', default=(0.015,), unit='m', minimum=0.0, maximum=2.0)
    y_frequency: tuple[float, ...] = parameter(
        'Frequencies towards the wall', default=(0.2,), unit='Hz', minimum=0.0, maximum=20.0)
    y_phase: tuple[float, ...] = parameter('Phases towards the wall', default=(0.5,), unit='rad')
    yaw_amplitude: tuple[float, ...] = parameter(
        'Amplitudes of the yaw', default=(2.0 * DEGREE,), unit='rad', minimum=0.0, maximum=0.5)
    yaw_frequency: tuple[float, ...] = parameter(
        'Frequencies of the yaw', default=(0.15,), unit='Hz', minimum=0.0, maximum=20.0)
    yaw_phase: tuple[float, ...] = parameter('Phases of the yaw', default=(0.0,), unit='rad')

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
    """The disturbance as a function of time: n sines [m, m, rad; rad/s, rad]."""

    def __init__(self, settings: SwaySettings) -> None:
        sines = [np.array(settings.sines(axis)) for axis in ('x', 'y', 'yaw')]
        axes = np.repeat(np.arange(len(sines)), [part.shape[1] for part in sines])
        amplitudes, frequencies, self.phases = np.concatenate(sines, axis=1)
        #: shape (3, n), 0 along the axes to which a sine does not belong
        self.amplitudes = amplitudes * (axes == np.arange(len(sines))[:, None])
        self.rates = math.tau * frequencies

    def at(self, time: float) -> Pose:
        """Return the pose of the rail in the façade's frame at a time [s]."""
        return Pose(*(self.amplitudes @ np.sin(self.rates * time + self.phases)).tolist())


def catmull_rom(
    neighbours: Sequence[np.ndarray] | np.ndarray, share: float
) -> np.ndarray:
    """Interpolate between the inner two of four points, from the one to the other as `share`."""
    before, here, there, after = neighbours
    slope, next_slope = 0.5 * (there - before), 0.5 * (after - here)
    chord = there - here
    square = 3.0 * chord - 2.0 * slope - next_slope
    cube = slope + next_slope - 2.0 * chord
    return here + share * (slope + share * (square + share * cube))


def recording(times: Iterable[float], poses: Iterable[Iterable[float]]) -> Motion:
    """
    Return a recorded motion, played forth and back for as long as it is asked for.

    Poses are of the shape (n, 3) [m, m, rad]. Raises a ParameterError if there are fewer than two
    samples, or their times [s] do not ascend.
    """
    times, poses = np.array(times, dtype=float), np.array(poses, dtype=float)
    if len(times) < 2:
        raise ParameterError(f'a recording needs 2 samples at least, this has {len(times)}')
    if (np.diff(times) <= 0.0).any():
        where = int(np.argmax(np.diff(times) <= 0.0)) + 1
        raise ParameterError(
            f'time must ascend, but sample {where + 1} is at {times[where]:g} s after '
            f'{times[where - 1]:g} s')
    grid = np.arange(times[0], times[-1], STEP)
    even = np.column_stack([np.interp(grid, times, column) for column in poses.T])
    last = len(even) - 1

    def at(time: float) -> Pose:
        position = abs(math.remainder(time / STEP, 2.0 * max(last, 1)))
        index = min(int(position), max(last - 1, 0))
        neighbours = even[np.clip(np.arange(index - 1, index + 3), 0, last)]
        return Pose(*catmull_rom(neighbours, position - index).tolist())

    return at


def load_recording(path: Path) -> Motion:
    """
    Read a CSV file with the columns time, x, y and theta.

    Raises a CalibrationError as `calibration.read_table`, and a ParameterError as `recording`.
    """
    table = read_table(path, ('time', 'x', 'y', 'theta'))
    return recording(table[:, 0], table[:, 1:])


def spectrum(
    frequencies: Iterable[float], densities: Iterable[Iterable[float]], seed: int
) -> Motion:
    """
    Return a motion with given power at each frequency [Hz]: a sine for each row of densities.

    These are one-sided, of the shape (n, 3) [m²/Hz, m²/Hz, rad²/Hz]. Phases and where in its row's
    share of the frequencies each sine is are by chance. Raises a ParameterError if there are fewer
    than two rows, frequencies do not ascend from above 0 or a density is negative.
    """
    rows, power = np.array(frequencies, dtype=float), np.array(densities, dtype=float).T
    _check_spectrum(rows, power)
    middles = 0.5 * (rows[1:] + rows[:-1])
    edges = np.concatenate(([rows[0]], middles, [rows[-1]]))
    random = np.random.default_rng(seed)
    rates = math.tau * (edges[:-1] + np.diff(edges) * random.random(power.shape))
    amplitudes = np.sqrt(2.0 * power * np.diff(edges))
    phases = random.uniform(0.0, math.tau, power.shape)
    return lambda time: Pose(
        *(amplitudes * np.cos(rates * time + phases)).sum(axis=1).tolist())


def _check_spectrum(frequencies: np.ndarray, power: np.ndarray) -> None:
    if len(frequencies) < 2:
        raise ParameterError(f'a spectrum needs 2 rows at least, this has {len(frequencies)}')
    steps = np.diff(frequencies, prepend=0.0)
    if (steps <= 0.0).any():
        row = int(np.argmax(steps <= 0.0))
        raise ParameterError(f'frequency must ascend from above 0 Hz, but row {row + 1} has '
                             f'{frequencies[row]:g} Hz')
    if (power < 0.0).any():
        axis, column = divmod(int(np.argmin(power)), len(frequencies))
        raise ParameterError(f'{DENSITIES[axis]} = {power.min():g} in row {column + 1} is below '
                             'its minimum 0')


def load_spectrum(path: Path, seed: int) -> Motion:
    """
    Read a CSV file with the columns frequency and `DENSITIES`.

    Raises a CalibrationError as `calibration.read_table`, and a ParameterError as `spectrum`.
    """
    table = read_table(path, ('frequency', *DENSITIES))
    return spectrum(table[:, 0], table[:, 1:], seed)
