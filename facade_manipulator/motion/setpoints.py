"""
Setpoints: compute them from poses, check them in sequence, and interpolate them.

Each pose is certified and solved for its carriages; its velocity is computed from the stream of
poses.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from facade_manipulator import kinematics
from facade_manipulator.errors import InputError, SetpointLimitError
from facade_manipulator.kinematics.geometry import AXIS_NAMES, PerCarriage
from facade_manipulator.motion.limits import plus, ZERO

STREAM_GAP = 0.2  # s, pause after which poses begin a new stream


class Setpoint(NamedTuple):
    """Positions [m] and velocities [m/s] of the carriages at a time [s]."""

    time: float
    position: PerCarriage
    velocity: PerCarriage


def require_within(
    quantity: str, values: PerCarriage, bound: float, unit: str, parameter: str = ''
) -> None:
    """Reject a value that is NaN or exceeds a limit; add the carriage's name to the quantity."""
    for carriage, value in zip(AXIS_NAMES, values, strict=True):
        if not abs(value) <= bound:
            raise SetpointLimitError(
                quantity.format(carriage), abs(value), bound, unit, 'above', parameter
            )


# s; in a shorter time, a source that compensates the backlash of its screws changes the velocity
SHORTEST_INTERVAL = 0.02


def require_possible(
    setpoint: Setpoint,
    last: Setpoint,
    first_step: float,
    speed: float,
    acceleration: float,
) -> None:
    """
    Reject a setpoint that is too fast, inconsistent, or too far from the last setpoint [m].

    Its velocity must be the mean velocity since the last setpoint, or reachable from the last
    velocity with the acceleration [m/s²].

    Raises a SetpointLimitError or an InputError.
    """
    step = plus(setpoint.position, last.position, -1.0)
    require_within('setpoint step of {}', step, first_step, 'm', 'first_step')
    require_within(
        'setpoint velocity of {}', setpoint.velocity, speed, 'm/s', 'twice limits.speed'
    )
    elapsed = setpoint.time - last.time
    backlash = 0.5 * acceleration * SHORTEST_INTERVAL
    bound = max(0.5 * acceleration * elapsed, backlash)
    for carriage, before, start, after, end in zip(
        AXIS_NAMES,
        last.position,
        last.velocity,
        setpoint.position,
        setpoint.velocity,
        strict=True,
    ):
        mean = (after - before) / elapsed
        difference = abs(end - mean)
        bend = abs(0.5 * (start + end) - mean)
        if difference > bound or (difference > backlash and bend > 0.5 * bound):
            raise InputError(
                'inconsistent',
                f'setpoint velocity of {carriage} = {end:.4g} m/s contradicts the mean velocity '
                f'{mean:.4g} m/s of its positions, after {start:.4g} m/s: the change is above '
                f'the limit {acceleration:g} m/s^2 (twice limits.acceleration)',
            )


def extrapolate(
    newest: Sequence[Setpoint], time: float
) -> tuple[PerCarriage, PerCarriage]:
    """
    Return position [m] and velocity [m/s] extrapolated from the newest setpoints to a time [s].

    If a stream has only one setpoint, its velocity is not confirmed and the position is held.
    """
    last = newest[-1]
    velocity = last.velocity if len(newest) == 2 else ZERO
    return plus(last.position, velocity, time - last.time), velocity


