"""
Guard of the mechanism: the last check of carriage positions before they reach the bus.

The guard is independent of the solver in ik_service, and answers four questions:

- May these targets be sent? The follower asks for each setpoint and for the path to rest, the
  supervisor for each target, and `activate` for the present positions.
- Are these measured positions possible? The supervisor asks in each cycle in which targets are
  followed. Measured positions lag behind the targets.
- May the carriages be here while they home? The supervisor asks in each cycle of a homing. Some
  carriages have no known position yet.
- How fast may carriages move at this distance from each other? Only the follower asks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import chain, product
import math

from facade_manipulator.drives.stopping_distances import MEASURED_SHARE, Separation
from facade_manipulator.errors import CarriageGapError, LimitError
from facade_manipulator.kinematics import Carriages, Geometry, Mechanism
from facade_manipulator.kinematics.geometry import PerCarriage

GEOMETRY_ROUNDING = 1e-6  # m


class MechanismCheck:
    """
    Check that the links close at given carriage positions, within the mechanism's limits.

    The check covers stroke, carriage gap, closure of both links on the machine's branch, and N >
    0. Ik_service checks the conditioning of the pose.

    Parameters
    ----------
    geometry : Geometry
    tolerance : float
        Tolerated violation of stroke and gap [m].
    margin : float
        Additional tolerance of the stroke [m].

    Attributes
    ----------
    exact : callable
        Takes any number of positions (q1, q2, q3) [m] and checks them in order. Raises a
        LimitError for the first that violates a limit, or a ParameterError if it is not finite.

    """

    def __init__(
        self,
        geometry: Geometry,
        tolerance: float = GEOMETRY_ROUNDING,
        margin: float = 0.0,
    ) -> None:
        low, high = geometry.stroke
        tolerant = replace(
            geometry,
            stroke=(low - margin - tolerance, high + margin + tolerance),
            carriage_gap=max(
                geometry.carriage_length, geometry.carriage_gap - tolerance
            ),
        )
        self.exact: Callable[..., None] = Mechanism(tolerant).check
        self._stroke = geometry.stroke
        self._box = _closing_box(geometry)

    def __call__(self, *path: PerCarriage) -> None:
        """
        Check carriage positions as `exact` does, in a tenth of the time.

        Positions in a box of carriage distances in which the mechanism closes, and inside the
        stroke, pass without further computation. All others are near a limit, and are checked
        exactly.
        """
        low, high = self._stroke
        left_minimum, left_maximum, right_minimum, right_maximum = self._box
        for positions in path:
            q1, q2, q3 = positions
            is_far_from_limits = (
                left_minimum <= q1 - q3 <= left_maximum
                and right_minimum <= q2 - q3 <= right_maximum
                and low <= q1
                and q2 <= high
            )
            if not is_far_from_limits:
                self.exact(positions)


class Guard:
    """
    Last check of carriage positions before they reach the bus.

    Each check raises a LimitError with the violated limit, or a ParameterError for a position that
    is not finite.

    Parameters
    ----------
    geometry : Geometry
    separation : Separation
        Allowed speed for each distance of neighbours.
    limit_margin : float
        Distance of the position limits of the drives beyond the stroke [m].

    """

    # order on the rail is A1, A3, A2; the pair A1, A2 counts while A3 is not homed
    NEIGHBOURS = (
        (0, 2),
        (2, 1),
        (0, 1),
    )

    def __init__(
        self, geometry: Geometry, separation: Separation, limit_margin: float
    ) -> None:
        self.check_targets = MechanismCheck(geometry)
        self._separation = separation
        self._gap = geometry.carriage_gap
        self._on_rail = Mechanism(geometry).on_rail

        first, second, third = self._on_rail(Carriages(0.0, 0.0, 0.0))
        self._left = third - first
        self._right = second - third

        # Three encoders cannot detect a slightly bent link, but they detect positions that no
        # straight link fits.
        tolerance = MEASURED_SHARE * (geometry.carriage_gap - geometry.carriage_length)
        longer = replace(geometry, link_length=geometry.link_length + tolerance)
        self.check_measured = MechanismCheck(longer, tolerance, limit_margin)

    def check_homing(self, positions: PerCarriage, homed: tuple[bool, ...]) -> None:
        """
        Check that the carriages keep their distances at positions [m] during homing.

        A carriage that is not homed has no known position. Neighbours are checked when both are
        homed, the whole mechanism when all three carriages are homed.
        """
        if all(homed):
            self.check_targets(positions)
            return
        on_rail = self._on_rail(Carriages(*positions))
        for left, right in self.NEIGHBOURS:
            distance = on_rail[right] - on_rail[left]
            if (
                homed[left]
                and homed[right]
                and distance < self._gap - GEOMETRY_ROUNDING
            ):
                raise CarriageGapError(
                    f'q{right + 1} - q{left + 1}',
                    distance,
                    self._gap,
                    'm',
                    'below',
                    'geometry.carriage_gap',
                )

    def allowed_speed(self, *path: PerCarriage) -> float:
        """Return the speed [m/s] allowed at every carriage position (q1, q2, q3) [m] of a path."""
        left = self._left + min([q3 - q1 for q1, _, q3 in path])
        right = self._right + min([q2 - q3 for _, q2, q3 in path])
        return self._separation.speed(min(left, right))


class Unguarded:
    """
    Guard of carriages without a known mechanism, for example without links.

    This guard has no `allowed_speed`, because only a `SetpointFollower` asks for it.
    """

    def check_targets(self, *path: PerCarriage) -> None:
        """Accept all targets [m]."""

    def check_measured(self, *path: PerCarriage) -> None:
        """Accept all measured positions [m]."""

    def check_homing(self, positions: PerCarriage, homed: tuple[bool, ...]) -> None:
        """Accept all positions [m] during homing."""


UNLIMITED_STROKE = 50.0  # m, a stroke that limits no mechanism
# search for a box in which the mechanism closes: number of sizes within the reach of a link and
# half the platform, of checked points of the border in a step, and along a side of the interior
BOX_STEPS = 60
BORDER_POINTS = 8
INTERIOR_POINTS = 20


@lru_cache
def _closing_box(geometry: Geometry) -> tuple[float, float, float, float]:
    """
    Return the minimum and maximum of q1 - q3 and q2 - q3 [m] at which the links close.

    The function searches the largest box whose border and interior pass the exact check. The
    distances at which the mechanism closes form one region without holes, so that the border
    decides. Without such a box, return an empty box.
    """
    endless = replace(
        geometry,
        stroke=(-UNLIMITED_STROKE, UNLIMITED_STROKE),
        carriage_gap=max(
            geometry.carriage_length, geometry.carriage_gap - GEOMETRY_ROUNDING
        ),
    )
    check = Mechanism(endless).check
    first, second, third = Mechanism(geometry).on_rail(Carriages(0.0, 0.0, 0.0))
    left_maximum = third - first - geometry.carriage_gap
    right_minimum = third - second + geometry.carriage_gap
    step = (geometry.link_length + geometry.platform_half_length) / BOX_STEPS
    spacing = step / BORDER_POINTS

    def closes(near: float, far: float) -> bool:
        """Return whether the links close in a box from both gaps to the given distances [m]."""
        size = far - near
        side = [near + size * share for share in _shares(round(size / spacing))]
        coarse = [near + size * share for share in _shares(INTERIOR_POINTS)]
        corners = product((far, near), (far, near))
        border = product((far, near), side)
        interior = product(coarse, coarse)
        try:
            for x, y in chain(corners, border, interior):
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
    """Return equally spaced values from 0 to 1."""
    return [number / count for number in range(count + 1)]
