"""
Motor, screw and carriage of a simulated axis: servo with a first-order lag, rail, load.

Everything here counts in encoder counts from the middle of the rail, in the drive's direction;
`SimulationSettings` is in SI along the rail. Friction, play and a home switch that bounces are as
simple as they can be: the commands `lag`, `stop-test` and `home-switch` have to find them.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import random

from facade_manipulator.drives.units import AxisScale
from facade_manipulator.parameters import parameter, settings

LIMITS, HOME_SWITCH = (0x1, 0x2), 0x4  # bits of the digital inputs 60FD

STANDSTILL = 1.0  # counts/s: slower than that is at rest
_SLOW = 1e-3  # m/s: at which friction and the direction of the power through the screw turn
_TORQUE_FILTER = 0.005  # s
_PEAK_TORQUE = 2000.0  # in thousandths of the rated torque
_STIFFNESS = 60e3  # N/m: force on a hard stop per travel that the servo still wants
_ROTOR_INERTIA = 1e-6  # kg m², of motor, gear and screw
_SWITCH = 0.015  # m, from a limit switch to its hard stop


@settings
class SimulationSettings:
    """Properties of a simulated axis, along the rail."""

    lag: float = parameter('Servo lag', default=0.005, unit='s', minimum=0.0, maximum=1.0)
    peak_speed: float = parameter('Peak speed', default=1.0, unit='m/s', minimum=1e-3)
    peak_acceleration: float = parameter(
        'Peak acceleration', default=20.0, unit='m/s^2', minimum=1e-2)
    moving_mass: float = parameter('Moving mass', default=2.0, unit='kg', minimum=0.0)
    coulomb_friction: float = parameter('Coulomb friction', default=4.0, unit='N', minimum=0.0)
    viscous_friction: float = parameter(
        'Viscous friction', default=10.0, unit='N s/m', minimum=0.0)
    lower_stop: float = parameter('Lower hard stop', default=-0.56, unit='m')
    upper_stop: float = parameter('Upper hard stop', default=0.56, unit='m')
    home_switch_width: float = parameter('Width of the home switch', default=0.01, unit='m')
    home_switch_opens: bool = parameter('Home switch is off at home', default=False)
    home_switch_bounce: float = parameter('Bounce of the home switch', default=0.0, unit='m')
    backlash: float = parameter('Play of the screw', default=0.0, unit='m', minimum=0.0)
    boot_time: float = parameter('Time to boot', default=0.05, unit='s', minimum=0.0)
    firmware_version: str = parameter('Software version (100Ah)', default='1.0')
    missing_objects: tuple[int, ...] = parameter('Indices of missing objects', default=())


class SimulatedMotor:
    """A servo motor that moves a carriage."""

    def __init__(self, settings: SimulationSettings, scale: AxisScale) -> None:
        self._settings = settings
        self._direction, self._per_metre = scale.direction, abs(scale.counts_per_metre)
        self._force_per_torque = abs(scale.force_per_torque_unit)
        self._back_driven = max(2.0 * scale.efficiency - 1.0, 0.0)
        self._rotor = scale.efficiency * _ROTOR_INERTIA * (
            math.tau * scale.gear_ratio / scale.lead) ** 2
        self._stops = self._sorted(settings.lower_stop, settings.upper_stop)
        self._switches = self._sorted(
            settings.lower_stop + _SWITCH, settings.upper_stop - _SWITCH)
        self._home = self._sorted(
            -settings.home_switch_width / 2.0, settings.home_switch_width / 2.0)
        self._play = settings.backlash * self._per_metre / 2.0
        self._bounce = settings.home_switch_bounce * self._per_metre / 2.0
        self._chance = random.Random(0)
        self.counts_per_revolution = scale.counts_per_revolution
        self.peak_speed = settings.peak_speed * self._per_metre
        self.peak_acceleration = settings.peak_acceleration * self._per_metre
        self.lag = settings.lag  #: time constant of the servo [s]; a test may change it
        self.inverted: Callable[[], int] = lambda: 0  #: the bits of 60FD that the drive inverts
        self.external_force = 0.0  #: on the carriage along the rail [N]; set from outside
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

    def count_from_here(self) -> None:
        """Let the encoder start from zero, as an incremental one does when it gets power."""
        #: counts that the encoder reports minus counts from the middle of the rail
        self.offset = -round(self.position)

    @property
    def counts(self) -> int:
        """Position that the encoder reports."""
        return round(self.position) + self.offset

    @property
    def carriage_position(self) -> float:
        """True position of the carriage in m along the rail."""
        return self._carriage * self._direction / self._per_metre

    @property
    def inputs(self) -> int:
        """The switches, as bits of 60FD."""
        is_home = self._home[0] <= self._carriage <= self._home[1]
        if abs(self.position - self.edge(HOME_SWITCH)) < self._bounce:
            is_home = self._chance.random() < 0.5
        closed = (LIMITS[0] * (self._carriage <= self._switches[0])
                  | LIMITS[1] * (self._carriage >= self._switches[1])
                  | HOME_SWITCH * (is_home != self._settings.home_switch_opens))
        return closed ^ self.inverted()

    def edge(self, switch: int) -> float:
        """Return the count of the motor, without a change of direction, at a switch's edge."""
        edges = self._home if switch == HOME_SWITCH else self._switches
        found = min(edges, key=lambda edge: abs(edge - self._carriage))
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
        wanted = _bounded(wanted, speed_limit)
        change = _bounded(wanted - self.velocity, acceleration_limit * step)
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
        mass = settings.moving_mass + self._rotor
        most = friction / mass * self._per_metre * step
        self._move(self.velocity - _bounded(self.velocity, most), step, None)
        self.torque = 0.0

    def _move(self, velocity: float, step: float, demand: float | None) -> None:
        acceleration = (velocity - self.velocity) / step
        self.velocity = velocity
        self.position += velocity * step
        wall = min(max(self.position, self._stops[0] - self._play), self._stops[1] + self._play)
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
        """Update the torque; speed [m/s], acceleration [m/s²] and push [m] of the carriage."""
        settings = self._settings
        load = (settings.moving_mass * acceleration + settings.viscous_friction * speed
                + settings.coulomb_friction * math.tanh(speed / _SLOW)
                + _STIFFNESS * push - self.external_force * self._direction)
        # Where the load drives the motor, friction of gear and screw helps: of the efficiency η
        # 2 − 1/η is left (DIN 69051-5), and at rest something between the two.
        drives = 0.5 + 0.5 * math.copysign(abs(speed) / (abs(speed) + _SLOW), load * speed)
        force = load * (drives + (1.0 - drives) * self._back_driven) + self._rotor * acceleration
        torque = _bounded(force / self._force_per_torque, _PEAK_TORQUE)
        self.torque += (torque - self.torque) * min(1.0, step / _TORQUE_FILTER)


def _bounded(value: float, most: float) -> float:
    return min(max(value, -most), most)
