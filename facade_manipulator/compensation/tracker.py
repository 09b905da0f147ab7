"""Follow a moving pose within speed and acceleration limits: exactly, as long as they allow."""

from __future__ import annotations

from itertools import repeat
import math

from facade_manipulator.kinematics import Pose, subtract

BRAKING_SHARE = 0.5


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
        self._place = self._velocity = self._target = Pose(0.0, 0.0, 0.0)

    def change_limits(self, speed: tuple[float, ...], acceleration: tuple[float, ...]) -> None:
        """Keep other limits from the next step on; what is too fast brakes."""
        self._speed, self._acceleration = Pose(*speed), Pose(*acceleration)

    @property
    def behind(self) -> Pose:
        """How far the target is ahead [m, m, rad]; 0 while the limits allow to follow."""
        return subtract(self._target, self._place)

    def reset(self) -> None:
        """Begin again at the next target."""
        self._time = None

    def step(self, time: float, target: Pose) -> Pose:
        """Return the pose at a time [s], later than the last one, for a target then."""
        if self._time is None or time <= self._time:
            self._place, self._velocity = target, Pose(0.0, 0.0, 0.0)
        else:
            self._advance(time - self._time, target)
        self._time, self._target = time, target
        return self._place

    def _advance(self, interval: float, target: Pose) -> None:
        self._velocity = Pose(*map(
            _velocity, repeat(interval), self._place, self._velocity, target, self._target,
            self._speed, self._acceleration))
        (x, y, theta), (vx, vy, omega) = self._place, self._velocity
        self._place = Pose(x + vx * interval, y + vy * interval, theta + omega * interval)


def _velocity(
    interval: float, place: float, velocity: float, target: float, last_target: float,
    speed: float, acceleration: float,
) -> float:
    """Return the velocity that reaches the target, or approaches it so that it can brake."""
    change = acceleration * interval
    direct = (target - place) / interval
    if abs(direct) <= speed and abs(direct - velocity) <= change:
        return direct
    target_velocity = (target - last_target) / interval
    behind = last_target - place
    braking = math.sqrt(2.0 * BRAKING_SHARE * acceleration * abs(behind))
    approach = math.copysign(min(abs(behind) / interval, braking), behind)
    wanted = min(max(target_velocity + approach, -speed), speed)
    return min(max(wanted, velocity - change), velocity + change)
