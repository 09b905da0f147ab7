"""Poses, carriages and wrenches, and the dimensions of the mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
import math
from typing import Any, NamedTuple, TYPE_CHECKING

from facade_manipulator.errors import compared, ParameterError
from facade_manipulator.parameters import parameter, settings

if TYPE_CHECKING:
    from facade_manipulator.kinematics.mechanism import Mechanism


class Pose(NamedTuple):
    """Pose of the end-effector point P: x along the rail, y out towards the façade [m, rad]."""

    x: float
    y: float
    theta: float


class Twist(NamedTuple):
    """Velocity in the plane: rates of x, y and θ [m/s, m/s, rad/s]."""

    x: float
    y: float
    theta: float


class Carriages(NamedTuple):
    """Positions of the carriages along the rail [m]; their order on the rail is A1, A3, A2."""

    q1: float
    q2: float
    q3: float


class Wrench(NamedTuple):
    """Forces along x and y [N] and moment about z [N m]; users state the loaded body."""

    fx: float
    fy: float
    mz: float


AXIS_NAMES = Carriages._fields
#: a value of each carriage in the order of `AXIS_NAMES`, such as `Carriages`
PerCarriage = Sequence[float]
# lengths l1, l2, b1 and b2 [m]: of the links, and from P to the joints B1 and B2 of the platform.
# A plain tuple is unpacked in half the time of a named tuple.
Sides = tuple[float, float, float, float]
GRAVITY = 9.81  # m/s²


def _error(default: tuple[float, ...], description: str, **info: Any) -> Any:
    """Declare a parameter for differences of lengths between machine and drawing [m]."""
    return parameter(
        description, default=default, unit='m', minimum=-0.05, maximum=0.05, **info
    )


@settings
class Geometry:
    """
    Dimensions of the mechanism and of its rail.

    Notes
    -----
    In formulas, l is `link_length`, b is `platform_half_length`, and the stroke is q_min to q_max.
    Functions that take a Geometry use only l and b, as on the drawing. `Mechanism` also uses all
    errors: the position of a carriage on the rail is its drive's position plus its offset.

    Raises
    ------
    ParameterError
        If a length is not finite or not positive, or if no carriage positions satisfy all limits.

    """

    link_length: float = parameter(
        'Length of the two links', default=0.352, unit='m', minimum=1e-3, maximum=100.0
    )
    platform_half_length: float = parameter(
        'Half the length of the platform, from joint to end-effector point',
        default=0.348,
        unit='m',
        minimum=1e-3,
        maximum=100.0,
    )
    stroke: tuple[float, float] = parameter(
        'Minimum and maximum position of the carriages',
        default=(-0.5, 0.5),
        unit='m',
        minimum=-100.0,
        maximum=100.0,
        elements=('minimum', 'maximum'),
    )
    carriage_gap: float = parameter(
        'Minimum distance between neighbouring carriages',
        default=0.02,
        unit='m',
        minimum=0.0,
        maximum=100.0,
    )
    carriage_length: float = parameter(
        'Distance between neighbouring carriages at which they touch',
        default=0.0,
        unit='m',
        minimum=0.0,
        maximum=100.0,
    )
    link_errors: tuple[float, ...] = _error(
        (0.0, 0.0), 'Excess of each link over link_length', elements=('A1', 'A2')
    )
    platform_errors: tuple[float, ...] = _error(
        (0.0, 0.0),
        'Excess of each half over platform_half_length',
        elements=('B1', 'B2'),
    )
    carriage_offsets: tuple[float, ...] = _error(
        (0.0, 0.0, 0.0), 'Position on the rail at drive position 0', elements=AXIS_NAMES
    )
    rail_angle: float = parameter(
        'Angle of the real rail in frame rail',
        default=0.0,
        unit='rad',
        minimum=-0.2,
        maximum=0.2,
    )
    tool: tuple[float, ...] = parameter(
        'Pose of the head on the platform: x, y, theta',
        default=(0.0, 0.0, 0.0),
        unit='m, m, rad',
        minimum=-0.5,
        maximum=0.5,
        elements=Pose._fields,
    )

    def __post_init__(self) -> None:
        if self.stroke_length <= 0.0:
            raise ParameterError(
                f'stroke = {self.stroke} m is empty; next: set a second value above the first'
            )
        if 2.0 * self.carriage_gap >= self.stroke_length:
            raise ParameterError(
                f'carriage_gap = {self.carriage_gap:g} m leaves no room for three carriages '
                f'on a stroke of {self.stroke_length:g} m; next: reduce carriage_gap'
            )
        if self.carriage_length > self.carriage_gap:
            length, gap = compared(self.carriage_length, self.carriage_gap)
            raise ParameterError(
                f'carriage_length = {length} m is above carriage_gap = {gap} m, at which '
                'carriages would touch; next: increase carriage_gap'
            )
        if self.carriage_gap >= self.platform_half_length:
            gap, half = compared(self.carriage_gap, self.platform_half_length)
            raise ParameterError(
                f'carriage_gap = {gap} m is not below platform_half_length = {half} m, so that '
                'no pose keeps this gap; next: reduce it'
            )

    @property
    def stroke_length(self) -> float:
        """Return the stroke length Q = q_max − q_min [m]."""
        return self.stroke[1] - self.stroke[0]

    @property
    def link_lengths(self) -> tuple[float, ...]:
        """Return the manufactured link lengths on the sides of A1 and A2 [m]."""
        return tuple(self.link_length + error for error in self.link_errors)

    @property
    def half_lengths(self) -> tuple[float, ...]:
        """Return the manufactured distances from P to the platform joints B1 and B2 [m]."""
        return tuple(
            self.platform_half_length + error for error in self.platform_errors
        )

    @property
    def sides(self) -> Sides:
        """Return the manufactured lengths l1, l2, b1 and b2 [m]."""
        link1, link2 = self.link_lengths
        half1, half2 = self.half_lengths
        return link1, link2, half1, half2

    @cached_property
    def drawn(self) -> Mechanism:
        """Return the nominal mechanism, without errors; the geometry caches it."""
        from facade_manipulator.kinematics.mechanism import Mechanism

        return Mechanism(
            Geometry(
                self.link_length,
                self.platform_half_length,
                self.stroke,
                self.carriage_gap,
                self.carriage_length,
            )
        )


def not_finite_error(values: Pose | Carriages) -> ParameterError:
    """Return the error for the first of `values` that is not finite."""
    for name, value in zip(values._fields, values, strict=True):
        if not math.isfinite(value):
            return ParameterError(
                f'{name} = {value} is not a finite number; next: send a number'
            )
    return ParameterError(
        f'{tuple(values)} exceeds the size of any machine; next: send metres and radians'
    )
