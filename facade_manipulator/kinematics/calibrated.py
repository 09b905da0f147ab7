"""
Kinematics of the mechanism as it was made: unlike links and halves, rail, slide, tool, screws.

Inverse kinematics is closed. Forward kinematics begins at the pose of a mechanism whose links and
halves are alike, of the mean lengths, and takes Newton steps on the links until they vanish.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import partial
from math import cos, isfinite, sin, sqrt

import numpy as np

from facade_manipulator.errors import UnreachableError
from facade_manipulator.kinematics import inverse
from facade_manipulator.kinematics.closure import Bend, closing, Lengths, Mode, newton, STEPS
from facade_manipulator.kinematics.forward import forward_kinematics
from facade_manipulator.kinematics.geometry import (
    Carriages,
    Geometry,
    not_finite,
    Pose,
    Twist,
    Wrench,
)
from facade_manipulator.kinematics.planar import compose, invert, relative
from facade_manipulator.kinematics.rail import Rail

ROUNDING = 1e-14  # m, of the height of a carriage


class CalibratedMechanism:
    """The mechanism that was measured."""

    def __init__(self, geometry: Geometry) -> None:
        self.geometry = geometry
        self._lengths = Lengths(*geometry.link_lengths, *geometry.half_lengths)
        self._length1, self._length2, self._half1, self._half2 = self._lengths
        self._alike = Geometry(  # both links and both halves as long as their mean
            0.5 * (self._length1 + self._length2), 0.5 * (self._half1 + self._half2),
            carriage_gap=0.0)
        self.take_up = partial(inverse.take_up, geometry)
        self._frame = Pose(0.0, 0.0, geometry.rail_angle)
        self._rail = Rail(geometry)
        self._tool = Pose(*geometry.tool)
        self._platform_on_tool = invert(self._tool)
        self._screws = tuple(
            Screw(offset, geometry.screw_span, errors) for offset, errors in zip(
                geometry.carriage_offsets, geometry.screw_errors, strict=True))

    def platform(self, head: Pose) -> Pose:
        """Pose of the platform on the real rail."""
        return compose(relative(self._frame, head), self._platform_on_tool)

    def head(self, platform: Pose) -> Pose:
        """Pose of the head in frame rail."""
        return compose(compose(self._frame, platform), self._tool)

    def on_rail(self, carriages: tuple[float, float, float]) -> Carriages:
        """Return where on the rail the carriages stand [m]."""
        return Carriages(*(
            screw.actual(q) for screw, q in zip(self._screws, carriages, strict=True)))

    def inverse_kinematics(self, pose: Pose) -> Carriages:
        """Carriage positions of a pose, as the drives count them [m]."""
        platform = self._platform_of(pose)
        return self._driven(self._actual(platform, self._links(platform)))

    def forward_kinematics(self, carriages: Carriages) -> Pose:
        """Pose of the head."""
        return self.head(self._assembled(self._checked_on_rail(carriages)))

    def jacobian(self, pose: Pose) -> np.ndarray:
        """Jacobian from rates of the head to carriage rates, shape (3, 3)."""
        return np.array([self.carriage_velocity(pose, Twist(*unit)) for unit in np.eye(3)]).T

    def carriage_velocity(self, pose: Pose, velocity: Twist) -> Carriages:
        """Carriage velocities of a velocity of the head [m/s]."""
        platform = self._platform_of(pose)
        at = self._links(platform)
        y1, t1, y2, t2 = inverse.jacobian_entries(at, self._half1, self._half2)
        cosine, sine = cos(self._frame.theta), sin(self._frame.theta)
        arm = compose(Pose(0.0, 0.0, platform.theta), self._tool)  # from P to the head
        vx = cosine * velocity.x + sine * velocity.y + arm.y * velocity.theta
        vy = cosine * velocity.y - sine * velocity.x - arm.x * velocity.theta
        rail, actual = self._rail, self._actual(platform, at)
        rates = ((vx + y1 * vy + t1 * velocity.theta) / (1.0 + y1 * rail.slope(actual.q1)),
                 (vx + y2 * vy + t2 * velocity.theta) / (1.0 + y2 * rail.slope(actual.q2)),
                 (vx + rail.lean(actual.q3) * vy) / rail.rate(actual.q3, platform.y))
        return Carriages(*(
            rate * screw.rate(q) for rate, screw, q in zip(
                rates, self._screws, actual, strict=True)))

    def end_effector_force(self, pose: Pose, carriage_forces: Carriages) -> Wrench:
        """Wrench Jᵀτ that carriage forces exert through the head."""
        return Wrench(*(self.jacobian(pose).T @ carriage_forces).tolist())

    def certify(self, pose: Pose, min_conditioning: float = inverse.MIN_CONDITIONING) -> Carriages:
        """Check a pose of the head; the gap is that on the rail, the stroke the drives'."""
        platform = self._platform_of(pose)
        at = self._links(platform)
        if platform.y <= 0.0:
            raise inverse.behind_rail(platform.y)
        actual = self._actual(platform, at)
        driven = self._driven(actual)
        self._check_rail(actual, driven)
        unit = self.geometry.platform_half_length / inverse.CONDITIONING_RATIO
        inverse.check_branch(self._branch_number(at), inverse.squared_index(
            at, self._half1 / unit, self._half2 / unit), min_conditioning)
        return driven

    def check(self, *path: Carriages) -> None:
        """Check carriage positions in turn: that the mechanism closes and may stand there."""
        for carriages in path:
            actual = self._checked_on_rail(carriages)
            self._check_rail(actual, carriages)
            self._assembled(actual)

    def _platform_of(self, head: Pose) -> Pose:
        x, y, theta = head
        if not isfinite(x + y + theta):
            raise not_finite(Pose(x, y, theta))
        return self.platform(head)

    def _checked_on_rail(self, carriages: Carriages) -> Carriages:
        if not all(map(isfinite, carriages)):
            raise not_finite(Carriages(*carriages))
        return self.on_rail(carriages)

    def _check_rail(self, actual: Carriages, driven: Carriages) -> None:
        q1, q2, q3 = actual
        play1, play2, _ = self.geometry.backlash
        inverse.check_rail(self.geometry, q3 - q1, q2 - q3,
                   driven[0] - 0.5 * play1, driven[1] + 0.5 * play2)

    def _links(self, platform: Pose) -> inverse.Links:
        """Return the links of a pose of the platform, as `links` does, from the rail's heights."""
        x, y, theta = platform
        sine, cosine = sin(theta), cos(theta)
        u1, s1 = self._link('|y - b1 sin theta|', x - self._half1 * cosine,
                            y - self._half1 * sine, self._length1, 1.0)
        u2, s2 = self._link('|y + b2 sin theta|', x + self._half2 * cosine,
                            y + self._half2 * sine, self._length2, -1.0)
        return sine, cosine, u1, u2, s1, s2

    def _link(
        self, name: str, x: float, y: float, length: float, side: float
    ) -> tuple[float, float]:
        """
        Return height and projection of a link from the rail to a joint of the platform [m].

        Newton's method on the height of the carriage, which is 0 at once on a straight rail.
        """
        foot = 0.0
        for _ in range(STEPS):
            u = y - foot
            root = length * length - u * u
            if root <= 0.0:
                break
            projection = sqrt(root)
            q = x + side * projection
            miss = self._rail.height(q) - foot
            if abs(miss) <= ROUNDING:
                return u, projection
            foot += miss / (1.0 - side * self._rail.slope(q) * u / projection)
        raise UnreachableError(name, abs(u), length, 'm', 'not below')

    def _actual(self, platform: Pose, at: inverse.Links) -> Carriages:
        """Return where on the rail the carriages of links stand."""
        x, y, _ = platform
        return Carriages(x - self._half1 * at[1] + at[4], x + self._half2 * at[1] - at[5],
                         self._rail.under(x, y))

    def _driven(self, actual: Carriages) -> Carriages:
        return Carriages(*(
            screw.driven(q) for screw, q in zip(self._screws, actual, strict=True)))

    def _branch_number(self, at: inverse.Links) -> float:
        """N [m²], by the mean half length: what it is for equal ones."""
        sine, cosine, u1, u2, s1, s2 = at
        number = (u1 * self._half2 * (u2 * cosine - s2 * sine)
                  + u2 * self._half1 * (u1 * cosine + s1 * sine))
        return 2.0 * number / (self._half1 + self._half2)

    def _assembled(self, actual: Carriages) -> Pose:
        """Return the platform's pose on the machine's branch for carriages on the rail."""
        q1, q2, q3 = actual
        between, (_, y, theta) = (q1 - q3, q2 - q3), forward_kinematics(self._alike, actual)
        height1, height2, height3 = map(self._rail.height, actual)
        bend = Bend(height1 - height3, height2 - height3, self._rail.lean(q3))
        found = newton(self._lengths, *between, y - height3, theta, bend)
        if found is None or not self._on_branch(between, found, bend):
            raise UnreachableError('assembly modes on the branch', 0, 1, '', 'below')
        y, theta = found
        return Pose(q3 - y * bend.lean, y + height3, theta)

    def _on_branch(self, between: tuple[float, float], mode: Mode, bend: Bend) -> bool:
        at = closing(self._lengths, *between, *mode, bend)
        return mode[0] > 0.0 and at[4] > 0.0 and at[5] > 0.0 and self._branch_number(at) > 0.0


