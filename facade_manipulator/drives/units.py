"""Conversion between SI units of a carriage and drive units."""

from __future__ import annotations

from typing import NamedTuple

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1

COUNTS = 0x00B50000  # of 60A8h, the unit of positions


class VelocityUnit(NamedTuple):
    """Velocity unit of a drive, and the CiA 303-2 codes that identify it."""

    counted: str  #: base of the unit: count, revolution or metre
    factor: float  #: number of these units in one base per second
    velocity: int  #: 60A9h
    acceleration: int  #: 60AAh


# base of the unit, units in one base per second, and the codes of 60A9h and 60AAh (CiA 402-2)
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
    """SI value of one drive unit for each measured quantity of the carriage."""

    position: float  #: [m]
    velocity: float  #: [m/s]
    force: float  #: that of the motor's torque [N]
    following_error: float  #: demand minus actual position [m]
