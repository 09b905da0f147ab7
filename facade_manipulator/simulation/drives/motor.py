"""
Motor, screw and carriage of a simulated axis: servo with a first-order lag, rail, load.

Everything here counts in encoder counts from the middle of the rail, in the drive's direction;
`SimulationSettings` is in SI along the rail.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import random

from facade_manipulator.drives.cia402.units import AxisScale
from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import parameter, settings

NEGATIVE_LIMIT, POSITIVE_LIMIT, HOME_SWITCH = 0x1, 0x2, 0x4  # bits of the digital inputs 60FD

STANDSTILL = 1.0  # counts/s: slower than that is at rest
_TURNING_SPEED = 1e-3  # m/s: by it the direction of the power through gear and screw is clear
_PRESLIDING = 2e-5  # m: over it friction changes its sign; at rest it keeps what it had
_TORQUE_FILTER = 0.005  # s
_LEAST_MASS = 1e-6  # kg


@settings
class SimulationSettings:
    """What a simulated axis is made of."""

    lag: float = parameter(
        'Time constant with which the servo follows its demand', default=0.005, unit='s',
        minimum=0.0, maximum=1.0)
    peak_speed: float = parameter(
        'Speed that the motor reaches', default=1.0, unit='m/s', minimum=1e-3, maximum=100.0)
    peak_acceleration: float = parameter(
        'Acceleration that the motor reaches', default=20.0, unit='m/s^2', minimum=1e-2,
        maximum=1000.0)
    peak_torque: float = parameter(
        'Torque that the motor reaches, in thousandths of the rated torque', default=2000.0,
        minimum=1.0, maximum=30000.0)
    moving_mass: float = parameter(
        'Mass that the carriage moves', default=2.0, unit='kg', minimum=0.0, maximum=1000.0)
    rotor_inertia: float = parameter(
        'Inertia of rotor, gear and screw at the motor', default=1e-6, unit='kg m^2', minimum=0.0,
        maximum=1.0)
    coulomb_friction: float = parameter(
        'Friction that does not depend on speed', default=4.0, unit='N', minimum=0.0, maximum=1e4)
    viscous_friction: float = parameter(
        'Friction per speed', default=10.0, unit='N s/m', minimum=0.0, maximum=1e5)
    lower_stop: float = parameter(
        'Lower hard stop of the rail', default=-0.56, unit='m', minimum=-10.0, maximum=10.0)
    upper_stop: float = parameter(
        'Upper hard stop of the rail', default=0.56, unit='m', minimum=-10.0, maximum=10.0)
    lower_switch: float = parameter(
        'Lower limit switch: on from here down', default=-0.545, unit='m', minimum=-10.0,
        maximum=10.0)
    upper_switch: float = parameter(
        'Upper limit switch: on from here up', default=0.545, unit='m', minimum=-10.0,
        maximum=10.0)
    home_switch: float = parameter(
        'Middle of the home switch', default=0.0, unit='m', minimum=-10.0, maximum=10.0)
    home_switch_width: float = parameter(
        'Travel over which the home switch is on', default=0.01, unit='m', minimum=1e-4,
        maximum=1.0)
    home_switch_opens: bool = parameter(
        'Whether the home switch opens at home: its input is on everywhere else', default=False)
    home_switch_bounce: float = parameter(
        'Travel around an edge of the home switch over which it bounces', default=0.0, unit='m',
        minimum=0.0, maximum=0.01)
    backlash: float = parameter(
        'Play between the motor, whose encoder counts, and the carriage', default=0.0, unit='m',
        minimum=0.0, maximum=0.01)
    contact_stiffness: float = parameter(
        'Force on a hard stop per travel that the servo still wants', default=60e3, unit='N/m',
        minimum=1.0, maximum=1e9)
    boot_time: float = parameter(
        'Time from reset to the boot-up message', default=0.05, unit='s', minimum=0.0,
        maximum=10.0)
    firmware_version: str = parameter(
        'Software version that the drive reports (100Ah)', default='1.0')
    missing_objects: tuple[int, ...] = parameter(
        'Indices of objects that this drive does not have', default=())

    def __post_init__(self) -> None:
        order = ('lower_stop', 'lower_switch', 'upper_switch', 'upper_stop')
        for low, high in zip(order, order[1:], strict=False):
            if getattr(self, low) > getattr(self, high):
                raise ParameterError(f'{low} = {getattr(self, low):g} m is above '
                                     f'{high} = {getattr(self, high):g} m')


class SimulatedMotor:
    """A servo motor that moves a carriage."""

    def __init__(self, settings: SimulationSettings, scale: AxisScale) -> None:
        self._settings = settings
        self._per_metre = abs(scale.counts_per_metre)
        self._force_per_torque = abs(scale.force_per_torque_unit)
        self._efficiency = scale.efficiency
        self._rotor = scale.efficiency * settings.rotor_inertia * (
            math.tau * scale.gear_ratio / scale.lead) ** 2
        self._friction = 0.0
        self._direction = scale.direction
        self._stops = self._sorted(settings.lower_stop, settings.upper_stop)
        self._switches = self._sorted(settings.lower_switch, settings.upper_switch)
        half = settings.home_switch_width / 2.0
        self._home = self._sorted(settings.home_switch - half, settings.home_switch + half)
        self.counts_per_revolution = scale.counts_per_revolution
        self.peak_speed = settings.peak_speed * self._per_metre
        self.peak_acceleration = settings.peak_acceleration * self._per_metre
        self.lag = settings.lag  #: time constant of the servo [s]; a test may change it
        self._play = settings.backlash * self._per_metre / 2.0
        self._bounce = settings.home_switch_bounce * self._per_metre / 2.0
        self._chance = random.Random(0)
        self.inverted: Callable[[], int] = lambda: 0  #: the bits of 60FD that the drive inverts
        self.external_force = 0.0  #: on the carriage along the rail [N]; anybody may set it
        self.place(0.0)
        self.count_from_here()

    def _sorted(self, low: float, high: float) -> tuple[float, float]:
        factor = self._direction * self._per_metre
        return min(low * factor, high * factor), max(low * factor, high * factor)

    def place(self, position: float) -> None:
        """Put the carriage, at rest, at a position in m along the rail."""
        #: of the motor [counts]
        self.position = self._carriage = position * self._direction * self._per_metre
        self.velocity = 0.0  #: of the motor [counts/s]
        self.torque = 0.0  #: in thousandths of the rated torque
        self.is_limited = False  #: whether speed or acceleration are at their limits

    def count_from_here(self) -> None:
        """Let the encoder start from zero, as an incremental one does when it gets power."""
        #: counts that the encoder reports minus counts from the middle of the rail
        self.offset = -round(self.position)

    @property
    def counts(self) -> int:
        """What the encoder reports."""
        return round(self.position) + self.offset

    @property
    def carriage_position(self) -> float:
        """Where the carriage really is, in m along the rail, whatever the drive believes."""
        return self._carriage * self._direction / self._per_metre

    @property
    def inputs(self) -> int:
        """The switches, as bits of 60FD."""
        lower, upper = self._switches
        closed = (NEGATIVE_LIMIT * (self._carriage <= lower)
                  | POSITIVE_LIMIT * (self._carriage >= upper)
                  | HOME_SWITCH * (self._at_home != self._settings.home_switch_opens))
        return closed ^ self.inverted()

    @property
    def _at_home(self) -> bool:
        near, far = self._home
        distance = min(abs(self._carriage - near), abs(self._carriage - far))
        if distance < self._bounce:
            return self._chance.random() < 0.5
        return near <= self._carriage <= far

    def edge(self, switch: int) -> float:
        """Return what the motor counts, without a change of direction, at a switch's edge."""
        edges = {NEGATIVE_LIMIT: self._switches[:1], POSITIVE_LIMIT: self._switches[1:]}
        found = min(edges.get(switch, self._home), key=lambda edge: abs(edge - self._carriage))
        return found + self.position - self._carriage

    def follow(
        self, demand: float, speed: float, step: float,
        speed_limit: float, acceleration_limit: float,
    ) -> None:
        """
        Follow a demand at the end of a step [counts], at a speed during it [counts/s].

        The error decays with the time constant `lag`, exactly so for any step [s], as long
        as neither limit is met; on a ramp the carriage stays speed·lag behind.
        """
        error = demand - self.position - speed * (self.lag + step)
        wanted = speed + self._approach(error, step, acceleration_limit)
        reachable = min(max(wanted, -speed_limit), speed_limit)
        most = acceleration_limit * step
        change = min(max(reachable - self.velocity, -most), most)
        self.is_limited = self.velocity + change != wanted
        self._move(self.velocity + change, step, demand)

    def _approach(self, error: float, step: float, acceleration: float) -> float:
        """Return the speed that takes an error away: by the lag, or braking at the limit."""
        knee = acceleration * self.lag * self.lag  # beyond it the lag alone would brake harder
        if abs(error) <= knee and self.lag > 0.0:
            decay = 1.0 - math.exp(-step / self.lag)
            return error * decay / step
        # after this step at speed v, braking at the limit ends where the lag takes over:
        # v² = a (2 (|error| - v step) - knee)
        slack = acceleration * step
        root = math.sqrt(slack * slack + 4.0 * acceleration * (2.0 * abs(error) - knee))
        return math.copysign(min(0.5 * (root - slack), abs(error) / step), error)

    def coast(self, step: float) -> None:
        """Move without power over one time step: friction brakes the masses, rotor and all."""
        settings, speed = self._settings, abs(self.velocity) / self._per_metre
        friction = settings.coulomb_friction + settings.viscous_friction * speed
        mass = max(settings.moving_mass + self._rotor, _LEAST_MASS)
        most = friction / mass * self._per_metre * step
        self.is_limited = False
        self._move(self.velocity - min(max(self.velocity, -most), most), step, None)
        self.torque = 0.0

    def _move(self, velocity: float, step: float, demand: float | None) -> None:
        acceleration = (velocity - self.velocity) / step
        self.velocity = velocity
        self.position += velocity * step
        lower, upper = self._stops
        wall = min(max(self.position, lower - self._play), upper + self._play)
        push = 0.0
        if wall != self.position:
            self.position, self.velocity, acceleration = wall, 0.0, 0.0
            push = 0.0 if demand is None else demand - wall
        before = self._carriage
        self._carriage = min(max(before, self.position - self._play), self.position + self._play)
        speed = (self._carriage - before) / step
        if self._play and speed == 0.0:
            acceleration = 0.0  # the motor turns in the play, and nothing hangs on it
        self._load(speed / self._per_metre, acceleration / self._per_metre,
                   push / self._per_metre, step)

    def _load(self, speed: float, acceleration: float, push: float, step: float) -> None:
        load = (self._settings.moving_mass * acceleration + self._rub(speed * step)
                + self._settings.viscous_friction * speed
                + self._settings.contact_stiffness * push
                - self.external_force * self._direction)
        force = load * self._share(math.copysign(speed, load * speed)) + self._rotor * acceleration
        peak = self._settings.peak_torque
        torque = min(max(force / self._force_per_torque, -peak), peak)
        self.torque += (torque - self.torque) * min(1.0, step / _TORQUE_FILTER)

    def _rub(self, travel: float) -> float:
        """Return the Coulomb friction after a travel [m] (Dahl's model); none within a play."""
        if self._play and travel == 0.0:
            return 0.0
        side = math.copysign(self._settings.coulomb_friction, travel)
        self._friction = side + (self._friction - side) * math.exp(-abs(travel) / _PRESLIDING)
        return self._friction

    def _share(self, speed: float) -> float:
        """
        Return what the motor bears of a load, 1 where it drives it at a speed [m/s].

        Where the load drives the motor, friction of gear and screw helps: of the efficiency η
        2 − 1/η is left (DIN 69051-5), and at rest something between the two.
        """
        drives = 0.5 + 0.5 * speed / (abs(speed) + _TURNING_SPEED)
        back_driven = max(2.0 * self._efficiency - 1.0, 0.0)
        return drives + (1.0 - drives) * back_driven
