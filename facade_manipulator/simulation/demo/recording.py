"""Recording of a run: rows of its topics, and the poses and forces that the pictures show."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
import math
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from facade_manipulator import topics
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes.messages import planar_pose, planar_wrench, seconds
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.topics import Topic

SAMPLES = 30_000  # of each topic: the last 300 s at 100 Hz
# best effort, so that no node waits for the demo; 1 s of messages may wait
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
MINIMUM_SAMPLES = 10
LEARNING_TIME = 15.0  # s after the first goal, in which the correction fades in and learns
UNITS = 'mm', 'mm', '°'
SCALES = np.array((1e3, 1e3, math.degrees(1.0)))  # from m and rad to the units
YIELDING = '', 'contact.enabled', 'contact.yaw_enabled'  # parameters of the compensator by axis


def _pose(message: Any) -> Sequence[float]:
    return planar_pose(message.pose, 'pose')


TOPICS: dict[Topic, Callable[[Any], Sequence[float]]] = {
    topics.HEAD_POSE: _pose, topics.RAIL_POSE: _pose, topics.REFERENCE: _pose,
    topics.CONTACT_WRENCH: planar_wrench}


class Recorder:
    """Rows of stamp and planar values of each topic, and the latest components of all nodes."""

    def __init__(self, node: Node) -> None:
        self.rows: dict[Topic, deque[tuple[float, ...]]] = {
            topic: deque(maxlen=SAMPLES) for topic in TOPICS}
        self.components: dict[str, DiagnosticStatus] = {}
        for topic in TOPICS:
            node.create_subscription(
                topic.type, topic.name, partial(self._keep, topic), BEST_EFFORT)
        kind, name, qos = topics.DIAGNOSTICS
        node.create_subscription(kind, name, self._receive_diagnostics, qos)

    def _keep(self, topic: Topic, message: Any) -> None:
        with suppress(InputError):  # the nodes reject such a message as well
            self.rows[topic].append((seconds(message.header.stamp), *TOPICS[topic](message)))

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        self.components.update((status.name, status) for status in message.status)

    def latest(self, count: int = SAMPLES) -> dict[Topic, list[tuple[float, ...]]]:
        """Return the latest rows of each topic while the node records more."""
        return {topic: list(rows)[-count:] for topic, rows in self.rows.items()}


class Run(NamedTuple):
    """Samples of a run; poses on the wall have the shape (n, 3) [m, m, rad]."""

    times: np.ndarray  #: since the first reference [s]
    heads: np.ndarray
    rails: np.ndarray  #: true disturbance
    references: np.ndarray  #: where on its path to the goal the head should be
    still: np.ndarray  #: head at rest on the rail, at its reference
    is_counted: np.ndarray  #: whether the figures include the sample
    forces: np.ndarray  #: of the head on the wall [N]; empty without a sensor
    scenario: Scenario
    geometry: Geometry

    def poses(self) -> np.ndarray:
        """Return the head without and with compensation, shape (2, n, 3) [m, m, rad]."""
        return np.stack((self.still, self.heads))

    def errors(self) -> np.ndarray:
        """Return the errors without and with compensation, shape (2, n, 3) [m, m, rad]."""
        return self.poses() - self.references

    def attenuation(self) -> np.ndarray:
        """Return RMS error without and with compensation [m, m, rad] and the attenuation [dB]."""
        without, error = np.sqrt(np.mean(self.errors()[:, self.is_counted] ** 2, axis=1))
        return np.array((without, error, 20.0 * np.log10(without / error)))

    def yields(self, axis: int) -> bool:
        """Return whether the head leaves its reference along an axis to press on the wall."""
        return bool(self.scenario.compensator.get(YIELDING[axis]))

    def figures(self) -> list[str]:
        """Return the RMS errors and the attenuation of each axis as text."""
        return [f'{name} {scale * without:.3g} → {scale * error:.3g} {unit} ' + (
            '(yields to the contact force)' if self.yields(i) else f'({attenuation:.3g} dB)')
            for i, (name, (without, error, attenuation), scale, unit) in enumerate(
                zip(Pose._fields, self.attenuation().T, SCALES, UNITS, strict=True))]


def run_of(
    rows: Mapping[Topic, Sequence[Sequence[float]]], scenario: Scenario, geometry: Geometry
) -> Run:
    """
    Return the samples of a run from its first reference on.

    Raises
    ------
    ManipulatorError
        If there are too few samples.

    """
    tables = []
    for topic in TOPICS:  # stamps ascend, each once
        table = np.array(rows[topic]).reshape(-1, 4)
        tables.append(table[np.unique(table[:, 0], return_index=True)[1]])
    *poses, wrenches = tables
    begin = max(table[:, 0].min(initial=math.inf) for table in poses)
    end = min(table[:, 0].max(initial=-math.inf) for table in poses)
    stamps = poses[0][:, 0]
    stamps = stamps[(stamps >= begin) & (stamps <= end)]
    if len(stamps) < MINIMUM_SAMPLES:
        raise ManipulatorError(
            f'report rejected: {len(stamps)} poses of the head since the first reference, '
            f'minimum {MINIMUM_SAMPLES}; next: read the logs of the nodes')
    heads, rails, references = (_interpolate(stamps, table) for table in poses)
    elapsed, forces = stamps - begin, np.zeros(0)
    if len(wrenches):
        fx, fy, _ = _interpolate(stamps, wrenches).T
        forces = -(np.sin(heads[:, 2]) * fx + np.cos(heads[:, 2]) * fy)
    return Run(elapsed, heads, rails, references, carried(rails, references),
               elapsed >= min(LEARNING_TIME, 0.5 * elapsed[-1]), forces, scenario, geometry)


def _interpolate(stamps: np.ndarray, table: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(stamps, table[:, 0], values) for values in table.T[1:]])


def carried(rails: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return poses of frame rail, shape (..., 3), as poses on the wall."""
    (x, y, theta), (px, py, turn) = np.moveaxis(rails, -1, 0), np.moveaxis(points, -1, 0)
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.stack(
        [x + cosine * px - sine * py, y + sine * px + cosine * py, theta + turn], axis=-1)
