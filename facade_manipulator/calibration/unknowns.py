"""What a calibration of the geometry may look for: the errors of a machine as one vector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of

STEP = 1e-6


class Unknown(NamedTuple):
    """
    One number of a Geometry.

    Parameters
    ----------
    field : str
        Field of `Geometry`.
    index : int or None
        Element of that field.
    words : str
        What it is, for a technician.
    tolerance : float
        Standard deviation with which the drawing states it [m or rad].

    """

    field: str
    index: int | None
    words: str
    tolerance: float

    @property
    def name(self) -> str:
        """Name as on the command line: ``link_errors.0``."""
        return self.field if self.index is None else f'{self.field}.{self.index}'

    @property
    def is_angle(self) -> bool:
        """Whether it is in rad."""
        return self.field == 'rail_angle' or self.name == 'tool.2'


UNKNOWNS = (
    Unknown('link_errors', 0, 'length of link 1', 2e-3),
    Unknown('link_errors', 1, 'length of link 2', 2e-3),
    Unknown('platform_errors', 0, 'platform from B1 to P', 2e-3),
    Unknown('platform_errors', 1, 'platform from P to B2', 2e-3),
    Unknown('carriage_offsets', 0, 'offset of carriage q1', 5e-3),
    Unknown('carriage_offsets', 1, 'offset of carriage q2', 5e-3),
    Unknown('carriage_offsets', 2, 'offset of carriage q3', 5e-3),
    Unknown('rail_angle', None, 'angle of the rail', 0.02),
    Unknown('tool', 0, 'x of the head on the platform', 5e-3),
    Unknown('tool', 1, 'y of the head on the platform', 5e-3),
    Unknown('tool', 2, 'angle of the head on the platform', 0.02),
)


def unknowns_named(names: Sequence[str]) -> tuple[Unknown, ...]:
    """
    Return unknowns by their names or those of their fields; all of them for no name.

    Raises
    ------
    ParameterError
        For a name that none has.

    """
    known = {unknown.name for unknown in UNKNOWNS} | {unknown.field for unknown in UNKNOWNS}
    for name in names:
        if name not in known:
            raise ParameterError(f'{name} is none of {", ".join(sorted(known))}')
    return tuple(u for u in UNKNOWNS if not names or u.name in names or u.field in names)


def values_of(geometry: Geometry, unknowns: Sequence[Unknown]) -> np.ndarray:
    """Return what a geometry says of unknowns, shape (m,)."""
    return np.array([
        value if u.index is None else value[u.index]
        for u in unknowns for value in [getattr(geometry, u.field)]])


def with_values(
    geometry: Geometry, unknowns: Sequence[Unknown], values: Sequence[float]
) -> Geometry:
    """Return a geometry with other values of unknowns."""
    fields: dict[str, float | list[float]] = {}
    for unknown, value in zip(unknowns, values, strict=True):
        if unknown.index is None:
            fields[unknown.field] = float(value)
        else:
            fields.setdefault(unknown.field, list(getattr(geometry, unknown.field)))
            fields[unknown.field][unknown.index] = float(value)
    return replace(geometry, **fields)


def heads(geometry: Geometry, carriages: np.ndarray) -> np.ndarray:
    """Return where the head stands, shape (n, 3); NaN where the links cannot be joined."""
    mechanism, out = mechanism_of(geometry), np.full(carriages.shape, np.nan)
    for row, positions in enumerate(carriages.tolist()):
        try:
            out[row] = mechanism.forward_kinematics(Carriages(*positions))
        except LimitError:
            continue
    return out


def sensitivity(
    geometry: Geometry, unknowns: Sequence[Unknown], carriages: np.ndarray
) -> np.ndarray:
    """
    Return how the head moves with each unknown, ∂(x, y, θ)/∂unknowns, shape (n, 3, m).

    By central differences: the identification Jacobian of the literature.
    """
    values = values_of(geometry, unknowns)
    out = np.empty((len(carriages), 3, len(unknowns)))
    for k, step in enumerate(STEP * np.eye(len(unknowns))):
        ahead, back = (heads(with_values(geometry, unknowns, values + sign * step), carriages)
                       for sign in (1.0, -1.0))
        out[:, :, k] = (ahead - back) / (2.0 * STEP)
    return out
