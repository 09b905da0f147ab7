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
)
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.parameters import parameter, settings


@settings
class GoalSettings:
    """What ik_service takes as a goal."""

    min_conditioning: float = parameter(
        0.05, 'Least local conditioning index of a goal (characteristic length 1 m)',
        minimum=0.0, maximum=1.0)
    path_spacing: float = parameter(
        0.005, 'Distance of the poses of a path where the request names none', unit='m',
        minimum=0.0001, maximum=0.1)
    longest_path: int = parameter(
        10000, 'Most poses of one path', minimum=2, maximum=1000000)
    stream_gap: float = parameter(
        0.2, 'Pause after which poses begin a new stream', unit='s', minimum=0.005, maximum=2.0)
    lead: float = parameter(
        0.05, 'How far ahead of their time the setpoints of an approach are sent', unit='s',
        minimum=0.0, maximum=0.5)


class SetpointStream:
    """
    Turn a stream of poses into setpoints.

    Parameters
    ----------
    geometry : Geometry
    settings : GoalSettings

    """

    def __init__(self, geometry: Geometry, settings: GoalSettings) -> None:
        self.geometry = geometry
        self.settings = settings
        self._last: tuple[float, Pose] | None = None

    def setpoint(self, time: float, pose: Pose) -> Setpoint:
        """
        Return the setpoint of a pose meant for a time [s].

        Its velocity is J ṗ, ṗ being the change since the last pose of the stream; a pose that
        begins a stream is a place to rest.

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

    def _rates(self, time: float, pose: Pose) -> tuple[float, float, float]:
        if self._last is None or not 0.0 < time - self._last[0] <= self.settings.stream_gap:
            return (0.0, 0.0, 0.0)
        elapsed, change = time - self._last[0], difference(pose, self._last[1])
        return change.x / elapsed, change.y / elapsed, change.theta / elapsed


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
        joints; 0 takes `settings.path_spacing`.

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
        for pose in _straight(geometry, settings, start, goal, spacing or settings.path_spacing)
    ]


def _straight(
    geometry: Geometry, settings: GoalSettings, start: Pose, goal: Pose, spacing: float
) -> Iterator[Pose]:
    change = difference(goal, start)
    length = math.hypot(change.x, change.y) + geometry.platform_half_length * abs(change.theta)
    steps = max(1.0, math.ceil(length / spacing))
    if steps + 1 > settings.longest_path:
        raise InputError(
            'tolerance', f'a path of {length:.4g} m every {spacing:g} m has '
            f'{steps + 1:.0f} poses, bound {settings.longest_path}')
    for k in range(int(steps) + 1):
        share = k / steps
        yield Pose(*(a + share * d for a, d in zip(start, change, strict=True)))
