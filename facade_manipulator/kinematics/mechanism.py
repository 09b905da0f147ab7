"""
Kinematics of the mechanism with its calibration errors, which default to zero.

Poses are those of the head in frame `rail`; carriages are positions of the drives. The real rail
may be rotated in frame `rail`, and each carriage may have an offset to its drive. Both links and
both halves of the platform may differ, and the head has a pose on the platform.
"""

from __future__ import annotations

from math import cos, isfinite, sin, sqrt
from typing import TYPE_CHECKING

from facade_manipulator.errors import SingularityError, UnreachableError
from facade_manipulator.kinematics import forward, inverse
from facade_manipulator.kinematics.geometry import (
    Carriages,
    Geometry,
    not_finite,
    Pose,
    Twist,
    Wrench,
)
from facade_manipulator.kinematics.jacobian import jacobian
from facade_manipulator.kinematics.planar import compose, invert, relative

if TYPE_CHECKING:
    import numpy as np

CLOSED = 1e-9  # m², tolerance of a link's squared length


class Mechanism:
    """
    Kinematics of a machine; without errors the results equal those of the drawing bit for bit.

    Parameters
    ----------
    geometry : Geometry

    """

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self._is_nominal = geometry.is_nominal
        self._link1, self._link2 = geometry.link_lengths
        self._half1, self._half2 = geometry.half_lengths
        self._is_alike = self._link1 == self._link2 and self._half1 == self._half2
        self._frame, self._tool = (
            Pose(0.0, 0.0, geometry.rail_angle),
            Pose(*geometry.tool),
        )
        self._platform_on_tool = invert(self._tool)

    def platform(self, head: Pose) -> Pose:
        """Return the pose of the platform on the real rail [m, m, rad]."""
        if self._is_nominal:
            return head
        return compose(relative(self._frame, head), self._platform_on_tool)

    def head(self, platform: Pose) -> Pose:
        """Return the pose of the head in frame `rail` [m, m, rad]."""
        return compose(compose(self._frame, platform), self._tool)

    def on_rail(self, carriages: tuple[float, float, float]) -> Carriages:
        """Return the positions of the carriages on the real rail [m]."""
        q1, q2, q3 = carriages
        offset1, offset2, offset3 = self.geometry.carriage_offsets
        return Carriages(q1 + offset1, q2 + offset2, q3 + offset3)

    def inverse_kinematics(self, pose: Pose) -> Carriages:
        """
        Return the carriages of a pose [m] by eqs 7-9, with the lengths of each side.

        Raises a ParameterError or an UnreachableError, as `inverse_kinematics` of a geometry.
        """
        if self._is_nominal:
            return inverse.inverse_kinematics(self.geometry, pose)
        platform = self._finite_platform(pose)
        return self._counted(self._actual(platform, self._links(platform)))

    def forward_kinematics(self, carriages: Carriages) -> Pose:
        """
        Return the pose of the head on the machine's branch [m, m, rad].

        Raises a ParameterError, UnreachableError or SingularityError, as `forward_kinematics` of a
        geometry.
        """
        if self._is_nominal:
            return forward.forward_kinematics(self.geometry, carriages)
        if not all(map(isfinite, carriages)):
            raise not_finite(Carriages(*carriages))
        return self.head(self._assembled(self.on_rail(carriages)))

    def jacobian(self, pose: Pose) -> np.ndarray:
        """Return the Jacobian from rates of the head to carriage rates [1, 1, m/rad]."""
        if self._is_nominal:
            return jacobian(self.geometry, pose)
        import numpy as np

        return np.array(
            [self.carriage_velocity(pose, Twist(*unit)) for unit in np.eye(3)]
        ).T

    def carriage_velocity(self, pose: Pose, velocity: Twist) -> Carriages:
        """Return the carriage velocities J·v for a velocity v of the head [m/s]."""
        platform = self._finite_platform(pose)
        y1, t1, y2, t2 = inverse.jacobian_entries(
            self._links(platform), self._half1, self._half2
        )
        vx, vy, omega = velocity
        if not self._is_nominal:
            cosine, sine = cos(self._frame.theta), sin(self._frame.theta)
            arm = compose(
                Pose(0.0, 0.0, platform.theta), self._tool
            )  # vector from P to the head
            vx, vy = (
                cosine * vx + sine * vy + arm.y * omega,
                cosine * vy - sine * vx - arm.x * omega,
            )
        return Carriages(vx + y1 * vy + t1 * omega, vx + y2 * vy + t2 * omega, vx)

    def end_effector_force(self, pose: Pose, carriage_forces: Carriages) -> Wrench:
        """
        Return the wrench Jᵀτ on the head from carriage forces τ along the rail [N, N, N m].

        By virtual work, Fᵀ ṗ = τᵀ q̇ for every motion. Friction and weight are neglected.
        """
        return Wrench(*(self.jacobian(pose).T @ carriage_forces).tolist())

    def carriage_forces(self, pose: Pose, wrench: Wrench) -> Carriages:
        """
        Return the carriage forces J⁻ᵀF along the rail [N] for a wrench F of the head.

        Raises a SingularityError at an exactly singular pose, otherwise the errors of
        `inverse_kinematics`.
        """
        import numpy as np

        try:
            return Carriages(*np.linalg.solve(self.jacobian(pose).T, wrench).tolist())
        except np.linalg.LinAlgError:
            raise SingularityError('|N|', 0.0, 0.0, 'm2', 'not above') from None

    def certify(
        self, pose: Pose, min_conditioning: float = inverse.MIN_CONDITIONING
    ) -> Carriages:
        """
        Return the carriages of a pose [m] that respects all limits of the machine.

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
        platform = self._finite_platform(pose)
        at = self._links(platform)
        if platform.y <= 0.0:
            raise inverse.behind_rail(platform.y)
        actual = self._actual(platform, at)
        counted = self._counted(actual)
        self._check_rail(actual, counted)
        unit = self.geometry.platform_half_length / inverse.CONDITIONING_RATIO
        inverse.check_branch(
            self._branch_number(at),
            inverse.squared_index(at, self._half1 / unit, self._half2 / unit),
            min_conditioning,
        )
        return counted

    def check(self, *path: Carriages) -> None:
        """
        Require that the links close at each of the carriage positions on the machine's branch.

        Stroke and gap are also required, conditioning is not. Raises the errors of `certify`.
        """
        for carriages in path:
            if not all(map(isfinite, carriages)):
                raise not_finite(Carriages(*carriages))
            actual = q1, q2, q3 = self.on_rail(carriages)
            self._check_rail(actual, carriages)
            if not self._is_alike:
                self._assembled(actual)
                continue
            left, right = q1 - q3, q2 - q3  # takes half the time of computing the pose
            y, sine, cosine = forward.close(self._link1, self._half1, left, right)
            rise, span = self._half1 * sine, self._half1 * cosine
            inverse.check_branch(
                inverse.branch_number(
                    (sine, cosine, y - rise, y + rise, left + span, span - right)
                )
            )

    def _finite_platform(self, head: Pose) -> Pose:
        x, y, theta = head
        if not isfinite(x + y + theta):
            raise not_finite(Pose(x, y, theta))
        return self.platform(Pose(x, y, theta))

    def _links(self, platform: Pose) -> inverse.Links:
        """Return the terms `links` of a pose of the platform, with the lengths of each side."""
        if self._is_nominal:
            return inverse.links(self.geometry, platform)
        _, y, theta = platform
        sine, cosine = sin(theta), cos(theta)
        u1, u2 = y - self._half1 * sine, y + self._half2 * sine
        for name, reach, length in (
            ('|y - b1 sin theta|', u1, self._link1),
            ('|y + b2 sin theta|', u2, self._link2),
        ):
            if abs(reach) >= length:
                raise UnreachableError(
                    name, abs(reach), length, 'm', 'not below', 'geometry.link_length'
                )
        return (
            sine,
            cosine,
            u1,
            u2,
            sqrt(self._link1 * self._link1 - u1 * u1),
            sqrt(self._link2 * self._link2 - u2 * u2),
        )

    def _actual(self, platform: Pose, at: inverse.Links) -> Carriages:
        """Return the positions of the carriages on the real rail [m] from the links of a pose."""
        return Carriages(
            platform.x - self._half1 * at[1] + at[4],
            platform.x + self._half2 * at[1] - at[5],
            platform.x,
        )

    def _counted(self, actual: Carriages) -> Carriages:
        """Return the drive positions of carriages on the real rail [m]."""
        offset1, offset2, offset3 = self.geometry.carriage_offsets
        return Carriages(actual.q1 - offset1, actual.q2 - offset2, actual.q3 - offset3)

    def _check_rail(self, actual: Carriages, counted: Carriages) -> None:
        """Require the gap on the real rail and the stroke of the drives [m]."""
        inverse.check_rail(
            self.geometry,
            actual[2] - actual[0],
            actual[1] - actual[2],
            counted[0],
            counted[1],
        )

    def _branch_number(self, at: inverse.Links) -> float:
        """Return N [m²] of `parallel_singularity` for halves that may differ."""
        sine, cosine, u1, u2, s1, s2 = at
        number = u1 * self._half2 * (u2 * cosine - s2 * sine) + u2 * self._half1 * (
            u1 * cosine + s1 * sine
        )
        return 2.0 * number / (self._half1 + self._half2)

    def _assembled(self, actual: Carriages) -> Pose:
        """Return the platform's pose on the machine's branch [m, m, rad]."""
        q1, q2, q3 = actual
        left, right = q1 - q3, q2 - q3
        if not -forward.FARTHEST < left < right < forward.FARTHEST:
            raise forward.not_in_order(actual)
        y, theta = forward.assemble(
            (self._link1, self._link2, self._half1, self._half2), left, right
        )
        sine, cosine = sin(theta), cos(theta)
        u1, u2 = y - self._half1 * sine, y + self._half2 * sine
        s1, s2 = left + self._half1 * cosine, self._half2 * cosine - right
        is_closed = (
            max(
                abs(s1 * s1 + u1 * u1 - self._link1 * self._link1),
                abs(s2 * s2 + u2 * u2 - self._link2 * self._link2),
            )
            < CLOSED
        )
        if not (is_closed and min(y, s1, s2) > 0.0):
            raise UnreachableError('assembly modes on the branch', 0, 1, '', 'below')
        inverse.check_branch(self._branch_number((sine, cosine, u1, u2, s1, s2)))
        return Pose(q3, y, theta)