class Screw:
    """
    One carriage's way from its drive's position q to its position Q on the rail.

    Q = q + offset + e(q), with e linear between the entries of the screw's table and constant
    beyond them; so the way back is exact too.

    The offset is Q at q = 0 without the table [m]; the entries [m] are evenly spaced over the span
    of q [m], a single one is constant.
    """

    def __init__(
        self, offset: float, span: tuple[float, float], errors: tuple[float, ...]
    ) -> None:
        first, last = span
        count = max(1, len(errors) - 1)
        self._driven = tuple(first + (last - first) * k / count for k in range(len(errors)))
        self._actual = tuple(
            q + offset + error for q, error in zip(self._driven, errors, strict=True))
        pieces = len(errors) - 1
        self._slopes = (1.0, *(
            (self._actual[k + 1] - self._actual[k]) / (self._driven[k + 1] - self._driven[k])
            for k in range(pieces)), 1.0)

    def actual(self, driven: float) -> float:
        """Return Q of q [m]."""
        k = bisect_right(self._driven, driven)
        near = max(k - 1, 0)
        return self._actual[near] + self._slopes[k] * (driven - self._driven[near])

    def driven(self, actual: float) -> float:
        """Return q of Q [m]."""
        k = bisect_right(self._actual, actual)
        near = max(k - 1, 0)
        return self._driven[near] + (actual - self._actual[near]) / self._slopes[k]

    def rate(self, actual: float) -> float:
        """Return dq/dQ at Q."""
        return 1.0 / self._slopes[bisect_right(self._actual, actual)]
