"""
Setpoints: interpolated between two, and made of poses.

A pose is certified and solved; its velocity is that of the stream of poses.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

from facade_manipulator import kinematics
from facade_manipulator.errors import InputError
from facade_manipulator.motion.limits import Triple, triple
from facade_manipulator.parameters import parameter, settings

PATH_SPACING = 0.005  # m, between the poses of a path where the request names none
LONGEST_PATH = 10000  # poses: a slip of the spacing must not stop the node for long
STREAM_GAP = 0.2  # s, pause after which poses begin a new stream


class Setpoint(NamedTuple):
    """Where the carriages should be at a time [s], in m, and how fast, in m/s."""

    time: float
    position: Triple
    velocity: Triple


def extrapolate(last: Setpoint, time: float) -> tuple[Triple, Triple]:
    """Return position and velocity that a setpoint leads to at a later time."""
    ahead = time - last.time
    position = triple(
        p + ahead * v for p, v in zip(last.position, last.velocity, strict=True))
    return position, last.velocity


def interpolate(a: Setpoint, b: Setpoint, time: float) -> tuple[Triple, Triple]:
    """Return position and velocity, at a time, on the cubic Hermite curve from a to b."""
    h = b.time - a.time
    u = (time - a.time) / h
    w = 1.0 - u
    h00, h01 = w * w * (1.0 + 2.0 * u), u * u * (1.0 + 2.0 * w)
    h10, h11 = u * w * w * h, -u * u * w * h
    slope, g10, g11 = 6.0 * u * w / h, w * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    axes = list(zip(a.position, b.position, a.velocity, b.velocity, strict=True))
    position = triple(h00 * p + h01 * q + h10 * v + h11 * w_ for p, q, v, w_ in axes)
    velocity = triple(slope * (q - p) + g10 * v + g11 * w_ for p, q, v, w_ in axes)
    return position, velocity


@settings
class GoalSettings:
    """What ik_service accepts as a goal."""

    min_conditioning: float = parameter(
        'Minimum local conditioning index of a goal (unit of length b/0.348)', default=0.05,
        minimum=0.0, maximum=1.0)


class SetpointStream:
    """Certify poses, and turn a stream of them into setpoints."""

    def __init__(self, geometry: kinematics.Geometry, settings: GoalSettings) -> None:
        self.mechanism = kinematics.Mechanism(geometry)
        self.settings = settings
        self._last: tuple[float, kinematics.Pose] | None = None

    def certify(self, pose: kinematics.Pose) -> kinematics.Carriages:
        """Return the carriages of a goal [m], or raise a LimitError: the limit it violates."""
        return self.mechanism.certify(pose, self.settings.min_conditioning)

    def path(
        self, start: kinematics.Pose, goal: kinematics.Pose, spacing: float = 0.0
    ) -> list[kinematics.Carriages]:
        """
        Carriage positions along the straight path from start to goal, both included [m].

        x, y and θ change in proportion. The spacing is the maximum distance [m] of neighbouring
        poses, measured at the head and at the platform's joints; 0 means `PATH_SPACING`.

        Raises
        ------
        InputError
            The spacing is not a number, negative, or asks for more poses than allowed.
        LimitError
            The limit that the first uncertified pose violates.

        """
        if not 0.0 <= spacing < math.inf:
            raise InputError('tolerance', f'tolerance = {spacing} m is not a distance')
        return [self.certify(pose) for pose in _straight(
            self.mechanism.geometry, start, goal, spacing or PATH_SPACING)]

    def setpoint(self, time: float, pose: kinematics.Pose) -> Setpoint:
        """
        Return the setpoint of a pose meant for a time [s].

        Its velocity is J ṗ, ṗ being the change since the last pose of the stream; a pose that
        begins a stream is passed at rest.

        Raises a LimitError with the limit that the pose violates; the stream continues with the
        next pose.
        """
        mechanism, carriages = self.mechanism, self.certify(pose)
        rates = self._rates(time, pose)
        self._last = (time, pose)
        velocity = (mechanism.carriage_velocity(pose, rates) if any(rates)
                    else kinematics.Carriages(0.0, 0.0, 0.0))
        return Setpoint(time, triple(mechanism.take_up(carriages, velocity)), triple(velocity))

    def _rates(self, time: float, pose: kinematics.Pose) -> kinematics.Twist:
        if self._last is None or not 0.0 < time - self._last[0] <= STREAM_GAP:
            return kinematics.ZERO_TWIST
        elapsed, change = time - self._last[0], kinematics.difference(pose, self._last[1])
        return kinematics.Twist(change.x / elapsed, change.y / elapsed, change.theta / elapsed)


def _straight(
    geometry: kinematics.Geometry, start: kinematics.Pose, goal: kinematics.Pose, spacing: float
) -> Iterator[kinematics.Pose]:
    change = kinematics.difference(goal, start)
    length = math.hypot(change.x, change.y) + geometry.platform_half_length * abs(change.theta)
    steps = max(1.0, math.ceil(length / spacing))
    if steps + 1 > LONGEST_PATH:
        raise InputError(
            'tolerance', f'a path of {length:.4g} m every {spacing:g} m has '
            f'{steps + 1:.0f} poses, bound {LONGEST_PATH}')
    for k in range(int(steps) + 1):
        share = k / steps
        yield kinematics.Pose(*(a + share * d for a, d in zip(start, change, strict=True)))
