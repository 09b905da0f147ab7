"""What the mechanism is, where it is (pose, carriages), and what acts on it (wrench)."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import check_parameters, parameter


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
    """Positions of the carriages A1, A2 and A3 along the rail [m]; on it they stand A1, A3, A2."""

    q1: float
    q2: float
    q3: float


class Wrench(NamedTuple):
    """Forces along x and y and moment about z [N, N, N m]; who names one says on whom."""

    fx: float
    fy: float
    mz: float


@dataclass(frozen=True)
class Geometry:
    """
    Lengths of the mechanism and of its rail.

    Parameters
    ----------
    link_length : float
        l, from a carriage's joint A to the platform's joint B [m].
    platform_half_length : float
        b, from the platform's joint B to the end-effector point P [m].
    stroke : tuple of two floats
        Least and greatest carriage position (q_min, q_max) [m].
    carriage_gap : float
        Least distance m of neighbouring carriages, q3 − q1 ≥ m and q2 − q3 ≥ m [m].

    Raises
    ------
    ParameterError
        If a length is not finite or not positive, or if no carriage positions satisfy them all.

    """

    link_length: float = parameter(
        0.352, 'Length of the two links', unit='m', minimum=1e-3, maximum=100.0, read_only=True)
    platform_half_length: float = parameter(
        0.348, 'Half the length of the platform, joint to end-effector point',
        unit='m', minimum=1e-3, maximum=100.0, read_only=True)
    stroke: tuple[float, float] = parameter(
        (-0.5, 0.5), 'Least and greatest carriage position',
        unit='m', minimum=-100.0, maximum=100.0, read_only=True)
    carriage_gap: float = parameter(
        0.02, 'Least distance of neighbouring carriages',
        unit='m', minimum=0.0, maximum=100.0, read_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'stroke', _stroke(self.stroke))
        for name in ('link_length', 'platform_half_length', 'carriage_gap'):
            object.__setattr__(self, name, _number(name, getattr(self, name)))
        check_parameters(self)
        if self.stroke_length <= 0.0:
            raise ParameterError(
                f'stroke = {self.stroke} m is empty: the second value must exceed the first')
        if 2.0 * self.carriage_gap >= self.stroke_length:
            raise ParameterError(
                f'carriage_gap = {self.carriage_gap:g} m leaves no room for three carriages '
                f'on a stroke of {self.stroke_length:g} m')
        if self.carriage_gap >= self.platform_half_length:
            raise ParameterError(
                f'carriage_gap = {self.carriage_gap:g} m is not below platform_half_length = '
                f'{self.platform_half_length:g} m, so no pose respects it')

    @property
    def stroke_length(self) -> float:
        """Length Q = q_max − q_min of the stroke [m]."""
        return self.stroke[1] - self.stroke[0]


def _number(name: str, value: object) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ParameterError(f'{name} = {value!r} is not a number') from None


def _stroke(value: object) -> tuple[float, float]:
    try:
        least, greatest = value
    except (TypeError, ValueError):
        raise ParameterError(
            f'stroke = {value!r} is not a pair of positions (least, greatest) in m') from None
    return _number('stroke', least), _number('stroke', greatest)


def not_finite(values: Pose | Carriages) -> ParameterError:
    """Say which of `values` is not a finite number, ready to be raised."""
    for name, value in zip(values._fields, values, strict=True):
        if not math.isfinite(value):
            return ParameterError(f'{name} = {value} is not a finite number')
    return ParameterError(f'{tuple(values)} is beyond any machine')
