"""Motor, gear and screw of an axis: what a demand asks of them, and by how much they exceed it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Carriages
from facade_manipulator.lab.gondola import rms
from facade_manipulator.lab.sizing.demand import Demand
from facade_manipulator.lab.sizing.screw import (
    BallScrew,
    buckling_load,
    BUCKLING_SHARE,
    critical_speed,
    life,
    mean_loads,
    MOUNTINGS,
    SPEED_SHARE,
)
from facade_manipulator.parameters import parameter, settings

HOUR = 3600.0  # s
AXES = Carriages._fields
Margins = dict[str, np.ndarray]  # by what binds, shape (3,)


class Binding(NamedTuple):
    """The least of the margins, and what binds there along which axis."""

    margin: float
    what: str


@settings
class Duty:
    """How the axes are built, how they are used and for how long."""

    mounting: str = parameter(
        'How the ends of the screws are held', default='fixed-supported',
        choices=tuple(MOUNTINGS))
    extra_length: float = parameter(
        'Length of a screw between its bearings beyond the stroke', default=0.15, unit='m',
        minimum=0.0, maximum=10.0)
    efficiency: float = parameter(
        'Efficiency of screw and gear together', default=0.85, minimum=0.05, maximum=1.0)
    load_factor: float = parameter(
        'What the load of the screws is multiplied by: 1.3 to 1.8 in normal operation',
        default=1.5, minimum=1.0, maximum=5.0)
    life: float = parameter(
        'Hours of operation that the screws must last', default=10000.0, unit='h', minimum=1.0,
        maximum=1e6)
    gear_ratios: tuple[float, ...] = parameter(
        'Ratios of the gears to choose from', default=(1.0, 2.0, 4.3), minimum=0.1, maximum=1e3)
    margin: float = parameter(
        'Least share by which motor and screw exceed what is asked', default=1.25, minimum=1.0,
        maximum=100.0)


@settings
class Motor:
    """A servomotor with its amplifier."""

    name: str = parameter('Name', default='')
    rated_torque: float = parameter(
        'Torque for ever', default=0.318, unit='N m', minimum=1e-4, maximum=1e4)
    peak_torque: float = parameter(
        'Torque for a moment', default=1.11, unit='N m', minimum=1e-4, maximum=1e4)
    rated_speed: float = parameter(
        'Speed for ever', default=50.0, unit='rev/s', minimum=0.01, maximum=1e4)
    peak_speed: float = parameter(
        'Speed for a moment', default=100.0, unit='rev/s', minimum=0.01, maximum=1e4)
    inertia: float = parameter(
        'Moment of inertia of the rotor', default=6.59e-6, unit='kg m^2', minimum=0.0,
        maximum=10.0)
    source: str = parameter('Where this stands', default='')

    def __post_init__(self) -> None:
        for what, unit in (('torque', 'N m'), ('speed', 'rev/s')):
            rated, peak = (getattr(self, f'{kind}_{what}') for kind in ('rated', 'peak'))
            if peak < rated:
                raise ParameterError(f'peak_{what} = {peak:g} {unit} is below rated_{what} = '
                                     f'{rated:g} {unit}')

    @property
    def power(self) -> float:
        """Rated power [W]."""
        return math.tau * self.rated_torque * self.rated_speed


class AxisDrive(NamedTuple):
    """What moves a carriage."""

    motor: Motor
    gear_ratio: float
    screw: BallScrew

    @property
    def turns(self) -> float:
        """Revolutions of the motor in a metre."""
        return self.gear_ratio / self.screw.lead

    @property
    def name(self) -> str:
        """Return the names of its parts."""
        return f'{self.motor.name}, gear {self.gear_ratio:g}, {self.screw.name}'


def screw_length(of: Demand, duty: Duty) -> float:
    """Return the length of a screw between its bearings [m]."""
    return of.stroke[1] - of.stroke[0] + duty.extra_length


def torques(drive: AxisDrive, of: Demand, duty: Duty) -> np.ndarray:
    """
    Return the torques of the motors, shape (n, 3) [N m].

    What is lost adds to the torque that drives and lessens that which brakes.
    """
    per_metre = math.tau * drive.turns
    driving = of.force * of.speed >= 0.0
    load = of.force / per_metre * np.where(driving, 1.0 / duty.efficiency, duty.efficiency)
    inertia = drive.motor.inertia + drive.screw.inertia(
        screw_length(of, duty)) / drive.gear_ratio ** 2
    return load + inertia * per_metre * of.acceleration


def life_hours(screw: BallScrew, of: Demand, duty: Duty) -> np.ndarray:
    """Return L10 of each axis' screw in hours of such operation, shape (3,)."""
    revolutions = np.abs(of.speed).mean(axis=0) / screw.lead  # a second
    loads = duty.load_factor * of.force
    return np.array([
        life(screw.rating, mean_loads(force, speed)) / max(rate, np.finfo(float).tiny) / HOUR
        for force, speed, rate in zip(loads.T, of.speed.T, revolutions, strict=True)])


def screw_margins(screw: BallScrew, of: Demand, duty: Duty) -> Margins:
    """
    Return what a screw permits by what is asked of it, of each axis, by what binds.

    That of the life is of the load: the cube root of that of the hours.
    """
    length, core = screw_length(of, duty), screw.core
    rotation, push = _greatest(of.speed) / screw.lead, _greatest(of.force)
    return {
        'critical speed': _share(
            SPEED_SHARE * critical_speed(core, length, duty.mounting), rotation),
        'DN value': _share(screw.speed_factor / screw.diameter, rotation),
        'buckling': _share(BUCKLING_SHARE * buckling_load(core, length, duty.mounting), push),
        'life': np.cbrt(life_hours(screw, of, duty) / duty.life)}


def motor_margins(drive: AxisDrive, of: Demand, duty: Duty) -> Margins:
    """Return what a motor permits by what is asked of it, of each axis, by what binds."""
    motor, torque = drive.motor, torques(drive, of, duty)
    return {
        'rated torque': _share(motor.rated_torque, rms(torque)),
        'peak torque': _share(motor.peak_torque, _greatest(torque)),
        'motor speed': _share(motor.peak_speed, drive.turns * _greatest(of.speed))}


def binding(of: Margins) -> Binding:
    """Return what binds."""
    name = min(of, key=lambda one: float(of[one].min()))
    return Binding(float(of[name].min()), f'{name} of {AXES[int(of[name].argmin())]}')


def _greatest(values: np.ndarray) -> np.ndarray:
    return np.abs(values).max(axis=0)


def _share(permitted: float, asked: np.ndarray) -> np.ndarray:
    return permitted / np.maximum(asked, np.finfo(float).tiny)
