"""What a calibration may look for, as one vector: the errors of a machine first of all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
import math
from typing import Any, NamedTuple, TypeVar

import numpy as np

from facade_manipulator.errors import CalibrationError, LimitError, ParameterError
from facade_manipulator.kinematics import (
    add,
    Carriages,
    compose,
    difference,
    Geometry,
    invert,
    Mechanism,
    mechanism_of,
    Pose,
)
from facade_manipulator.parameters import parameter, settings

STEP = 1e-6
AXES = ('x', 'y', 'theta')  # of the head
MM, DEG = ('mm', 1e3), ('deg', 180.0 / np.pi)  # as people read them, from SI
UNITS = MM, MM, DEG  # of the head
Settings = TypeVar('Settings')


class Unknown(NamedTuple):
    """One number of settings, such as a Geometry, in m, rad or s."""

    field: str  #: of the settings
    #: element of that field
    index: int | None  # type: ignore[assignment]  # hides tuple.index
    words: str  #: what it is, for a technician
    tolerance: float  #: standard deviation with which it is known beforehand
    unit: tuple[str, float] = MM  #: in which people read it, and the factor from SI
    accepted: float = math.inf  #: greatest standard deviation with which it counts as found
    least: float = -math.inf  #: value

    @property
    def name(self) -> str:
        """Name as on the command line: ``link_errors.0``."""
        return self.field if self.index is None else f'{self.field}.{self.index}'

    def known(self, value: float, deviation: float, digits: int = 2) -> str:
        """Return value and standard deviation as people read them."""
        unit, factor = self.unit
        return f'{value * factor:+9.{digits}f} +- {deviation * factor:.{digits}f} {unit}'

    def blind(self, deviation: float, of: str = '') -> str:
        """Return what is not found, and to what alone it is known; '' if that is accepted."""
        unit, factor = self.unit
        return '' if deviation <= self.accepted else (
            f'{of}{self.words} (+- {deviation * factor:.3g} {unit})')


UNKNOWNS = (
    Unknown('link_errors', 0, 'length of link 1', 2e-3),
    Unknown('link_errors', 1, 'length of link 2', 2e-3),
    Unknown('platform_errors', 0, 'platform from B1 to P', 2e-3),
    Unknown('platform_errors', 1, 'platform from P to B2', 2e-3),
    Unknown('carriage_offsets', 0, 'offset of carriage q1', 5e-3),
    Unknown('carriage_offsets', 1, 'offset of carriage q2', 5e-3),
    Unknown('carriage_offsets', 2, 'offset of carriage q3', 5e-3),
    Unknown('rail_angle', None, 'angle of the rail', 0.02, DEG),
    Unknown('tool', 0, 'x of the head on the platform', 5e-3),
    Unknown('tool', 1, 'y of the head on the platform', 5e-3),
    Unknown('tool', 2, 'angle of the head on the platform', 0.02, DEG),
    Unknown('slide_angle', None, 'squareness of the middle slide', 5e-3, DEG),
    Unknown('rail_bow', None, 'bow of the rail', 1e-3),
)
SHAPE = 'slide_angle', 'rail_bow'  # looked for only where the measurements can tell them
BACKLASH = tuple(
    Unknown('backlash', k, f'backlash of the screw of {name}', 2e-4, least=0.0)
    for k, name in enumerate(Carriages._fields))
INSTRUMENT = (
    Unknown('instrument', 0, "x of the rail in the instrument's frame", 0.02),
    Unknown('instrument', 1, "y of the rail in the instrument's frame", 0.02),
    Unknown('instrument', 2, "angle of the rail in the instrument's frame", 0.05, DEG),
)
OF_FRAME = 'rail_angle', 'carriage_offsets.2'  # by these the carriages differ from frame rail
SCREW_TOLERANCE = 2e-4  # m
MOST_ENTRIES = 100  # of a screw's table: one a centimetre, and nobody measures so many poses


@settings
class MeasuredGeometry(Geometry):
    """A machine in the frame of the instrument that measures its head."""

    instrument: tuple[float, ...] = parameter(
        'x, y and angle of the rail in the frame of the instrument', default=(0.0, 0.0, 0.0),
        unit='m, m, rad', minimum=-1e3, maximum=1e3)
    target: tuple[float, ...] = parameter(
        'What is measured of the head: a pose in its frame', default=(0.0, 0.0, 0.0),
        unit='m, m, rad', minimum=-0.5, maximum=0.5)


def in_rail(geometry: Geometry) -> Geometry:
    """Return the machine alone: `heads` are then those of the head in frame rail."""
    return Geometry(**{one.name: getattr(geometry, one.name) for one in fields(Geometry)})


def screw_unknowns(geometry: Geometry) -> tuple[Unknown, ...]:
    """Return every entry of the tables of the screws."""
    return tuple(
        Unknown(f'screw_errors_{name}', k, f'screw of {name}, error at {position:+.3f} m',
                SCREW_TOLERANCE)
        for name, table in zip(Carriages._fields, geometry.screw_errors, strict=True)
        for k, position in enumerate(np.linspace(*geometry.screw_span, len(table))))


def with_screw_tables(geometry: Geometry, entries: int) -> Geometry:
    """
    Return the geometry with tables of so many entries for its screws, which say the same.

    Raises a ParameterError for fewer than two, and for more than `MOST_ENTRIES`.
    """
    if not 2 <= entries <= MOST_ENTRIES:
        raise ParameterError(
            f'a table of {entries} entries for a screw: 2 are the least, {MOST_ENTRIES} the most')
    positions = np.linspace(*geometry.screw_span, entries)
    tables: dict[str, Any] = {
        f'screw_errors_{name}': tuple(np.interp(
            positions, np.linspace(*geometry.screw_span, len(table)), table).tolist())
        for name, table in zip(Carriages._fields, geometry.screw_errors, strict=True)}
    return replace(geometry, **tables)


def unknowns_named(names: Sequence[str]) -> tuple[Unknown, ...]:
    """
    Return unknowns by their names or those of their fields; all of them for no name.

    Raises a ParameterError for a name that none has.
    """
    known = {unknown.name for unknown in UNKNOWNS} | {unknown.field for unknown in UNKNOWNS}
    for name in names:
        if name not in known:
            raise ParameterError(f'{name} is not one of {", ".join(sorted(known))}')
    return tuple(u for u in UNKNOWNS if not names or u.name in names or u.field in names)


def values_of(settings: Any, unknowns: Iterable[Unknown]) -> np.ndarray:
    """Return what settings say of unknowns, shape (m,)."""
    return np.array([
        value if u.index is None else value[u.index]
        for u in unknowns for value in [getattr(settings, u.field)]])


def with_values(
    settings: Settings, unknowns: Iterable[Unknown], values: Iterable[float]
) -> Settings:
    """Return settings with other values of unknowns."""
    fields: dict[str, Any] = {}
    for unknown, value in zip(unknowns, values, strict=True):
        if unknown.index is None:
            fields[unknown.field] = float(value)
        else:
            fields.setdefault(unknown.field, list(getattr(settings, unknown.field)))
            fields[unknown.field][unknown.index] = float(value)
    return replace(settings, **{  # type: ignore[type-var]  # a dataclass
        name: tuple(value) if isinstance(value, list) else value
        for name, value in fields.items()})


def with_instrument(
    geometry: Geometry, unknowns: Iterable[Unknown]
) -> tuple[Geometry, tuple[Unknown, ...]]:
    """
    Return a machine and its unknowns for an instrument that stands somewhere.

    Frame rail is then that of the carriages: q3 shows its x, the line of their joints its angle.
    Where the head stands is known in the frame of the instrument; of frame rail alone the middle
    of the platform says where it is, to a millimetre.
    """
    return MeasuredGeometry(**vars(geometry)), (
        *(one for one in unknowns if one.name not in OF_FRAME), *INSTRUMENT)


def head_at(
    mechanism: Mechanism, q1: float, q2: float, q3: float, direction: float = 0.0
) -> Pose:
    """
    Return where the head stands with the drives at positions [m].

    The direction is 1 if the carriages arrived towards greater x, -1 if towards less: they rest on
    that flank of their screws; 0 if it is not known. Raises a LimitError if the links cannot be
    joined there.
    """
    return mechanism.forward_kinematics(mechanism.take_up(
        Carriages(q1, q2, q3), Carriages(-direction, -direction, -direction)))


def heads(geometry: Geometry, carriages: np.ndarray) -> np.ndarray:
    """
    Return where the head stands, shape (n, 3); NaN where the links cannot be joined.

    It stands in frame rail; of a MeasuredGeometry that is the target, in the instrument's frame.
    Carriages have the shape (n, 3) or (n, 4): positions [m], and the direction of `head_at`.
    """
    mechanism, out = mechanism_of(geometry), np.full((len(carriages), 3), np.nan)
    measured = geometry if isinstance(geometry, MeasuredGeometry) else MeasuredGeometry()
    frame, target = Pose(*measured.instrument), Pose(*measured.target)
    for row, station in enumerate(carriages.tolist()):
        try:
            out[row] = compose(compose(frame, head_at(mechanism, *station)), target)
        except LimitError:
            continue
    return out


def off_by(seen: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Return heads less other heads, angles the short way, shape (n, 3)."""
    off = seen - expected
    off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return off


