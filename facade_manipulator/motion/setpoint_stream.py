"""Poses to setpoints: certified, solved, with the carriage velocities of the pose stream."""

from __future__ import annotations

from collections.abc import Iterator
import math

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import (
    carriage_velocity,
    Carriages,
    certify,
    difference,
    Geometry,
    Pose,
    Twist,
    ZERO_TWIST,
)
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.parameters import parameter, settings

PATH_SPACING = 0.005  # m, between the poses of a path where the request names none
LONGEST_PATH = 10000  # poses: a slip of the spacing must not stop the node for long
STREAM_GAP = 0.2  # s, pause after which poses begin a new stream


@settings
class GoalSettings:
    """What ik_service accepts as a goal."""

    min_conditioning: float = parameter(
        0.05, 'Least local conditioning index of a goal (characteristic length 1 m)',
        minimum=0.0, maximum=1.0)


class SetpointStream:
    """Turn a stream of poses into setpoints."""

    def __init__(self, geometry: Geometry, settings: GoalSettings) -> None:
        self.geometry = geometry
        self.settings = settings
        self._last: tuple[float, Pose] | None = None

    def setpoint(self, time: float, pose: Pose) -> Setpoint:
        """
        Return the setpoint of a pose meant for a time [s].

        Its velocity is J ṗ, ṗ being the change since the last pose of the stream; a pose that
        begins a stream is passed at rest.

        Raises
        ------
        LimitError
            The limit that the pose violates; the stream goes on with the next pose.

        """
        carriages = certify(self.geometry, pose, self.settings.min_conditioning)
        rates = self._rates(time, pose)
        self._last = (time, pose)
        velocity = carriage_velocity(self.geometry, pose, rates) if any(rates) else rates
        return Setpoint(time, tuple(carriages), tuple(velocity))

    def _rates(self, time: float, pose: Pose) -> Twist:
        if self._last is None or not 0.0 < time - self._last[0] <= STREAM_GAP:
            return ZERO_TWIST
        elapsed, change = time - self._last[0], difference(pose, self._last[1])
        return Twist(change.x / elapsed, change.y / elapsed, change.theta / elapsed)


def certified_path(
    geometry: Geometry, settings: GoalSettings, start: Pose, goal: Pose, spacing: float = 0.0
) -> list[Carriages]:
    """
    Carriage positions along the straight path from start to goal, both included.

    Parameters
    ----------
    geometry : Geometry
    settings : GoalSettings
    start, goal : Pose
        Ends of the path; x, y and θ change in proportion.
    spacing : float
        Greatest distance [m] of neighbouring poses, measured at the head and at the platform's
        joints; 0 means `PATH_SPACING`.

    Returns
    -------
    list of Carriages
        [m].

    Raises
    ------
    InputError
        The spacing is not a number, negative, or asks for more poses than allowed.
    LimitError
        The limit that the first uncertified pose violates.

    """
    if not 0.0 <= spacing < math.inf:
        raise InputError('tolerance', f'tolerance = {spacing} m is not a distance')
    return [
        certify(geometry, pose, settings.min_conditioning)
        for pose in _straight(geometry, start, goal, spacing or PATH_SPACING)
    ]


def _straight(
    geometry: Geometry, start: Pose, goal: Pose, spacing: float
) -> Iterator[Pose]:
    change = difference(goal, start)
    length = math.hypot(change.x, change.y) + geometry.platform_half_length * abs(change.theta)
    steps = max(1.0, math.ceil(length / spacing))
    if steps + 1 > LONGEST_PATH:
        raise InputError(
            'tolerance', f'a path of {length:.4g} m every {spacing:g} m has '
            f'{steps + 1:.0f} poses, bound {LONGEST_PATH}')
    for k in range(int(steps) + 1):
        share = k / steps
        yield Pose(*(a + share * d for a, d in zip(start, change, strict=True)))
