"""Checks of carriage positions in the driver, independent of the solver in ik_service."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
import math

from facade_manipulator.errors import CarriageGapError, LimitError
from facade_manipulator.kinematics import Carriages, Geometry, Mechanism
from facade_manipulator.kinematics.geometry import PerCarriage

ROUNDING = 1e-6  # m
FARTHEST = 50.0  # m, a stroke that limits no mechanism
# of the search for a box in which the mechanism closes: sizes within the reach of a link and half
# the platform, checked points of the border in a step, and along a side of the interior
BOX_STEPS = 60
BORDER_POINTS = 8
INTERIOR_POINTS = 20
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


def path_guard(
    geometry: Geometry, tolerance: float = ROUNDING, margin: float = 0.0
) -> Callable[..., None]:
    """
    Return the check of `mechanism_guard` in a tenth of its time, for many positions.

    Positions in a box of carriage distances in which the mechanism closes, and inside the stroke,
    pass without further computation. All others are near a limit, and are checked exactly.
    """
    check = mechanism_guard(geometry, tolerance, margin)
    low, high = geometry.stroke
    left_minimum, left_maximum, right_minimum, right_maximum = _closing_box(geometry)

    def check_path(*path: PerCarriage) -> None:
        for positions in path:
            q1, q2, q3 = positions
            is_far_from_limits = (
                left_minimum <= q1 - q3 <= left_maximum
                and right_minimum <= q2 - q3 <= right_maximum
                and low <= q1
                and q2 <= high
            )
            if not is_far_from_limits:
                check(positions)

    return check_path


@lru_cache
def _closing_box(geometry: Geometry) -> tuple[float, float, float, float]:
    """
    Return minimum and maximum of q1 - q3 and q2 - q3 [m] between which the mechanism closes.

    The largest box is searched whose border and interior pass `mechanism_guard`. The distances at
    which the mechanism closes form one region without holes, so that the border decides. A
    mechanism without a box has an empty one.
    """
    check = mechanism_guard(replace(geometry, stroke=(-FARTHEST, FARTHEST)))
    first, second, third = Mechanism(geometry).on_rail(Carriages(0.0, 0.0, 0.0))
    left_maximum = third - first - geometry.carriage_gap
    right_minimum = third - second + geometry.carriage_gap
    step = (geometry.link_length + geometry.platform_half_length) / BOX_STEPS
    spacing = step / BORDER_POINTS

    def closes(near: float, far: float) -> bool:
        """Return whether the mechanism closes in a box, from both gaps to distances [m]."""
        size = far - near
        side = [near + size * share for share in _shares(round(size / spacing))]
        coarse = [near + size * share for share in _shares(INTERIOR_POINTS)]
        corners = [(x, y) for x in (far, near) for y in (far, near)]
        border = [(x, y) for x in (far, near) for y in side]
        interior = [(x, y) for x in coarse for y in coarse]
        try:
            for x, y in corners + border + interior:
                check(Carriages(left_maximum - x, right_minimum + y, 0.0))
                check(Carriages(left_maximum - y, right_minimum + x, 0.0))
        except LimitError:
            return False
        return True

    for size in range(BOX_STEPS, 0, -1):
        for begin in range(BOX_STEPS - size + 1):
            near = begin * step
            far = near + size * step
            if closes(near, far):
                near += spacing if begin else 0.0  # the gap itself is exact
                far -= spacing
                return (
                    left_maximum - far,
                    left_maximum - near,
                    right_minimum + near,
                    right_minimum + far,
                )

    return math.inf, -math.inf, math.inf, -math.inf


def _shares(count: int) -> list[float]:
    """Return the shares 0 to 1 of equal intervals."""
    return [number / count for number in range(count + 1)]


def measured_guard(geometry: Geometry, margin: float) -> Callable[..., None]:
    """
    Return the check of measured positions, which lag behind the commanded ones.

    Three encoders cannot detect a slightly bent link, but they detect positions that no straight
    link fits.

    The position limits of the drives are a margin [m] beyond the stroke.
    """
    tolerance = MEASURED_SHARE * (geometry.carriage_gap - geometry.carriage_length)
    longer = replace(geometry, link_length=geometry.link_length + tolerance)
    return path_guard(longer, tolerance, margin)


def homing_guard(geometry: Geometry) -> Callable[[PerCarriage, tuple[bool, ...]], None]:
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

    def check(positions: PerCarriage, homed: tuple[bool, ...]) -> None:
        if all(homed):
            whole(positions)
            return
        actual = on_rail(Carriages(*positions))
        for left, right in NEIGHBOURS:
            distance = actual[right] - actual[left]
            if homed[left] and homed[right] and distance < gap - ROUNDING:
                raise CarriageGapError(
                    f'q{right + 1} - q{left + 1}',
                    distance,
                    gap,
                    'm',
                    'below',
                    'geometry.carriage_gap',
                )

    return check
