"""
The driver's own check of carriage positions, which trusts no solver that came before it.

And how fast carriages may be at a distance so that none runs into a neighbour that stands dead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from typing import NamedTuple

from facade_manipulator.errors import CarriageGapError
from facade_manipulator.kinematics import Geometry, mechanism_of

ROUNDING = 1e-6  # m
MARGIN = 0.003  # m, for what the speed lacks while the carriages slow down to it
MEASURED_SHARE = 0.25  # of what keeps carriages from touching: so much too near may they be found
NEIGHBOURS = ((0, 2), (2, 1), (0, 1))  # on the rail stand A1, A3, A2; A3 may not be homed


class MechanismGuard:
    """
    Check that the mechanism closes at carriage positions and may stand there.

    Stroke, carriage gap, closure of both links on the machine's branch and N > 0. How well the
    pose is conditioned is ik_service's matter.

    Parameters
    ----------
    geometry : Geometry
    tolerance : float
        By how much stroke and gap give way [m].

    """

    def __init__(self, geometry: Geometry, tolerance: float = ROUNDING) -> None:
        least, greatest = geometry.stroke
        self._check = mechanism_of(replace(
            geometry, stroke=(least - tolerance, greatest + tolerance),
            carriage_gap=max(geometry.carriage_length, geometry.carriage_gap - tolerance))).check
        self._passed: tuple[tuple[float, float, float], ...] = ()

    def __call__(self, *path: tuple[float, float, float]) -> None:
        """
        Check positions (q1, q2, q3) [m], one after another.

        Raises
        ------
        ParameterError
            A position is not finite.
        LimitError
            The limit they violate.

        """
        if path != self._passed:  # whoever commands and whoever sends ask for the same
            self._check(*path)
            self._passed = tuple(map(tuple, path[-1:]))


def measured_guard(geometry: Geometry, margin: float) -> MechanismGuard:
    """
    Return the guard of what is measured, which differs from what is commanded by the drives' lag.

    Three encoders do not show whether a link is bent; they do show that no straight one fits.

    Parameters
    ----------
    geometry : Geometry
    margin : float
        How far beyond the stroke the drives' own position limits lie [m].

    """
    tolerance = MEASURED_SHARE * (geometry.carriage_gap - geometry.carriage_length)
    least, greatest = geometry.stroke
    return MechanismGuard(replace(
        geometry, link_length=geometry.link_length + tolerance,
        stroke=(least - margin, greatest + margin)), tolerance)


class Separation(NamedTuple):
    """
    Speed and distance: how fast carriages may be where a neighbour may stand dead at once.

    A dead drive that is silent is missed after `silence`. One that still answers is found by its
    following error, or where the measured distance is below the least that is tolerated.
    """

    touching: float  #: distance at which neighbours touch [m]
    deceleration: float  #: of the weakest brake [m/s²]
    silence: float  #: how long the others go on until a silent drive is missed and they brake [s]
    window: float  #: following error that is tolerated [m]
    tracking: float  #: how long it may be beyond it [s]
    tolerated: float  #: least distance as measured that is tolerated [m]
    report: float  #: how long it may be below it until they brake [s]

    def speed(self, distance: float) -> float:
        """Return how fast neighbours may be at a distance [m], in m/s."""
        seen = max(self._stopping_from(self.tolerated, self.report),
                   self._stopping_from(distance - self.window, self.tracking))
        return min(seen, self._stopping_from(distance, self.silence))

    def distance(self, speed: float) -> float:
        """Return the least distance at which neighbours may be as fast as a speed [m/s], in m."""
        def needed(delay: float) -> float:
            return self.touching + MARGIN + speed * delay + 0.5 * speed ** 2 / self.deceleration

        is_seen = needed(self.report) <= self.tolerated
        return max(needed(self.silence), 0.0 if is_seen else self.window + needed(self.tracking))

    def _stopping_from(self, distance: float, delay: float) -> float:
        """Return the speed from which a carriage just stops within a distance, after a delay."""
        room = max(0.0, distance - self.touching - MARGIN)
        late = self.deceleration * delay
        return math.sqrt(late * late + 2.0 * self.deceleration * room) - late


def fastest_near(
    geometry: Geometry, separation: Separation
) -> Callable[[tuple[float, float, float]], float]:
    """Return what says how fast carriages may be [m/s] at positions (q1, q2, q3) [m]."""
    on_rail = mechanism_of(geometry).on_rail

    def fastest(positions: tuple[float, float, float]) -> float:
        q1, q2, q3 = on_rail(positions)
        return separation.speed(min(q3 - q1, q2 - q3))

    return fastest


class HomingGuard:
    """
    Check that carriages keep their distance while they home.

    A carriage that is not homed yet has no position to be checked; neighbours are checked as soon
    as both are homed, the whole mechanism when all three are.
    """

    def __init__(self, geometry: Geometry) -> None:
        self._gap = geometry.carriage_gap
        self._mechanism = mechanism_of(geometry)
        self._whole = MechanismGuard(geometry)

    def __call__(
        self, positions: tuple[float, float, float], homed: tuple[bool, bool, bool]
    ) -> None:
        """
        Check positions (q1, q2, q3) [m] of carriages of which some are homed.

        Raises
        ------
        LimitError
            The limit they violate.

        """
        if all(homed):
            self._whole(positions)
            return
        actual = self._mechanism.on_rail(positions)
        for left, right in NEIGHBOURS:
            distance = actual[right] - actual[left]
            if homed[left] and homed[right] and distance < self._gap - ROUNDING:
                raise CarriageGapError(
                    f'q{right + 1} - q{left + 1}', distance, self._gap, 'm', 'below')