def interpolate(
    before: tuple[float, Setpoint], after: tuple[float, Setpoint], time: float
) -> tuple[PerCarriage, PerCarriage]:
    """
    Return position [m] and velocity [m/s] on the cubic Hermite curve between two setpoints.

    With u from 0 to 1 and w = 1 − u, over the time h::

        position = w² (1 + 2 u) p + u² (1 + 2 w) q + h (u w² v − u² w z)
        velocity = 6 u w (q − p)/h + w (1 − 3 u) v + u (3 u − 2) z
    """
    begin, first = before
    end, second = after
    h = end - begin
    u = (time - begin) / h
    w = 1.0 - u
    h00 = w * w * (1.0 + 2.0 * u)
    h01 = u * u * (1.0 + 2.0 * w)
    h10 = u * w * w * h
    h11 = -u * u * w * h
    slope = 6.0 * u * w / h
    g10 = w * (1.0 - 3.0 * u)
    g11 = u * (3.0 * u - 2.0)

    position = []
    velocity = []
    for p, q, v, z in zip(
        first.position, second.position, first.velocity, second.velocity, strict=True
    ):
        position.append(h00 * p + h01 * q + h10 * v + h11 * z)
        velocity.append(slope * (q - p) + g10 * v + g11 * z)
    return position, velocity


class SetpointStream:
    """Converter of a stream of poses to setpoints, which checks each pose."""

    PATH_SPACING = 0.005  # m, between the poses of a path by default
    LONGEST_PATH = 10000  # steps; a mistyped spacing must not block the node for long

    def __init__(self, geometry: kinematics.Geometry, min_conditioning: float) -> None:
        self.mechanism = kinematics.Mechanism(geometry)
        self._min_conditioning = min_conditioning
        # time and pose of the last setpoint
        self._last = (-math.inf, kinematics.ZERO_POSE)

    def certify(self, pose: kinematics.Pose) -> kinematics.Carriages:
        """Return the carriage positions of a goal [m]; raise a LimitError beyond a limit."""
        return self.mechanism.certify(pose, self._min_conditioning)

    def path(
        self, start: kinematics.Pose, goal: kinematics.Pose, spacing: float = 0.0
    ) -> list[kinematics.Carriages]:
        """
        Return carriage positions on the straight path from start to goal, including both [m].

        x, y and θ change in proportion. The spacing is the maximum distance [m] of neighbouring
        poses, measured at the head and at the platform's joints; 0 means `PATH_SPACING`.

        Raises
        ------
        InputError
            The spacing is not a number, is negative, or requires more poses than allowed.
        LimitError
            The first uncertified pose violates this limit.

        """
        if not 0.0 <= spacing < math.inf:
            raise InputError(
                'tolerance',
                f'tolerance = {spacing} m is below the limit 0 m or not finite',
            )
        if not spacing:
            spacing = self.PATH_SPACING

        change = kinematics.difference(goal, start)
        half_length = self.mechanism.geometry.platform_half_length
        length = math.hypot(change.x, change.y) + half_length * abs(change.theta)
        if length > self.LONGEST_PATH * spacing:
            raise InputError(
                'tolerance',
                f'a path of {length:.4g} m needs {length / spacing:.4g} steps of {spacing:g} m, '
                f'above the limit {self.LONGEST_PATH} steps',
            )

        carriages = []
        steps = max(1, math.ceil(length / spacing))
        for step in range(steps + 1):
            pose = kinematics.Pose(*plus(start, change, step / steps))
            carriages.append(self.certify(pose))
        return carriages

    def setpoint(self, time: float, pose: kinematics.Pose) -> Setpoint:
        """
        Return the setpoint for a pose at a time [s].

        Its velocity is J ṗ, where ṗ is the mean velocity since the last pose of the stream. The
        first pose of a stream has velocity 0.

        Raises a LimitError with the limit that the pose violates; the stream continues with the
        next pose.
        """
        carriages = self.certify(pose)
        last_time, last_pose = self._last
        self._last = (time, pose)

        velocity = kinematics.Carriages(0.0, 0.0, 0.0)
        elapsed = time - last_time
        if 0.0 < elapsed <= STREAM_GAP and pose != last_pose:
            change = kinematics.difference(pose, last_pose)
            mean = kinematics.Twist(*(step / elapsed for step in change))
            velocity = self.mechanism.carriage_velocity(pose, mean)
        return Setpoint(time, carriages, velocity)
