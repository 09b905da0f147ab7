"""
Minimum distance of neighbouring carriages that brake independently instead of together.

The driver sends only targets from which the three carriages can brake together and keep their gap.
Drives that stop by themselves do not coordinate. This module returns the gap that remains then,
and the overshoot beyond the stroke. It also limits the speed of carriages near each other, so that
none hits a neighbour that stops at once.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple

from facade_manipulator.kinematics import Geometry, Mechanism
from facade_manipulator.kinematics.geometry import PerCarriage
from facade_manipulator.motion.limits import MotionLimits

SPEEDS = (
    41  # number of speeds in the search; twice as many change the distance by 0.1 mm
)
MARGIN = 0.001  # m, for the speed that a carriage gains before it brakes


def least_distance(
    gap: float, limits: MotionLimits, deceleration: float, delay: float
) -> float:
    """
    Return the minimum distance of neighbours that brake independently, over all motions [m].

    Two neighbours always keep the distance from which all three carriages can brake together with
    `gap` left at rest. Braking together, a carriage that moves away from its neighbour first
    reduces its acceleration at the limit of jerk, which adds a²/2j to its speed. Braking
    independently, it does not. The left carriage brakes at once, the right one after the delay;
    the mirrored case has the same minimum. The search covers all speeds and takes the distance at
    rest. A pair that is nearest earlier, while both have a speed w, loses as much distance as a
    pair that is slower by w loses until rest.

    Parameters
    ----------
    gap : float
        Minimum commanded distance [m].
    limits : MotionLimits
        Limits of the commanded motion.
    deceleration : float
        Deceleration of each carriage that brakes independently [m/s²].
    delay : float
        Delay of the right carriage's brake after that of the left [s].

    Returns
    -------
    float
        Minimum distance [m]; a value below 0 means a collision.

    """
    stops = [  # speeds, and distances from them to rest
        (speed, speed * abs(speed) / (2.0 * deceleration))
        for speed in (
            limits.speed * (2.0 * number / (SPEEDS - 1) - 1.0)
            for number in range(SPEEDS)
        )
    ]
    return min(
        starting_distance(gap, limits, left, right)
        + right * delay
        + right_stop
        - left_stop
        for left, left_stop in stops
        for right, right_stop in stops
    )


def starting_distance(
    gap: float, limits: MotionLimits, left: float, right: float
) -> float:
    """Return the minimum distance [m] of neighbours that are commanded to have speeds [m/s]."""
    speed, acceleration = limits.speed, limits.acceleration
    gained = 0.5 * acceleration**2 / limits.jerk
    off1, off2 = left - min(gained, speed + left), right + min(gained, speed - right)
    together = max(abs(off1), abs(off2)) / (2.0 * acceleration)
    return gap + max(0.0, (off1 - off2) * together)


def overshoot(speed: float, acceleration: float, deceleration: float) -> float:
    """
    Return the maximum overshoot of a carriage beyond the stroke [m].

    The commanded motion could come to rest inside with the acceleration [m/s²]. The carriage
    brakes from its speed [m/s] with the deceleration [m/s²] instead.
    """
    return max(0.0, 0.5 * speed**2 * (1.0 / deceleration - 1.0 / acceleration))


class Separation(NamedTuple):
    """
    Maximum speed of carriages by distance, so that none hits a neighbour that stops at once.

    A silent drive is detected after `silence`. A drive that still answers is detected by its
    following error, or by a measured distance below the tolerated minimum.
    """

    touching: float  #: distance at which neighbours touch [m]
    deceleration: float  #: deceleration of the weakest brake [m/s²]
    silence: float  #: time until the others brake after a drive falls silent [s]
    window: float  #: following error that is tolerated [m]
    tracking: float  #: time for which a larger following error is tolerated [s]
    tolerated: float  #: minimum measured distance that is tolerated [m]
    report: float  #: time from a smaller distance until the carriages brake [s]

    def speed(self, distance: float) -> float:
        """Return the maximum speed of neighbours at a distance [m], in m/s."""
        seen = max(
            self._stopping_from(self.tolerated, self.report),
            self._stopping_from(distance - self.window, self.tracking),
        )
        return min(seen, self._stopping_from(distance, self.silence))

    def distance(self, speed: float) -> float:
        """Return the minimum distance [m] at which neighbours may have a speed [m/s]."""

        def needed(delay: float) -> float:
            return (
                self.touching
                + MARGIN
                + speed * delay
                + 0.5 * speed**2 / self.deceleration
            )

        is_seen = needed(self.report) <= self.tolerated
        return max(
            needed(self.silence),
            0.0 if is_seen else self.window + needed(self.tracking),
        )

    def _stopping_from(self, distance: float, delay: float) -> float:
        """Return the speed [m/s] from which a carriage stops within a distance after a delay."""
        room = max(0.0, distance - self.touching - MARGIN)
        late = self.deceleration * delay
        return math.sqrt(late * late + 2.0 * self.deceleration * room) - late


def fastest_near(geometry: Geometry, separation: Separation) -> Callable[..., float]:
    """Return the function from a path of positions (q1, q2, q3) [m] to its allowed speed [m/s]."""
    first, second, third = Mechanism(geometry).on_rail((0.0, 0.0, 0.0))
    left, right = third - first, second - third

    def fastest(*path: PerCarriage) -> float:
        return separation.speed(
            min([min(q3 - q1 + left, q2 - q3 + right) for q1, q2, q3 in path])
        )

    return fastest
