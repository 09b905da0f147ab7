"""Follow a moving pose within speed and acceleration limits: exactly, as long as they allow."""

from __future__ import annotations

from itertools import repeat
import math

from facade_manipulator.kinematics import Pose, subtract, Twist, ZERO_POSE, ZERO_TWIST

BRAKING_SHARE = 0.5  # of the acceleration: what remains is for the target's own


class Tracker:
    """
    Step towards a pose, each axis within its limits.

    Parameters
    ----------
    speed, acceleration : tuple of float, shape (3,)
        Limits [m/s, rad/s] and [m/s², rad/s²] of x, y and θ.

    """

    def __init__(self, speed: tuple[float, ...], acceleration: tuple[float, ...]) -> None:
        self.change_limits(speed, acceleration)
        self._time: float | None = None
        self._position = self._target = ZERO_POSE
        self._velocity = ZERO_TWIST

    def change_limits(self, speed: tuple[float, ...], acceleration: tuple[float, ...]) -> None:
        """Keep other limits from the next step on; what is too fast brakes."""
        self._speed, self._acceleration = speed, acceleration

    @property
    def tracking_error(self) -> Pose:
        """How far the target is ahead [m, m, rad]; 0 while the limits allow to follow."""
        return subtract(self._target, self._position)

    def reset(self) -> None:
        """Begin again at the next target."""
        self._time = None

    def step(self, time: float, target: Pose) -> Pose:
        """Return the pose at a time [s], later than the last one, for a target then."""
        if self._time is None or time <= self._time:
            self._position, self._velocity = target, ZERO_TWIST
        else:
            self._advance(time - self._time, target)
        self._time, self._target = time, target
        return self._position

    def _advance(self, interval: float, target: Pose) -> None:
        self._velocity = Twist(*map(
            _velocity, repeat(interval), self._position, self._velocity, target, self._target,
            self._speed, self._acceleration))
        (x, y, theta), (vx, vy, omega) = self._position, self._velocity
        self._position = Pose(x + vx * interval, y + vy * interval, theta + omega * interval)


def _velocity(
    interval: float, position: float, velocity: float, target: float, last_target: float,
    speed: float, acceleration: float,
) -> float:
    """Return the velocity that reaches the target, or approaches it so that it can brake."""
    change = acceleration * interval
    direct = (target - position) / interval
    if abs(direct) <= speed and abs(direct - velocity) <= change:
        return direct
    target_velocity = (target - last_target) / interval
    tracking_error = last_target - position
    braking = math.sqrt(2.0 * BRAKING_SHARE * acceleration * abs(tracking_error))
    approach = math.copysign(min(abs(tracking_error) / interval, braking), tracking_error)
    wanted = min(max(target_velocity + approach, -speed), speed)
    return min(max(wanted, velocity - change), velocity + change)
