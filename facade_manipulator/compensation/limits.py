"""What bounds the head's path: speed and acceleration first, the workspace last."""

from __future__ import annotations

from itertools import repeat
import math
from typing import NamedTuple

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import (
    Geometry,
    Mechanism,
    Pose,
    subtract,
    Twist,
    ZERO_POSE,
    ZERO_TWIST,
)
from facade_manipulator.parameters import parameter, settings

BRAKING_SHARE = 0.5  # of the acceleration: what remains is for the target's own
REFINEMENTS = 3  # of y for the x that was held back, whose limit depends on y a little
# Depth over which an axis is bent into the limit, so that the head meets it without a jerk.
KNEE, HEIGHT_KNEE, YAW_KNEE = 0.03, 0.01, 0.02  # m, m, rad: x, y, theta


class Tracker:
    """
    Step towards a moving pose, each axis within its limits: exactly, as long as they allow.

    The limits are those of speed [m/s, m/s, rad/s] and acceleration [m/s², m/s², rad/s²].
    """

    def __init__(self, speed: tuple[float, ...], acceleration: tuple[float, ...]) -> None:
        self.change_limits(speed, acceleration)
        self._time: float | None = None
        self._position = self._target = ZERO_POSE
        self._velocity = ZERO_TWIST

    def change_limits(self, speed: tuple[float, ...], acceleration: tuple[float, ...]) -> None:
        """Keep other limits from the next step on; what is too fast brakes."""
        self._speed, self._acceleration = speed, acceleration

    def reset(self) -> None:
        """Begin again at the next target."""
        self._time = None

    def step(self, time: float, target: Pose) -> Pose:
        """Return the pose at a time [s], later than the last one, for a target then."""
        if self._time is None or time <= self._time:
            self._position, self._velocity = target, ZERO_TWIST
        else:
            interval = time - self._time
            self._velocity = Twist(*map(
                _velocity, repeat(interval), self._position, self._velocity, target, self._target,
                self._speed, self._acceleration))
            self._position = Pose(*(
                p + v * interval for p, v in zip(self._position, self._velocity, strict=True)))
        self._time, self._target = time, target
        return self._position


def _velocity(
    interval: float, position: float, velocity: float, target: float, last_target: float,
    speed: float, acceleration: float,
) -> float:
    """Return the velocity that reaches the target, or approaches it so that it can brake."""
    change = acceleration * interval
    direct = (target - position) / interval
    if abs(direct) <= speed and abs(direct - velocity) <= change:
        return direct
    target_velocity = (target - last_target) / interval
    tracking_error = last_target - position
    braking = math.sqrt(2.0 * BRAKING_SHARE * acceleration * abs(tracking_error))
    approach = math.copysign(min(abs(tracking_error) / interval, braking), tracking_error)
    wanted = min(max(target_velocity + approach, -speed), speed)
    return min(max(wanted, velocity - change), velocity + change)


@settings
class WorkspaceLimitSettings:
    """How close to the limits of the mechanism the compensation goes."""

    margin: float = parameter(
        'Distance kept from reach, stroke and carriage gap', default=0.004, unit='m', minimum=1e-4,
        maximum=0.1)


class Saturated(NamedTuple):
    """A pose inside the limit and by how much each axis was held back [m, m, rad]."""

    pose: Pose
    saturation_error: Pose


