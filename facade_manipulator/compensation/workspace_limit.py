"""Saturation of corrected poses at the limits of the mechanism, one axis after another."""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import (
    CONDITIONING_RATIO,
    Geometry,
    Mechanism,
    Pose,
    subtract,
    ZERO_POSE,
)
from facade_manipulator.kinematics.links import (
    branch_number,
    Links,
    links,
    squared_index,
    x_interval,
)


class Saturated(NamedTuple):
    """Pose inside the limits, and the part removed from each axis [m, m, rad]."""

    pose: Pose
    saturation_error: Pose


class WorkspaceLimit:
    """
    Limits of the workspace: limit y first, then θ for this y, then x for both.

    At fixed (y, θ) reach and order of the carriages do not depend on x, and x has one interval. At
    fixed y the yaw has one interval, symmetric about 0. Where the platform is long in comparison
    with the links, the conditioning or the stroke ends this interval before reach and order do.

    Parameters
    ----------
    geometry : Geometry
        Of the machine.
    min_conditioning : float
        Minimum conditioning index of a pose, as of `Mechanism.certify`.

    Raises
    ------
    ParameterError
        If no workspace is left.

    """

    WORKSPACE_MARGIN = 0.004  # m, distance kept from reach, stroke and carriage gap
    # iterations of y for a limited x, whose limit depends slightly on y
    REFINEMENTS = 3
    # Depth over which an axis is bent into the limit, so that the head meets it without a jerk.
    KNEE, Y_KNEE, YAW_KNEE = 0.03, 0.01, 0.02  # m, m, rad: x, y, theta
    SEARCHED_PLACES = 201  # number of y in the search for the interval at θ = 0
    HALVINGS = 24  # of the interval in the search for a yaw; the last is below 1e-7 rad

    def __init__(self, geometry: Geometry, min_conditioning: float) -> None:
        self._min_conditioning = min_conditioning
        self._half = geometry.platform_half_length
        self._mechanism = Mechanism(geometry)
        _, _, half1, half2 = self._mechanism.sides
        length = self._half / CONDITIONING_RATIO  # m, characteristic length
        self._ratios = half1 / length, half2 / length
        errors = 3.0 * _greatest(geometry.link_errors, geometry.platform_errors)
        self._reach = geometry.link_length - self.WORKSPACE_MARGIN - errors
        self._gap = geometry.carriage_gap + self.WORKSPACE_MARGIN + errors
        least, greatest = geometry.stroke
        margin = self.WORKSPACE_MARGIN + _greatest(geometry.carriage_offsets)
        self._stroke = least + margin, greatest - margin
        self._order = (
            self._half - self._gap
        ) ** 2 - geometry.link_length**2  # (b − gap)² − l²
        self._span_y = self._y_interval()

    def saturate(self, pose: Pose, slope: float) -> Saturated:
        """
        Return the pose inside the workspace that replaces a desired pose.

        A change of x changes y by the slope, the tangent of the angle from the wall to the rail.
        The head then keeps its distance from the wall instead of the rail.
        """
        inside = self._clamped(pose)
        if slope != 0.0 and inside.saturation_error.x != 0.0:
            for _ in range(self.REFINEMENTS):  # the limit of x depends slightly on y
                inside = self._clamped(
                    pose._replace(y=pose.y + slope * inside.saturation_error.x)
                )
        return inside

    def _clamped(self, pose: Pose) -> Saturated:
        """Return the head's pose [m, m, rad] after moving its platform inside the workspace."""
        platform = self._clamped_platform(self._mechanism.platform(pose))
        if platform.saturation_error == ZERO_POSE:
            return Saturated(pose, ZERO_POSE)
        inside = self._mechanism.head(platform.pose)
        return Saturated(inside, subtract(pose, inside))

    def _clamped_platform(self, pose: Pose) -> Saturated:
        """
        Return a platform pose inside the softened limits, and the part removed.

        The order of the limits is: y, yaw at this y, x at this y and yaw.
        """
        y = soft_clamp(pose.y, *self._span_y, self.Y_KNEE)
        yaw = self._greatest_yaw(y)
        theta = soft_clamp(pose.theta, -yaw, yaw, self.YAW_KNEE)
        x_limits = self._x_interval(self._links(y, theta))
        x = soft_clamp(pose.x, *x_limits, self.KNEE)
        return Saturated(
            Pose(x, y, theta), Pose(pose.x - x, pose.y - y, pose.theta - theta)
        )

    def _y_interval(self) -> tuple[float, float]:
        """
        Return the y-interval [m] at θ = 0, which is never behind the rail.

        Carriage gap and reach define its ends; conditioning or stroke may end it earlier.
        """
        nearest = max(math.sqrt(max(-self._order, 0.0)), self.WORKSPACE_MARGIN)
        step = (self._reach - nearest) / (self.SEARCHED_PLACES - 1)
        places = [nearest + number * step for number in range(self.SEARCHED_PLACES - 1)]
        places.append(self._reach)
        usable = [y for y in places if step > 0.0 and self._is_usable(y, 0.0)]
        if not usable:
            raise ParameterError(
                f'geometry rejected: it leaves no workspace in y, from {nearest:.4g} m to '
                f'{self._reach:.4g} m; next: check link_length, carriage_gap, stroke and '
                'reference.min_conditioning'
            )
        return usable[0], usable[-1]

    def _greatest_yaw(self, y: float) -> float:
        """
        Return the yaw limit [rad] from order, reach, conditioning and stroke.

        The order assumes cos θ = 1 at the gap, which is on the safe side.
        """
        order = 0.5 * (y + self._order / y)
        # the lesser of order and reach is half - gap at most, so that the sine is below 1
        least = max(min(order, self._reach - y), 0.0)
        yaw = math.asin(least / self._half)
        if self._is_usable(y, yaw) and self._is_usable(y, -yaw):
            return yaw

        usable = 0.0
        for _ in range(self.HALVINGS):
            middle = 0.5 * (usable + yaw)
            if self._is_usable(y, middle) and self._is_usable(y, -middle):
                usable = middle
            else:
                yaw = middle
        return usable

    def _is_usable(self, y: float, theta: float) -> bool:
        """Return whether conditioning and stroke permit a pose (y, θ) [m, rad] for some x."""
        at = self._links(y, theta)
        lowest, highest = self._x_interval(at)
        if lowest > highest:
            return False
        ratio1, ratio2 = self._ratios
        if branch_number(at, ratio1, ratio2) <= 0.0:
            return False
        return squared_index(at, ratio1, ratio2) >= self._min_conditioning**2

    def _links(self, y: float, theta: float) -> Links:
        """Return the terms of `kinematics.links` at (y, θ) [m, rad]; s1, s2 are 0 out of reach."""
        return links(self._mechanism.sides, y, theta, root=_root_or_zero)

    def _x_interval(self, at: Links) -> tuple[float, float]:
        """Return the x-interval [m] at these links, which the stroke of the carriages limits."""
        _, cosine, _, _, s1, s2 = at
        return x_interval(self._mechanism.sides, self._stroke, cosine, s1, s2)


def _root_or_zero(square: float) -> float:
    return math.sqrt(max(square, 0.0))


def _greatest(*errors: tuple[float, ...]) -> float:
    return max(abs(error) for some in errors for error in some)


def soft_clamp(value: float, low: float, high: float, knee: float) -> float:
    """
    Clamp a value to an interval; a parabola replaces each corner.

    Within `knee` of an end the output is bent progressively. The output reaches the end for a
    value one knee beyond the end. An empty interval returns its middle.
    """
    middle = 0.5 * (low + high)
    half = max(high - middle, 0.0)
    knee = min(knee, 0.5 * half)
    distance = abs(value - middle)
    inside = half - knee
    if distance <= inside:
        return value
    if distance >= half + knee or knee == 0.0:
        return middle + math.copysign(half, value - middle)
    bent = distance - (distance - inside) ** 2 / (4.0 * knee)
    return middle + math.copysign(bent, value - middle)
