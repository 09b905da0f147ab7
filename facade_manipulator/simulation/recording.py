"""Recorded disturbances, played back as a motion."""

from __future__ import annotations

from collections.abc import Iterable
import math
from pathlib import Path

import numpy as np

from facade_manipulator.calibration import read_table
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.motion import catmull_rom

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
        If there are fewer than two samples, or their times do not ascend.

    """

    def __init__(self, times: Iterable[float], poses: Iterable[Iterable[float]]) -> None:
        times, poses = np.array(times, dtype=float), np.array(poses, dtype=float)
        if len(times) < 2:
            raise ParameterError(f'a recording needs 2 samples at least, this has {len(times)}')
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
    Read a CSV file with the columns time, x, y and theta, as `calibration.read_table`.

    Raises
    ------
    CalibrationError
        If it cannot be read, lacks a column or has a cell that is no number.
    ParameterError
        If it is no recording.

    """
    table = read_table(path, ('time', 'x', 'y', 'theta'))
    return Recording(table[:, 0], table[:, 1:])