def placed(geometry: Geometry, carriages: np.ndarray, seen: np.ndarray) -> Geometry:
    """
    Return a machine of `with_instrument` with the instrument about where heads say it stands.

    That is the median of the heads that are wholly measured; without one it is as it was.
    """
    frames = [compose(Pose(*there), invert(Pose(*here))) for there, here in zip(
        seen, heads(geometry, carriages), strict=True) if np.isfinite([*there, *here]).all()]
    if not frames:
        return geometry
    off = np.median([difference(one, frames[0]) for one in frames], axis=0).tolist()
    stands = tuple(add(frames[0], Pose(*off)))
    return replace(geometry, instrument=stands)  # type: ignore[call-arg]


def in_units(pose: Iterable[float]) -> str:
    """Return what is said of x, y and θ as people read it."""
    return ', '.join(f'{value * factor:.2g} {unit}' for value, (unit, factor) in zip(
        pose, UNITS, strict=True))


def require_closed(joined: np.ndarray, carriages: np.ndarray) -> None:
    """Raise a CalibrationError that names the first row, from 1, of which `heads` has no pose."""
    for row in np.flatnonzero(np.isnan(joined).any(axis=1)):
        q = ', '.join(f'{value:g}' for value in carriages[row, :3])
        raise CalibrationError(f'row {row + 1}: the links do not close at ({q}) m')


def sensitivity(
    geometry: Geometry, unknowns: Sequence[Unknown], carriages: np.ndarray
) -> np.ndarray:
    """
    Return how the head moves with each unknown, ∂(x, y, θ)/∂unknowns, shape (n, 3, m).

    By central differences: the identification Jacobian of the literature.
    """
    values = values_of(geometry, unknowns)
    least = np.array([unknown.least for unknown in unknowns])
    out = np.empty((len(carriages), 3, len(unknowns)))
    for k, step in enumerate(STEP * np.eye(len(unknowns))):
        ahead, back = values + step, np.maximum(values - step, least)
        out[:, :, k] = (heads(with_values(geometry, unknowns, ahead), carriages) - heads(
            with_values(geometry, unknowns, back), carriages)) / (ahead - back)[k]
    return out
