"""Change smoothly from one trajectory to another: their difference decays, critically damped."""

from __future__ import annotations

import math

from facade_manipulator.kinematics import MotionState, Pose, Twist, ZERO_STATE

QUICKEST = 1e-3  # s, least time constant: no division by 0 where nothing remains
DEAD_AFTER = 40.0  # time constants: 1e-16 of the remainder is left


class Blend:
    """
    The remainder of an old trajectory, to be added to the new one.

    At its start the sum continues position and velocity of the old one; later it is the new one.

    Parameters
    ----------
    acceleration : tuple of float, shape (3,)
        Acceleration that the remainder adds at most, about: a greater one takes longer
        [m/s², m/s², rad/s²].

    """

    def __init__(self, acceleration: tuple[float, ...]) -> None:
        self._acceleration = acceleration
        self.clear()

    def clear(self) -> None:
        """Forget the remainder."""
        self._start = self._end = -math.inf

    def begin(self, time: float, difference: MotionState, constant: float) -> None:
        """
        Begin with a new remainder, in place of the present one.

        Parameters
        ----------
        time : float
            Now [s].
        difference : MotionState
            Old trajectory less new trajectory.
        constant : float
            Time constant of the decay [s], lengthened where the acceleration would be too high.

        """
        position, velocity = difference
        constants = [
            max(constant, QUICKEST, _least_constant(*axis))
            for axis in zip(position, velocity, self._acceleration, strict=True)]
        self._start, self._end = time, time + DEAD_AFTER * max(constants)
        self._constants = constants
        self._position = position
        self._slope = [v + p / c for p, v, c in zip(position, velocity, constants, strict=True)]

    def at(self, time: float) -> MotionState:
        """Return the remainder at a time [s]: (p + s t) exp(−t/T) of each axis."""
        if time > self._end:
            return ZERO_STATE
        t = max(time - self._start, 0.0)
        (a, b, c), (x, y, theta), (dx, dy, dtheta) = self._constants, self._position, self._slope
        decay_x, decay_y, decay_theta = math.exp(-t / a), math.exp(-t / b), math.exp(-t / c)
        x, y, theta = x + dx * t, y + dy * t, theta + dtheta * t
        return MotionState(
            Pose(x * decay_x, y * decay_y, theta * decay_theta),
            Twist((dx - x / a) * decay_x, (dy - y / b) * decay_y,
                  (dtheta - theta / c) * decay_theta))


def _least_constant(position: float, velocity: float, acceleration: float) -> float:
    """Return the time constant of a decay within an acceleration, about."""
    return max(math.sqrt(abs(position) / acceleration), 2.0 * abs(velocity) / acceleration)
