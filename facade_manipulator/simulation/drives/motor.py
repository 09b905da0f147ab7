"""
Motor, screw and carriage of a simulated axis: a servo with a first-order lag.

Positions are encoder counts from the middle of the rail, in the drive's direction.
`SimulationSettings` are in SI units along the rail.
"""

from __future__ import annotations

from collections.abc import Callable
import math

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.states import DigitalInput
from facade_manipulator.parameters import parameter, settings

STANDSTILL = 1.0  # counts/s: a slower motor is at rest


@settings
class SimulationSettings:
    """Properties of a simulated axis, along the rail."""

    lag: float = parameter(
        'Servo lag', default=0.005, unit='s', minimum=0.0, maximum=1.0
    )
    coasting: float = parameter(
        'Deceleration without power',
        default=1.87,
        unit='m/s^2',
        minimum=0.1,
        maximum=100.0,
    )
    home_switch_width: float = parameter(
        'Width of the home switch', default=0.01, unit='m'
    )
    home_switch_opens: bool = parameter(
        'Whether the home switch is off at home', default=False
    )
    missing_objects: tuple[int, ...] = parameter(
        'Indices of missing objects', default=()
    )


class SimulatedMotor:
    """Servo motor that moves a carriage along the rail."""

    # from the middle of the rail to both sides
    _HARD_STOP = 0.56  # m
    _LIMIT_SWITCH = 0.545  # m
    _HAND_SPEED = 0.1  # m/s
    # of the motor
    _PEAK_SPEED = 1.0  # m/s
    _PEAK_ACCELERATION = 20.0  # m/s²
    _PEAK_TORQUE = 2000.0  # in thousandths of the rated torque

    def __init__(self, settings: SimulationSettings, scale: AxisSettings) -> None:
        self._settings = settings
        self._direction = scale.direction
        self.counts_per_metre = abs(scale.counts_per_metre)
        self._force_per_torque = abs(scale.si_per_unit.force)
        # distances of hard stops and edges of switches from the middle of the rail, to both
        # sides [counts]
        self.hard_stop = self._HARD_STOP * self.counts_per_metre
        self.limit_switch = self._LIMIT_SWITCH * self.counts_per_metre
        self.home_switch = settings.home_switch_width / 2.0 * self.counts_per_metre
        self.counts_per_revolution = scale.counts_per_revolution
        self.peak_speed = self._PEAK_SPEED * self.counts_per_metre
        self.peak_acceleration = self._PEAK_ACCELERATION * self.counts_per_metre
        self.lag = settings.lag  #: time constant of the servo [s]; a test may change it
        self.inverted: Callable[[], int] = lambda: (
            0
        )  #: the bits of 60FD that the drive inverts
        self.external_force = 0.0  #: external force on the carriage along the rail [N]
        self.place(scale.home_position)

    def place(self, position: float) -> None:
        """Place the carriage at rest at a position along the rail [m], within the hard stops."""
        self.position = _bounded(  #: [counts]
            position * self._direction * self.counts_per_metre, self.hard_stop
        )
        self.velocity = 0.0  #: [counts/s]
        self._pushed_to: float | None = None  # while a hand pushes [counts]

    def push(self, distance: float) -> None:
        """Begin to push the carriage by a distance along the rail [m]; power ends the push."""
        counts = distance * self._direction * self.counts_per_metre
        self._pushed_to = self.position + counts
        self.velocity = math.copysign(self._HAND_SPEED * self.counts_per_metre, counts)

    def count_from_here(self) -> None:
        """Reset the encoder to zero, as an incremental encoder does at power-on."""
        #: counts that the encoder reports minus counts from the middle of the rail
        self.offset = -round(self.position)

    @property
    def is_pushed(self) -> bool:
        """Return whether a hand pushes the carriage."""
        return self._pushed_to is not None

    @property
    def counts(self) -> int:
        """Return the position reported by the encoder [counts]."""
        return round(self.position) + self.offset

    @property
    def torque(self) -> float:
        """Return the torque against the external force, in thousandths of the rated torque."""
        force = -self.external_force * self._direction
        return _bounded(force / self._force_per_torque, self._PEAK_TORQUE)

    @property
    def carriage_position(self) -> float:
        """Return the true position of the carriage along the rail [m]."""
        return self.position * self._direction / self.counts_per_metre

    @property
    def inputs(self) -> int:
        """Return the states of the switches as bits of 60FDh."""
        is_home = abs(self.position) <= self.home_switch
        closed = (
            DigitalInput.NEGATIVE_LIMIT_SWITCH * (self.position <= -self.limit_switch)
            | DigitalInput.POSITIVE_LIMIT_SWITCH * (self.position >= self.limit_switch)
            | DigitalInput.HOME_SWITCH * (is_home != self._settings.home_switch_opens)
        )
        return closed ^ self.inverted()

    def follow(
        self,
        demand: float,
        speed: float,
        step: float,
        speed_limit: float,
        acceleration_limit: float,
    ) -> None:
        """
        Follow a demand position at the end of a step [counts] with a demand speed [counts/s].

        The error decays with the time constant `lag`, exactly for any step [s], within both
        limits. On a ramp the carriage lags by speed·lag.
        """
        self._pushed_to = None  # a servo with power does not give way
        error = demand - self.position - speed * (self.lag + step)
        size = abs(error)
        knee = acceleration_limit * self.lag**2
        if size > knee:
            # the lag would brake harder than the limit: v² = a (2 |error| - knee)
            fastest = math.sqrt(acceleration_limit * (2.0 * size - knee))
            approach = min(fastest, size / step)
        elif size:
            approach = size * (1.0 - math.exp(-step / self.lag)) / step
        else:
            approach = 0.0
        wanted = _bounded(speed + math.copysign(approach, error), speed_limit)
        change = _bounded(wanted - self.velocity, acceleration_limit * step)
        self._move(self.velocity + change, step)

    def coast(self, step: float) -> None:
        """Move without power for a time step [s]."""
        if self._pushed_to is not None:
            self._follow_hand(self._pushed_to, step)
            return
        braking = self._settings.coasting * self.counts_per_metre * step
        self._move(self.velocity - _bounded(self.velocity, braking), step)

    def _follow_hand(self, goal: float, step: float) -> None:
        """Move towards the place where the hand stops the carriage [counts]."""
        speed = self._HAND_SPEED * self.counts_per_metre
        left = goal - self.position
        self._move(_bounded(left / step, speed), step)
        if abs(left) <= speed * step:
            self.velocity = 0.0
            self._pushed_to = None

    def _move(self, velocity: float, step: float) -> None:
        """Move at a velocity [counts/s] for a time step [s], at most to the hard stops."""
        self.velocity = velocity
        self.position += velocity * step
        if abs(self.position) > self.hard_stop:
            self.position = _bounded(self.position, self.hard_stop)
            self.velocity = 0.0


def _bounded(value: float, most: float) -> float:
    """Return a value clamped to ±most."""
    return min(max(value, -most), most)
