"""Position demands over time: cyclic interpolation and a speed ramp."""

from __future__ import annotations


class Interpolator:
    """Demand of cyclic synchronous position [counts]: a straight line from SYNC to SYNC."""

    def __init__(self, position: float) -> None:
        self.position = position
        self.speed = 0.0
        self._target = position
        self._remaining = 0.0

    def latch(self, target: float, period: float) -> None:
        """Take a target to be reached after one period in s; a period of 0 makes a step."""
        self._target = target
        self._remaining = period
        if period > 0.0:
            self.speed = (target - self.position) / period
        else:
            self.position, self.speed = target, 0.0

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position after `step` seconds, and the speed meanwhile."""
        if self._remaining > step:
            self._remaining -= step
            self.position += self.speed * step
            return self.position, self.speed
        speed = (self._target - self.position) / step if self._remaining > 0.0 else 0.0
        self.position, self.speed, self._remaining = self._target, 0.0, 0.0
        return self.position, speed


class SpeedRamp:
    """
    Demand [counts] whose speed goes to `goal` [counts/s] with a bounded acceleration [counts/s²].

    A caller may change the goal at any time.
    """

    def __init__(
        self, position: float, speed: float, acceleration: float, goal: float = 0.0
    ) -> None:
        self.position = position
        self.speed = speed
        self.goal = goal
        self._acceleration = acceleration

    def step(self, step: float) -> tuple[float, float]:
        """Return demand position and speed after `step` seconds."""
        most = self._acceleration * step
        change = min(max(self.goal - self.speed, -most), most)
        self.position += (self.speed + 0.5 * change) * step
        self.speed += change
        return self.position, self.speed
