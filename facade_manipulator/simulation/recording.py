"""Recorded disturbances, played back as a motion."""

from __future__ import annotations

from collections.abc import Iterable
import csv
import math
from pathlib import Path

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.interpolation import catmull_rom

COLUMNS = ('time', 'x', 'y', 'theta')
STEP = 0.01


class Recording:
    """
    A recorded motion, played forth and back for as long as it is asked for.

    Parameters
    ----------
    times : array_like, shape (n,)
        Ascending [s].
    poses : array_like, shape (n, 3)
        Disturbance at these times [m, m, rad].

    Raises
    ------
    ParameterError
        If there are fewer than two samples, or they are not finite or not ascending.

    """

    def __init__(self, times: Iterable[float], poses: Iterable[Iterable[float]]) -> None:
        times, poses = np.array(times, dtype=float), np.array(poses, dtype=float)
        if len(times) < 2:
            raise ParameterError(f'a recording needs 2 samples at least, this has {len(times)}')
        if not (np.isfinite(times).all() and np.isfinite(poses).all()):
            raise ParameterError('the recording has numbers that are not finite')
        if (np.diff(times) <= 0.0).any():
            where = int(np.argmax(np.diff(times) <= 0.0)) + 1
            raise ParameterError(
                f'time must ascend, but sample {where + 1} is at {times[where]:g} s after '
                f'{times[where - 1]:g} s')
        grid = np.arange(times[0], times[-1], STEP)
        self._poses = np.column_stack([np.interp(grid, times, column) for column in poses.T])

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s], counted from the recording's start."""
        last = len(self._poses) - 1
        position = abs(math.remainder(time / STEP, 2.0 * max(last, 1)))
        index = min(int(position), max(last - 1, 0))
        neighbours = self._poses[np.clip(np.arange(index - 1, index + 3), 0, last)]
        return Pose(*catmull_rom(*neighbours, position - index).tolist())


def load_recording(path: Path) -> Recording:
    """
    Read a CSV file with the columns time, x, y and theta [s, m, m, rad].

    Raises
    ------
    ParameterError
        If it cannot be read, lacks a column or has a cell that is no number.

    """
    try:
        with path.open(newline='', encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ParameterError(f'recording {path} cannot be read: {error}') from error
    missing = [name for name in COLUMNS if not rows or rows[0].get(name) is None]
    if missing:
        raise ParameterError(f'recording {path} has no column {", ".join(missing)}')
    try:
        table = np.array([[float(row[name]) for name in COLUMNS] for row in rows])
    except (TypeError, ValueError) as error:
        raise ParameterError(f'recording {path}: {error}') from error
    return Recording(table[:, 0], table[:, 1:])
