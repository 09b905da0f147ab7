"""The driver's own check of carriage positions: it trusts no solver that came before it."""

from __future__ import annotations

from dataclasses import replace

from facade_manipulator.errors import CarriageGapError
from facade_manipulator.kinematics import (
    Carriages,
    check_branch,
    check_carriages,
    forward_kinematics,
    Geometry,
    links,
)

ROUNDING = 1e-6  # m
NEIGHBOURS = ((0, 2), (2, 1), (0, 1))  # on the rail stand A1, A3, A2; A3 may not be homed


class MechanismGuard:
    """
    Check that the mechanism closes at carriage positions and may stand there.

    Stroke, carriage gap, closure of both links on the machine's branch and N > 0; the bounds give
    way by a micrometre of rounding. How well the pose is conditioned is ik_service's matter.
    """

    def __init__(self, geometry: Geometry) -> None:
        least, greatest = geometry.stroke
        self._geometry = replace(
            geometry, stroke=(least - ROUNDING, greatest + ROUNDING),
            carriage_gap=max(0.0, geometry.carriage_gap - ROUNDING))
        self._passed: Carriages | None = None

    def __call__(self, positions: tuple[float, float, float]) -> None:
        """
        Check positions (q1, q2, q3) [m].

        Raises
        ------
        ParameterError
            A position is not finite.
        LimitError
            The limit they violate.

        """
        if positions == self._passed:  # whoever commands and whoever sends ask for the same
            return
        carriages = Carriages(*positions)
        check_carriages(self._geometry, carriages)
        # Its carriages are these, so of `certify` only reach and branch are left.
        check_branch(links(self._geometry, forward_kinematics(self._geometry, carriages)))
        self._passed = carriages


class HomingGuard:
    """
    Check that carriages keep their distance while they home.

    A carriage that is not homed yet has no position to be checked; neighbours are checked as soon
    as both are homed, the whole mechanism when all three are.
    """

    def __init__(self, geometry: Geometry) -> None:
        self._gap = geometry.carriage_gap
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
        for left, right in NEIGHBOURS:
            distance = positions[right] - positions[left]
            if homed[left] and homed[right] and distance < self._gap - ROUNDING:
                raise CarriageGapError(
                    f'q{right + 1} - q{left + 1}', distance, self._gap, 'm', 'below')
