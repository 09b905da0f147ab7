"""What of the head is measured, its pose or points on it, and what is looked for with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.tools.calibration.design import Noise
from facade_manipulator.tools.calibration.robust_fit import OUTLIER
from facade_manipulator.tools.calibration.unknowns import (
    AXES,
    DEG,
    MeasuredGeometry,
    MM,
    placed,
    Unknown,
    UNKNOWNS,
)


class Target:
    """The head itself: x, y and θ, or some of them."""

    def __init__(self, columns: Sequence[str] = AXES) -> None:
        self.columns = tuple(columns)  #: of a table
        self.axes = np.isin(AXES, columns)  #: which are known of the pose, shape (3,)
        #: in which units a person says them, and the factors from SI
        self.units = [DEG if name == 'theta' else MM for name in columns]

    def seen_on(self, geometry: Geometry) -> Geometry:
        """Return the machine whose `heads` are what is measured."""
        return geometry

    def noise(self, one: Noise) -> Noise:
        """Return how well the pose is known where each number is known so well."""
        return one

    def pose(self, numbers: np.ndarray, noise: Noise) -> np.ndarray:
        """Return x, y and θ of the numbers of the columns, NaN what does not follow."""
        return np.array([numbers[self.columns.index(name)] if name in self.columns else np.nan
                         for name in AXES])


class Points(Target):
    """Two or three points on the head; the pose is that of their middle: independent errors."""

    def __init__(self, on_head: Sequence[float]) -> None:
        """Take x and y of each point in the frame of the head [m]."""
        if len(on_head) not in (4, 6):
            raise ParameterError(
                f'{len(on_head)} numbers are not x and y of two or three points')
        super().__init__([f'{axis}{k}' for k in range(1, len(on_head) // 2 + 1) for axis in 'xy'])
        self.axes = np.full(len(AXES), fill_value=True)
        self._middle, self._arms = _about_middle(np.array(on_head))

    def seen_on(self, geometry: Geometry) -> Geometry:
        """Return the machine whose `heads` are the points' middle."""
        return MeasuredGeometry(
            **vars(geometry), target=(self._middle.real, self._middle.imag, 0.0))

    def noise(self, one: Noise) -> Noise:
        """Return how well middle and direction are known."""
        spread = max(float(np.linalg.norm(self._arms)), 1e-9)  # m, of which no angle follows
        return Noise(one.position / np.sqrt(len(self._arms)), one.position / spread)

    def pose(self, numbers: np.ndarray, noise: Noise) -> np.ndarray:
        """Return the pose of the middle; NaN where a number is missing."""
        middle, arms = _about_middle(numbers)
        turn, bound = np.angle(np.vdot(self._arms, arms)), OUTLIER * noise.position
        off = np.abs(arms - self._arms * np.exp(1j * turn)).max()
        if off > bound:
            raise CalibrationError(f'the points do not lie as on the head: one is {1e3 * off:.3g} '
                                   f'mm off, above the bound {1e3 * bound:.3g} mm')
        return np.array([middle.real, middle.imag, turn])


def _about_middle(numbers: np.ndarray) -> tuple[complex, np.ndarray]:
    """Return the middle of points and the points from there, as complex numbers x + iy."""
    points = numbers[::2] + 1j * numbers[1::2]
    return complex(points.mean()), points - points.mean()


class Sought(NamedTuple):
    """What a calibration of the geometry looks for, and how the head is measured for it."""

    geometry: Geometry  #: whose `heads` are what is measured
    unknowns: tuple[Unknown, ...] = UNKNOWNS
    target: Target = Target()
    number_noise: Noise = Noise()  #: of what is measured
    has_frame: bool = False  #: whether the instrument's frame is one of the unknowns

    @property
    def noise(self) -> Noise:
        """Return how well the pose is known."""
        return self.target.noise(self.number_noise)

    def machine(self, carriages: np.ndarray, seen: np.ndarray) -> Geometry:
        """Return the machine, seen from about where the instrument stands."""
        return placed(self.geometry, carriages, seen) if self.has_frame else self.geometry
