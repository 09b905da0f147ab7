"""Checks of carriage positions in the driver, independent of the solver in ik_service."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from facade_manipulator.errors import CarriageGapError
from facade_manipulator.kinematics import Carriages, Geometry, Mechanism
from facade_manipulator.motion.limits import Vector

ROUNDING = 1e-6  # m
MEASURED_SHARE = (
    0.25  # share of the free gap by which measured carriages may be too near
)
NEIGHBOURS = (
    (0, 2),
    (2, 1),
    (0, 1),
)  # order on the rail is A1, A3, A2; A3 may not be homed


def mechanism_guard(
    geometry: Geometry, tolerance: float = ROUNDING, margin: float = 0.0
) -> Callable[..., None]:
    """
    Return the check that the mechanism closes at carriage positions and respects its limits.

    The check covers stroke, carriage gap, closure of both links on the machine's branch, and N >
    0. Ik_service checks the conditioning of the pose.

    Parameters
    ----------
    geometry : Geometry
    tolerance : float
        Tolerated violation of stroke and gap [m].
    margin : float
        Additional tolerance of the stroke [m].

    Returns
    -------
    callable
        Takes any number of positions (q1, q2, q3) [m] and checks them in order. Raises a
        LimitError for the first that violates a limit, or a ParameterError if it is not finite.

    """
    low, high = geometry.stroke
    return Mechanism(
        replace(
            geometry,
            stroke=(low - margin - tolerance, high + margin + tolerance),
            carriage_gap=max(
                geometry.carriage_length, geometry.carriage_gap - tolerance
            ),
        )
    ).check


def measured_guard(geometry: Geometry, margin: float) -> Callable[..., None]:
    """
    Return the check of measured positions, which lag behind the commanded ones.

    Three encoders cannot detect a slightly bent link, but they detect positions that no straight
    link fits.

    The position limits of the drives are a margin [m] beyond the stroke.
    """
    tolerance = MEASURED_SHARE * (geometry.carriage_gap - geometry.carriage_length)
    longer = replace(geometry, link_length=geometry.link_length + tolerance)
    return mechanism_guard(longer, tolerance, margin)


def homing_guard(geometry: Geometry) -> Callable[[Vector, tuple[bool, ...]], None]:
    """
    Return the check that carriages keep their distance while they home.

    A carriage that is not homed has no known position. Neighbours are checked when both are homed,
    the whole mechanism when all three carriages are homed.

    Returns
    -------
    callable
        Takes positions (q1, q2, q3) [m] and three booleans that mark homed carriages, and raises a
        LimitError with the violated limit.

    """
    gap, on_rail, whole = (
        geometry.carriage_gap,
        Mechanism(geometry).on_rail,
        mechanism_guard(geometry),
    )

    def check(positions: Vector, homed: tuple[bool, ...]) -> None:
        if all(homed):
            whole(positions)
            return
        actual = on_rail(Carriages(*positions))
        for left, right in NEIGHBOURS:
            distance = actual[right] - actual[left]
            if homed[left] and homed[right] and distance < gap - ROUNDING:
                raise CarriageGapError(
                    f'q{right + 1} - q{left + 1}', distance, gap, 'm', 'below'
                )

    return check
