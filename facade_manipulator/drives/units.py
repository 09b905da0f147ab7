"""Conversion between SI units of a carriage and the units of its drive."""

from __future__ import annotations

from functools import cached_property
import math
from typing import NamedTuple

from facade_manipulator.errors import InputError, LimitError, ParameterError
from facade_manipulator.parameters import parameter, settings

INT32_MIN, INT32_MAX, UINT32_MAX = -(2**31), 2**31 - 1, 2**32 - 1

COUNTS = 0x00B50000  # of 60A8h, the unit of positions


class VelocityUnit(NamedTuple):
    """A velocity unit of a drive, and the codes by which the drive names it (CiA 303-2)."""

    counted: str  #: what it counts
    factor: float  #: how many of it are one counted thing per second
    velocity: int  #: 60A9h
    acceleration: int  #: 60AAh


# per what, how many a second of it, and the codes of 60A9h and 60AAh (CiA 402-2)
VELOCITY_UNITS = {
    'counts_per_second': VelocityUnit('count', 1.0, 0x00B50300, 0x00B55700),
    'tenths_of_counts_per_second': VelocityUnit('count', 10.0, 0xFFB50300, 0xFFB55700),
    'tens_of_counts_per_second': VelocityUnit('count', 0.1, 0x01B50300, 0x01B55700),
    'rpm': VelocityUnit('revolution', 60.0, 0x00B44700, 0x00C00300),
    'milli_rpm': VelocityUnit('revolution', 60.0e3, 0xFDB44700, 0xFDC00300),
    'millimetres_per_second': VelocityUnit('metre', 1e3, 0xFD010300, 0xFD015700),
    'micrometres_per_second': VelocityUnit('metre', 1e6, 0xFA010300, 0xFA015700),
    'tenth_micrometres_per_second': VelocityUnit('metre', 1e7, 0xF9010300, 0xF9015700),
}


class SiPerUnit(NamedTuple):
    """What one unit of the drive's is, for each that `Measured` names."""

    position: float  #: [m]
    velocity: float  #: [m/s]
    force: float  #: [N]
    following_error: float  #: [m]


class Measured(NamedTuple):
    """What a drive measures, of the carriage along the rail; None for what it does not send."""

    position: float | None = None  #: [m]
    velocity: float | None = None  #: [m/s]
    force: float | None = None  #: that of the motor's torque [N]
    following_error: float | None = None  #: demand minus actual position [m]


@settings
class AxisScale:
    """
    Motor, gear and ball screw of one axis: metres to counts and torque to force.

    Counts per metre are 4·ppr·gear/lead, the carriage force is τ = 2π η T·gear/lead.

    """

    pulses_per_revolution: int = parameter(
        'Encoder lines per revolution of the motor; a line gives four counts', default=500,
        minimum=1, maximum=2**28)
    gear_ratio: float = parameter(
        'Revolutions of the motor per revolution of the screw', default=4.3,
        minimum=1e-3, maximum=1000.0)
    lead: float = parameter(
        'Travel of the carriage per revolution of the screw', default=0.02, unit='m',
        minimum=1e-4, maximum=1.0)
    direction: int = parameter(
        '1: positive counts move the carriage to positive q; -1: the other way round', default=1,
        minimum=-1, maximum=1)
    rated_torque: float = parameter(
        'Rated torque of the motor', default=0.0545, unit='N m', minimum=1e-6, maximum=1000.0)
    efficiency: float = parameter(
        'Efficiency of gear and screw together', default=0.8, minimum=0.01, maximum=1.0)
    velocity_unit: str = parameter(
        'Unit in which the drive states velocities', default='counts_per_second',
        choices=tuple(VELOCITY_UNITS))
    profile_counts: int = 0  #: counts per revolution by the drive's profile; 0: 4·ppr
    acceleration_unit: str = ''  #: by the drive's profile, per second; '': the velocity unit

    def __post_init__(self) -> None:
        if self.direction == 0:
            raise ParameterError('direction = 0 is neither 1 nor -1')

    @cached_property
    def counts_per_metre(self) -> float:
        """Counts per metre of carriage travel; its sign is the direction's."""
        return self.direction * self.counts_per_revolution * self.gear_ratio / self.lead

    @property
    def counts_per_revolution(self) -> int:
        """Counts per revolution of the motor."""
        return self.profile_counts or 4 * self.pulses_per_revolution

    @cached_property
    def velocity_units_per_count(self) -> float:
        """Velocity units of the drive per count/s."""
        unit = VELOCITY_UNITS[self.velocity_unit]
        counts = {'count': 1.0, 'revolution': self.counts_per_revolution,
                  'metre': abs(self.counts_per_metre)}
        return unit.factor / counts[unit.counted]

    @cached_property
    def force_per_torque_unit(self) -> float:
        """Carriage force in N per thousandth of the rated torque; its sign is the direction's."""
        return (self.direction * 2.0 * math.pi * self.efficiency * self.gear_ratio / self.lead
                * self.rated_torque / 1000.0)

    def to_counts(self, position: float) -> int:
        """
        Return the counts of a position in m.

        Raises an InputError if it is not a finite number, a LimitError if it does not fit
        into the 32 bits of the drive.
        """
        return _rounded('position', position * self.counts_per_metre, 'counts')

    def to_metres(self, counts: float) -> float:
        """Return the position in m of counts."""
        return counts / self.counts_per_metre

    def magnitude_to_units(self, speed: float) -> int:
        """
        Return a limit on speed in the velocity unit, positive on any axis.

        Likewise one on acceleration, in that unit per second. Raises what `to_counts`
        does.
        """
        units = abs(speed / self.si_per_unit.velocity)
        return _rounded('velocity', units, self.velocity_unit, UINT32_MAX)

    @cached_property
    def si_per_unit(self) -> SiPerUnit:
        """One unit of each quantity that the drive sends, in SI units."""
        metres = self.to_metres(1.0)
        return SiPerUnit(metres, metres / self.velocity_units_per_count,
                         self.force_per_torque_unit, metres)


def _rounded(quantity: str, value: float, unit: str, most: int = INT32_MAX) -> int:
    if not math.isfinite(value):
        raise InputError.not_finite(quantity, value, unit)
    if value > most:
        raise LimitError(quantity, value, most, unit, 'above')
    if value < INT32_MIN:
        raise LimitError(quantity, value, INT32_MIN, unit, 'below')
    return round(value)
