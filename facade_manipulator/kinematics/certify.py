"""Whether the machine may stand at a pose: every limit of the mechanism in one call."""

from __future__ import annotations

from math import isfinite, sqrt

from facade_manipulator.errors import CarriageGapError, SingularityError, StrokeLimitError
from facade_manipulator.kinematics.forward import closed_number
from facade_manipulator.kinematics.geometry import Carriages, Geometry, not_finite, Pose
from facade_manipulator.kinematics.inverse import links
from facade_manipulator.kinematics.jacobian import branch_number, squared_index

# b over the index's unit of length: for the design that is 1 m, for a mechanism of another size it
# grows with it, so that the same poses are well conditioned.
CONDITIONING_RATIO = 0.348
# With that unit, the order of the carriages alone keeps the design above 0.07 near the rail.
# Towards the far edge the index falls to 0 as the links become upright: 0.05 is passed 0.1 mm
# before it at θ = 0, where carriages already move 40 times faster than the head.
MIN_CONDITIONING = 0.05


def certify(
    geometry: Geometry, pose: Pose, min_conditioning: float = MIN_CONDITIONING,
    characteristic_length: float | None = None,
) -> Carriages:
    """
    Check a pose against all limits of the machine at once, in the working mode PLUS_MINUS.

    Parameters
    ----------
    geometry : Geometry
    pose : Pose
        [m, m, rad].
    min_conditioning : float
        Least local conditioning index; 0 asks for nothing beyond the other limits.
    characteristic_length : float, optional
        Unit of length of that index [m]; None for b/0.348, which is 1 m for the design.

    Returns
    -------
    Carriages
        Carriage positions of the pose [m].

    Raises
    ------
    ParameterError
        If the pose is not finite (a ValueError).
    UnreachableError
        If a link is too short.
    SingularityError
        If the pose is behind the rail, at or beyond the parallel singularity N = 0, or
        conditioned worse than `min_conditioning`.
    CarriageGapError
        If neighbouring carriages come closer than the carriage gap or change their order.
    StrokeLimitError
        If a carriage leaves the stroke.

    """
    at = _, cosine, _, _, projection1, projection2 = links(geometry, pose)
    x, y, _ = pose
    if y <= 0.0:
        raise behind_rail(y)
    span = geometry.platform_half_length * cosine
    check_gap(geometry, span - projection1, span - projection2)
    q1, q2 = x - span + projection1, x + span - projection2
    check_stroke(geometry, q1, q2)
    check_number(branch_number(at))
    check_index(squared_index(at, index_ratio(geometry, characteristic_length)), min_conditioning)
    return Carriages(q1, q2, x)


def certify_carriages(geometry: Geometry, carriages: Carriages) -> None:
    """
    Check carriage positions [m]: the links close there, on the machine's branch.

    How well the pose is conditioned is not asked.

    Raises
    ------
    ParameterError, UnreachableError, SingularityError, CarriageGapError, StrokeLimitError
        As `certify`.

    """
    q1, q2, q3 = carriages
    if not isfinite(q1 + q2 + q3):
        raise not_finite(carriages)
    check_gap(geometry, q3 - q1, q2 - q3)
    check_stroke(geometry, q1, q2)
    check_number(closed_number(geometry, q1 - q3, q2 - q3))


def index_ratio(geometry: Geometry, characteristic_length: float | None) -> float:
    """Return b over the unit of length of the conditioning index."""
    if characteristic_length is None:
        return CONDITIONING_RATIO
    return geometry.platform_half_length / characteristic_length


def behind_rail(y: float) -> SingularityError:
    """Say that a platform is behind the rail, ready to be raised."""
    return SingularityError(
        'y', y, 0.0, 'm', 'behind the rail, on the mirrored assembly branch: not above')


def check_index(square: float, least: float) -> None:
    """Require a local conditioning index, given by its square."""
    index = sqrt(square)
    if index < least:
        raise SingularityError('conditioning index', index, least, '', 'below')


def check_number(number: float) -> None:
    """
    Check that N [m²] is that of the machine's branch, before the parallel singularity.

    Raises
    ------
    SingularityError
        If N ≤ 0.

    """
    if number <= 0.0:
        raise SingularityError(
            'N', number, 0.0, 'm2', 'at or beyond the parallel singularity, not above')


def check_gap(geometry: Geometry, distance1: float, distance2: float) -> None:
    """Require the order A1, A3, A2 with the gap between neighbours (eq. 18)."""
    gap = geometry.carriage_gap
    if distance1 < gap or distance1 <= 0.0:
        raise CarriageGapError('q3 - q1', distance1, gap, 'm', 'below' if gap else 'not above')
    if distance2 < gap or distance2 <= 0.0:
        raise CarriageGapError('q2 - q3', distance2, gap, 'm', 'below' if gap else 'not above')


def check_stroke(geometry: Geometry, q1: float, q2: float) -> None:
    """Require the outer carriages on the stroke; A3 stands between them."""
    least, greatest = geometry.stroke
    if q1 < least:
        raise StrokeLimitError('q1', q1, least, 'm', 'below')
    if q2 > greatest:
        raise StrokeLimitError('q2', q2, greatest, 'm', 'above')
