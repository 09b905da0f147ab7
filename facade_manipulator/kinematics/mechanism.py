"""
Kinematics of the mechanism with calibration errors, which are zero by default.

Poses are poses of the head in frame `rail`. Carriages are positions of the drives. The real rail
may be rotated in frame `rail`, and each carriage may have an offset to its drive. Both links and
both halves of the platform may differ, and the head has a pose on the platform. With the angle α
of the rail, the pose T of the head on the platform and the offsets o::

    platform = Rot(−α) head T⁻¹,    drive position = position on the rail − o.

The formulas between the platform and the carriages on the rail are in `links` and `closure`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, isfinite, sin, sqrt
import struct
from typing import TYPE_CHECKING

from facade_manipulator.errors import (
    CarriageGapError,
    ManipulatorError,
    SingularityError,
    StrokeLimitError,
    UnreachableError,
)
from facade_manipulator.kinematics.closure import (
    assemble,
    MAXIMUM_REACH,
    require_branch,
    require_regular,
)
from facade_manipulator.kinematics.geometry import (
    Carriages,
    Geometry,
    not_finite_error,
    Pose,
    Twist,
    Wrench,
)
from facade_manipulator.kinematics.links import (
    branch_number,
    Links,
    links,
    squared_index,
)
from facade_manipulator.kinematics.planar import compose, invert, relative

if TYPE_CHECKING:
    import numpy as np

# b over the unit of length of the index. That unit is 1 m for the design and grows with the
# mechanism, so that the same poses are well conditioned at every size.
CONDITIONING_RATIO = 0.348
# With that unit, the order of the carriages keeps the index of the design above 0.07 near the
# rail. Towards the far edge the index falls to 0 as the links become upright. At θ = 0 it falls
# below 0.05 within 0.1 mm of the edge, where carriages already move 40 times faster than the head.
MIN_CONDITIONING = 0.05

_new_tuple = tuple.__new__  # creates a named tuple in half the time of its constructor
# writes into any buffer, also an array
_pack_matrix: Callable[..., None] = struct.Struct('9d').pack_into
# the rows of q1, q2 and q3 in the Jacobian
_Rows = tuple[float, float, float, float, float, float, float, float, float]


def _empty(shape: tuple[int, int]) -> np.ndarray:
    """Return an empty array; the first call replaces this function with numpy's."""
    global _empty
    from numpy import empty as _empty

    return _empty(shape)


