"""Samples of a run: the poses, errors and forces that the report shows."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.simulation.world.scenario import Scenario

LEARNING_TIME = 15.0  # s after the first goal, in which the correction fades in and learns
UNITS = 'mm', 'mm', '°'
SCALES = np.array((1e3, 1e3, math.degrees(1.0)))  # from m and rad to the units
# parameters of the compensator by axis that let the head leave its reference to press
YIELDING = '', 'contact.enabled', 'contact.yaw_enabled'
Rows = Sequence[tuple[float, ...]]  #: stamp and planar values of each message of a topic


class Run:
    """
    Samples of a run, beginning with its first reference.

    The rows contain head, rail, reference, and wrench of the wall on the head. Poses on the wall
    have the shape (n, 3) [m, m, rad]. The three paths are: a head at rest on the rail at its
    reference, the head with compensation, and the reference.
    Raises a ManipulatorError if there are too few samples.
    """

    def __init__(self, rows: Sequence[Rows], scenario: Scenario, geometry: Geometry) -> None:
        self.scenario, self.geometry = scenario, geometry
        *poses, wrenches = (  # stamps ascend
            np.unique(np.array(table).reshape(-1, 4), axis=0) for table in rows)
        begin = max(table[:, 0].min(initial=math.inf) for table in poses)
        end = min(table[:, 0].max(initial=-math.inf) for table in poses)
        stamps = poses[0][:, 0]
        stamps = stamps[(stamps >= begin) & (stamps <= end)]
        if len(stamps) < 10:
            raise ManipulatorError(
                f'report rejected: {len(stamps)} poses of the head since the first reference, '
                'minimum 10; next: read the logs of the nodes')
        self.times = stamps - begin  #: since the first reference [s]
        heads, self.rails, references = (_interpolated(stamps, table) for table in poses)
        self.paths = np.stack((carried(self.rails, references), heads, references))
        self.errors = self.paths[:2] - references
        #: whether the figures include the sample
        self.is_counted = self.times >= min(LEARNING_TIME, 0.5 * self.times[-1])
        self.forces = np.zeros(0)  #: along the head [N]; empty without a sensor
        if len(wrenches):
            self.forces = -_interpolated(stamps, wrenches)[:, 1]
        without, error = np.sqrt(np.mean(self.errors[:, self.is_counted] ** 2, axis=1))
        #: RMS error without and with compensation [m, m, rad] and the attenuation [dB], by axis
        self.rms = np.array((without, error, 20.0 * np.log10(without / error)))
        self.figures, self.low = list[str](), list[str]()  #: as text; of axes below their bounds
        for name, scale, unit, (without, error, attenuation), yielding, bound in zip(
                Pose._fields, SCALES, UNITS, self.rms.T, YIELDING, scenario.mission.attenuation,
                strict=True):
            yields = scenario.compensator.get(yielding)
            text = f'{name} {scale * without:.3g} → {scale * error:.3g} {unit} ' + (
                '(yields to the contact force)' if yields else f'({attenuation:.3g} dB)')
            self.figures.append(text)
            if attenuation < bound and not yields:
                self.low.append(f'{text}, bound {bound:g} dB')


def _interpolated(stamps: np.ndarray, table: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(stamps, table[:, 0], values) for values in table.T[1:]])


def carried(rails: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return poses on the wall of poses in frame rail, shape (..., 3) [m, m, rad]."""
    (x, y, theta), (px, py, turn) = np.moveaxis(rails, -1, 0), np.moveaxis(points, -1, 0)
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.stack(
        [x + cosine * px - sine * py, y + sine * px + cosine * py, theta + turn], axis=-1)
