"""What the head does on the wall: its true error, and what it would be without compensation."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.kinematics import compose, difference, Pose
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.parameters import parameter, settings

AXES = Pose._fields
UNITS = 'mm', 'mm', '°'  # in which people read an axis
SCALES = Pose(1e3, 1e3, math.degrees(1.0))  # from m and rad to them


@settings
class WallSettings:
    """When a sample of the head's error counts."""

    settling_time: float = parameter(
        'Time for which a goal must have stood', default=2.5, unit='s', minimum=0.0, maximum=60.0)


class WallSample(NamedTuple):
    """The head at a stamp."""

    time: float  #: [s]
    rail: Pose  #: true pose in the façade's frame
    head: Pose  #: likewise
    error: Pose | None  #: head less goal; None before the first goal
    uncompensated: Pose | None  #: what a mechanism standing still at the goal would have
    settled: bool  #: whether the goal has stood for long enough to count


class WallMeasurement:
    """Measure the head's error from where it is on the rail and the true disturbance."""

    def __init__(self, settings: WallSettings, motion: Motion) -> None:
        self._settings = settings
        self._motion = motion
        self._goal: Pose | None = None
        self._goal_since = math.inf
        self._squares = np.zeros((2, len(AXES)))  # of disturbance and residual
        self.count = 0

    def set_goal(self, now: float, goal: Pose) -> None:
        """Take the goal on the wall from now [s] on; the same goal again changes nothing."""
        if goal != self._goal:
            self._goal, self._goal_since = goal, now

    def measure(self, stamp: float, on_rail: Pose) -> WallSample:
        """Measure at a stamp [s] at which the head is at a pose of the rail's frame."""
        rail = self._motion(stamp)
        head = compose(rail, on_rail)
        if self._goal is None:
            return WallSample(stamp, rail, head, None, None, False)
        error = difference(head, self._goal)
        uncompensated = difference(compose(rail, self._goal), self._goal)
        settled = stamp - self._goal_since >= self._settings.settling_time
        if settled:
            self.count += 1
            self._squares += np.square((uncompensated, error))
        return WallSample(stamp, rail, head, error, uncompensated, settled)

    def report(self) -> dict[str, Any]:
        """Return RMS of disturbance and residual and the attenuation of each axis."""
        rms = np.sqrt(self._squares / self.count) if self.count else np.full((2, len(AXES)), None)
        return {'axes': {axis: compared(*pair) for axis, pair in zip(
            AXES, rms.T.tolist(), strict=True)}, 'samples': self.count}


def compared(disturbance: float | None, residual: float | None) -> dict[str, float | None]:
    """Return what is reported of an axis: RMS of disturbance and residual, and the attenuation."""
    return {
        'disturbance_rms': disturbance, 'residual_rms': residual,
        'attenuation_db':
            20.0 * math.log10(disturbance / residual) if disturbance and residual else None}