class Mechanism:
    """
    Immutable kinematics of a machine; `Geometry.drawn` is the kinematics without errors.

    The nodes use it for each setpoint and each measured position. The driver uses it for targets
    and measured positions near a limit (`MechanismCheck`).

    Parameters
    ----------
    geometry : Geometry

    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self.sides = geometry.sides
        self._rail = Pose(0.0, 0.0, geometry.rail_angle)
        self._tool = Pose(*geometry.tool)
        self._platform_on_tool = invert(self._tool)
        self._offsets = geometry.carriage_offsets
        # whether head and drives need no conversion, which would take half of the time
        self._is_aligned = not any((*self._rail, *self._tool, *self._offsets))

    def platform(self, head: Pose) -> Pose:
        """Convert a head pose in frame `rail` to a platform pose on the real rail [m, m, rad]."""
        if self._is_aligned:
            return head
        return compose(relative(self._rail, head), self._platform_on_tool)

    def head(self, platform: Pose) -> Pose:
        """Convert a platform pose on the real rail to a head pose in frame `rail` [m, m, rad]."""
        if self._is_aligned:
            return platform
        return compose(compose(self._rail, platform), self._tool)

    def on_rail(self, carriages: tuple[float, float, float]) -> Carriages:
        """Convert drive positions to carriage positions on the real rail [m]."""
        q1, q2, q3 = carriages
        offset1, offset2, offset3 = self._offsets
        return _new_tuple(Carriages, (q1 + offset1, q2 + offset2, q3 + offset3))

    def links(self, pose: Pose) -> Links:
        """
        Return the terms of `kinematics.links` for a head pose, with the lengths of each side.

        Raises the errors of `inverse_kinematics`.
        """
        try:
            x, y, theta = pose if self._is_aligned else self.platform(pose)
            at = links(self.sides, y, theta)
        except ValueError:
            raise self._reach_error(pose) from None
        _, _, _, _, s1, s2 = at
        if not (s1 * s2 > 0.0 and isfinite(x)):
            raise self._reach_error(pose)
        return at

    def inverse_kinematics(self, pose: Pose) -> Carriages:
        """
        Return the carriage positions for a pose [m] from eqs 7-9, with the lengths of each side.

        Raises a ParameterError or an UnreachableError, as `inverse_kinematics` of a geometry.
        """
        try:
            x, y, theta = pose if self._is_aligned else self.platform(pose)
            _, cosine, _, _, s1, s2 = links(self.sides, y, theta)
        except ValueError:
            raise self._reach_error(pose) from None
        if not (s1 * s2 > 0.0 and isfinite(x)):
            raise self._reach_error(pose)

        _, _, half1, half2 = self.sides
        actual = (x - half1 * cosine + s1, x + half2 * cosine - s2, x)
        carriages: Carriages = _new_tuple(Carriages, actual)
        return carriages if self._is_aligned else self._of_drives(carriages)

    def forward_kinematics(self, carriages: Carriages) -> Pose:
        """
        Return the head pose on the machine's branch [m, m, rad].

        Raises a ParameterError, UnreachableError or SingularityError, as `forward_kinematics` of a
        geometry.
        """
        q1, q2, q3 = carriages
        offset1, offset2, offset3 = self._offsets
        x = q3 + offset3
        left = q1 + offset1 - x
        right = q2 + offset2 - x
        # NaN fails every comparison
        if not -MAXIMUM_REACH < left < right < MAXIMUM_REACH:
            raise _order_error(self.on_rail(carriages))
        y, theta = assemble(self.sides, left, right)
        platform = _new_tuple(Pose, (x, y, theta))
        return platform if self._is_aligned else self.head(platform)

    def jacobian(self, pose: Pose) -> np.ndarray:
        """Return the Jacobian that maps head rates to carriage rates [1, 1, m/rad]."""
        matrix = _empty((3, 3))
        # a third of the time of np.array() on nested tuples
        _pack_matrix(matrix, 0, *self._rows(pose))
        return matrix

    def carriage_velocity(self, pose: Pose, velocity: Twist) -> Carriages:
        """Return the carriage velocities J·v [m/s] for a velocity v of the head."""
        x1, y1, t1, x2, y2, t2, x3, y3, t3 = self._rows(pose)
        vx, vy, omega = velocity
        rate1 = x1 * vx + y1 * vy + t1 * omega
        rate2 = x2 * vx + y2 * vy + t2 * omega
        rate3 = x3 * vx + y3 * vy + t3 * omega
        return Carriages(rate1, rate2, rate3)

    def _rows(self, pose: Pose) -> _Rows:
        """
        Return the rows of the Jacobian for the head: the platform's rows times the rates of P.

        With the angle α of the rail and the vector (tx, ty) from P to the head, along the rail::

            x' = cos α hx' + sin α hy' + ty θ',    y' = cos α hy' − sin α hx' − tx θ'.
        """
        sine, cosine, u1, u2, s1, s2 = self.links(pose)
        _, _, half1, half2 = self.sides
        y1 = -u1 / s1
        y2 = u2 / s2
        t1 = half1 * (sine - y1 * cosine)
        t2 = half2 * (y2 * cosine - sine)
        if self._is_aligned:
            return 1.0, y1, t1, 1.0, y2, t2, 1.0, 0.0, 0.0

        c = cos(self._rail.theta)
        s = sin(self._rail.theta)
        tx = cosine * self._tool.x - sine * self._tool.y
        ty = sine * self._tool.x + cosine * self._tool.y
        return (
            c - y1 * s,
            s + y1 * c,
            ty - y1 * tx + t1,
            c - y2 * s,
            s + y2 * c,
            ty - y2 * tx + t2,
            c,
            s,
            ty,
        )

    def end_effector_force(self, pose: Pose, carriage_forces: Carriages) -> Wrench:
        """
        Return the wrench Jᵀτ on the head [N, N, N m] for carriage forces τ along the rail.

        By virtual work, Fᵀ ṗ = τᵀ q̇ for every motion. Friction and weight are neglected.
        """
        return Wrench(*(self.jacobian(pose).T @ carriage_forces).tolist())

    def carriage_forces(self, pose: Pose, wrench: Wrench) -> Carriages:
        """
        Return the carriage forces J⁻ᵀF along the rail [N] for a wrench F on the head.

        Raises a SingularityError at an exactly singular pose, otherwise the errors of
        `inverse_kinematics`.
        """
        import numpy as np

        try:
            return Carriages(*np.linalg.solve(self.jacobian(pose).T, wrench).tolist())
        except np.linalg.LinAlgError:
            raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above') from None

    def certify(
        self, pose: Pose, min_conditioning: float = MIN_CONDITIONING
    ) -> Carriages:
        """
        Return the carriage positions for a pose [m]; raise an error if it violates a limit.

        Parameters
        ----------
        pose : Pose
            Of the head [m, m, rad].
        min_conditioning : float
            Minimum local conditioning index, with the unit of length b/0.348 (1 m for the design);
            0 requires only the other limits.

        Raises
        ------
        ParameterError
            If the pose is not finite (a ValueError).
        UnreachableError
            If a link is too short (eq. 19).
        StrokeLimitError
            If a carriage leaves the stroke (eq. 18).
        CarriageGapError
            If neighbouring carriages come closer than the carriage gap or change their order.
        SingularityError
            If the pose is behind the rail, at or beyond the parallel singularity N = 0, or
            conditioned worse than `min_conditioning` (eqs 24-25).

        """
        at = self.links(pose)
        y = self.platform(pose).y
        if y <= 0.0:
            raise SingularityError(
                'y',
                y,
                0.0,
                'm',
                'behind the rail, on the mirrored assembly branch: not above',
            )

        carriages = self.inverse_kinematics(pose)
        self._require_rail(carriages)
        _, _, half1, half2 = self.sides
        require_regular(branch_number(at, half1, half2))
        unit = self.geometry.platform_half_length / CONDITIONING_RATIO
        index = sqrt(squared_index(at, half1 / unit, half2 / unit))
        if index < min_conditioning:
            raise SingularityError(
                'conditioning index',
                index,
                min_conditioning,
                '',
                'below',
                'reference.min_conditioning',
            )
        return carriages

    def check(self, *path: Carriages) -> None:
        """
        Require that the links close on the machine's branch at every carriage position.

        Stroke and gap are also required, conditioning is not. Raises the errors of `certify`.
        """
        for carriages in path:
            if not all(map(isfinite, carriages)):
                raise not_finite_error(Carriages(*carriages))
            self._require_rail(carriages)
            q1, q2, q3 = self.on_rail(carriages)
            y, theta = assemble(self.sides, q1 - q3, q2 - q3)
            require_branch(self.sides, q1 - q3, q2 - q3, y, theta)

    def _reach_error(self, head: Pose) -> ManipulatorError:
        """Return the error for a head pose that is not finite or exceeds the reach of a link."""
        if not all(map(isfinite, head)):
            return not_finite_error(Pose(*head))
        _, y, theta = self.platform(head)
        link1, link2, half1, half2 = self.sides
        distance1 = abs(y - half1 * sin(theta))
        distance2 = abs(y + half2 * sin(theta))
        distance, length = max(
            (distance1, link1),
            (distance2, link2),
            key=lambda side: side[0] - side[1],
        )
        return UnreachableError(
            '|y| + b |sin theta|',
            distance,
            length,
            'm',
            'not below',
            'geometry.link_length',
        )

    def _require_rail(self, carriages: Carriages) -> None:
        """
        Require the stroke, the order A1, A3, A2, and the gap between neighbours (eq. 18).

        The stroke limits the drives, the gap the carriages on the real rail [m]. Checking the
        stroke of A1 and A2 is sufficient, because A3 is between them. Raises a StrokeLimitError or
        a CarriageGapError.
        """
        minimum, maximum = self.geometry.stroke
        q1, q2, q3 = carriages
        if q1 < minimum:
            raise StrokeLimitError('q1', q1, minimum, 'm', 'below', 'geometry.stroke')
        if q2 > maximum:
            raise StrokeLimitError('q2', q2, maximum, 'm', 'above', 'geometry.stroke')

        offset1, offset2, offset3 = self._offsets
        x = q3 + offset3
        self._require_gap('q3 - q1', x - (q1 + offset1))
        self._require_gap('q2 - q3', q2 + offset2 - x)

    def _require_gap(self, name: str, distance: float) -> None:
        """Require that a distance [m] is positive, and not less than the carriage gap."""
        gap = self.geometry.carriage_gap
        if distance < gap or distance <= 0.0:
            problem = 'below' if gap else 'not above'
            raise CarriageGapError(
                name, distance, gap, 'm', problem, 'geometry.carriage_gap'
            )

    def _of_drives(self, actual: Carriages) -> Carriages:
        """Convert carriage positions on the real rail to drive positions [m]."""
        q1, q2, q3 = actual
        offset1, offset2, offset3 = self._offsets
        return Carriages(q1 - offset1, q2 - offset2, q3 - offset3)


def _order_error(carriages: Carriages) -> ManipulatorError:
    """Return the error for carriages in the wrong order or out of reach."""
    q1, q2, q3 = carriages
    if not all(map(isfinite, carriages)):
        return not_finite_error(carriages)
    apart = max(abs(q1 - q3), abs(q2 - q3))
    if apart > MAXIMUM_REACH:
        return UnreachableError(
            'distance of a carriage from q3', apart, MAXIMUM_REACH, 'm', 'above'
        )
    return UnreachableError('q2 - q1', q2 - q1, 0.0, 'm', 'not above')