class WorkspaceLimit:
    """
    Keep poses inside the workspace: y first, then θ at this y, then x at both.

    At fixed (y, θ) reach and order of the carriages do not depend on x, and x has one interval;
    at fixed y the yaw has one, symmetric about 0.

    Raises a ParameterError if the margin leaves no workspace.
    """

    def __init__(self, geometry: Geometry, settings: WorkspaceLimitSettings) -> None:
        self._settings = settings
        self._half = geometry.platform_half_length
        self._mechanism = Mechanism(geometry)
        self._clamped = self._clamped_platform if geometry.is_nominal else self._clamped_head
        margin = settings.margin + 3.0 * _greatest(geometry.link_errors, geometry.platform_errors)
        self._reach = geometry.link_length - margin
        self._gap = geometry.carriage_gap + margin
        least, greatest = geometry.stroke
        margin = settings.margin + sum(map(
            _greatest, (geometry.carriage_offsets, geometry.backlash)))
        self._stroke = least + margin, greatest - margin
        self._halves = geometry.half_lengths
        self._link_squares = tuple(length * length for length in geometry.link_lengths)
        self._order = (self._half - self._gap) ** 2 - geometry.link_length ** 2  # (b − gap)² − l²
        self._height = self._heights()
        if self._height[0] >= self._height[1]:
            raise ParameterError(
                f'margin = {settings.margin:g} m leaves no workspace in y: from '
                f'{self._height[0]:.4g} m to {self._height[1]:.4g} m')

    def saturate(self, pose: Pose, slope: float = 0.0) -> Saturated:
        """
        Return the pose of the workspace for a wanted one, which may lie outside.

        Where x is held back, y is changed with it by the slope, the tangent of the angle from the
        wall to the rail, so that the head keeps its distance from the wall instead of the rail.
        """
        inside = self._clamped(pose)
        if slope != 0.0 and inside.saturation_error.x != 0.0:
            for _ in range(REFINEMENTS):  # the end of x depends on y a little
                inside = self._clamped(pose._replace(y=pose.y + slope * inside.saturation_error.x))
        return inside

    def _clamped_head(self, pose: Pose) -> Saturated:
        """Clamp the platform of a head that is not in its middle, on a rail that is turned."""
        platform = self._clamped_platform(self._mechanism.platform(pose))
        if platform.saturation_error == ZERO_POSE:
            return Saturated(pose, ZERO_POSE)
        inside = self._mechanism.head(platform.pose)
        return Saturated(inside, subtract(pose, inside))

    def _clamped_platform(self, pose: Pose) -> Saturated:
        y = soft_clamp(pose.y, *self._height, HEIGHT_KNEE)
        yaw = self._greatest_yaw(y)
        theta = soft_clamp(pose.theta, -yaw, yaw, YAW_KNEE)
        x = soft_clamp(pose.x, *self._widths(y, theta), KNEE)
        return Saturated(
            Pose(x, y, theta), Pose(pose.x - x, pose.y - y, pose.theta - theta))

    def _heights(self) -> tuple[float, float]:
        """Return the y-interval at θ = 0, by carriage gap and reach; never behind the rail."""
        nearest = math.sqrt(max(-self._order, 0.0))
        return max(nearest, self._settings.margin), self._reach

    def _greatest_yaw(self, y: float) -> float:
        """Return the yaw limit by order (on the safe side: cos θ = 1 at the gap) and reach."""
        order = 0.5 * (y + self._order / y)
        # the lesser of order and reach is half - gap at most, so that the sine is below 1
        return math.asin(max(min(order, self._reach - y), 0.0) / self._half)

    def _widths(self, y: float, theta: float) -> tuple[float, float]:
        """Return the x-interval at (y, θ), by the stroke of the outer carriages."""
        sine, cosine = math.sin(theta), math.cos(theta)
        (half1, half2), (square1, square2) = self._halves, self._link_squares
        height1, height2 = y - half1 * sine, y + half2 * sine
        first = math.sqrt(max(square1 - height1 * height1, 0.0))
        second = math.sqrt(max(square2 - height2 * height2, 0.0))
        return self._stroke[0] + half1 * cosine - first, self._stroke[1] - half2 * cosine + second


def _greatest(*errors: tuple[float, ...]) -> float:
    return max(abs(error) for some in errors for error in some)


def soft_clamp(value: float, low: float, high: float, knee: float) -> float:
    """
    Clamp a value to an interval, with a parabola in place of each corner.

    Within `knee` of an end the value is held back progressively and reaches the end one knee
    beyond it. An empty interval gives its middle.
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
