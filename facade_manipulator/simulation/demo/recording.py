"""A run as the demo receives it: time series of topics, and the head on the wall made of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
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
from facade_manipulator.messages import planar_pose, planar_wrench, seconds, status_values
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.topics import Topic

SAMPLES = 30_000  # of each topic; a run of more than 300 s at 100 Hz is drawn from its end
DEPTH = 100  # messages that may wait, 1 s at 100 Hz
# streams are best effort, so that no node waits for the demo
BEST_EFFORT = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
NO_STATUS = DiagnosticStatus(level=DiagnosticStatus.STALE)
LEAST_SAMPLES = 10
SETTLING_TIME = 2.5  # s, for which a goal has stood before errors count
LEARNING_TIME = 15.0  # s after the first goal, in which the correction fades in and learns
UNITS = 'mm', 'mm', '°'  # in which people read an axis
SCALES = np.array((1e3, 1e3, math.degrees(1.0)))  # from m and rad to them


def _pose(message: Any) -> Pose:
    return planar_pose(message.pose, 'pose')


TOPICS: dict[Topic, Callable[[Any], Sequence[float]]] = {
    topics.HEAD_POSE: _pose, topics.RAIL_POSE: _pose, topics.GOAL_POSE: _pose,
    topics.REFERENCE: _pose, topics.CONTACT_WRENCH: planar_wrench}


class Recorder:
    """Keep stamps [s] and planar values of `TOPICS`, and /diagnostics, as a node receives them."""

    def __init__(self, node: Node) -> None:
        self._namespace = node.get_namespace()
        self._components: dict[str, DiagnosticStatus] = {}
        self.series: dict[Topic, deque[tuple[float, ...]]] = {
            topic: deque(maxlen=SAMPLES) for topic in TOPICS}
        self.is_recording = True  #: False drops the messages of the stop, not part of the run
        for topic in TOPICS:
            qos = topic.qos if topic is topics.GOAL_POSE else BEST_EFFORT
            node.create_subscription(topic.type, topic.name, partial(self._keep, topic), qos)
        kind, name, qos = topics.DIAGNOSTICS
        node.create_subscription(kind, name, self._receive_diagnostics, qos)

    def component(self, name: str) -> DiagnosticStatus:
        """Return the last status of a component, such as ``'driver: bus'``, on /diagnostics."""
        return self._components.get(f'{self._namespace}/{name}'.lstrip('/'), NO_STATUS)

    def value(self, component: str, key: str) -> int:
        """Return a counter of a component on /diagnostics; 0 before its first status."""
        return int(status_values(self.component(component)).get(key, 0))

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        if self.is_recording:
            self._components |= {status.name: status for status in message.status}

    def _keep(self, topic: Topic, message: Any) -> None:
        with suppress(InputError):  # the nodes reject such a message as well
            values = seconds(message.header.stamp), *TOPICS[topic](message)
            if self.is_recording:
                self.series[topic].append(values)

    def table(self, topic: Topic) -> np.ndarray:
        """Return stamps and values of a topic by ascending stamps, each once, shape (n, 4)."""
        rows = np.array(self.series[topic]).reshape(-1, 4)
        return rows[np.unique(rows[:, 0], return_index=True)[1]]

    def error(self) -> Pose | None:
        """Return the newest pose of the head less its reference [m, m, rad], None before both."""
        heads, references = self.series[topics.HEAD_POSE], self.series[topics.REFERENCE]
        if not heads or not references:
            return None
        time, *head = heads[-1]
        latest = np.array(sorted(list(references)[-DEPTH:]))
        return Pose(*(head - interpolate(np.array([time]), latest)[0]))


class Run(NamedTuple):
    """Samples of a run; poses on the wall have the shape (n, 3) [m, m, rad]."""

    times: np.ndarray  #: since the first [s]
    heads: np.ndarray
    rails: np.ndarray  #: true disturbance
    goals: np.ndarray
    references: np.ndarray  #: where on its path to the goal the head should be
    is_counted: np.ndarray  #: whether the figures include the sample
    forces: np.ndarray  #: with which the head presses on the wall [N]; empty without a sensor
    scenario: Scenario
    geometry: Geometry

    @property
    def errors(self) -> np.ndarray:
        """Pose of the head less its reference."""
        return self.heads - self.references

    @property
    def still(self) -> np.ndarray:
        """Pose of a head that stands still on the rail, at its reference."""
        return carried(self.rails, self.references)

    @property
    def uncompensated(self) -> np.ndarray:
        """Error of a head that stands still on the rail."""
        return self.still - self.references


def run_of(
    recorder: Recorder, scenario: Scenario | None = None, geometry: Geometry | None = None
) -> Run:
    """
    Return the samples of a run from its first goal on.

    Raises
    ------
    ManipulatorError
        If there are too few samples.

    """
    heads, rails, goals, references, wrenches = map(recorder.table, TOPICS)
    begin, end = math.inf, -math.inf
    if len(rails) and len(goals) and len(references):
        begin = max(rails[0, 0], goals[0, 0], references[0, 0])
        end = min(rails[-1, 0], references[-1, 0])
    heads = heads[(heads[:, 0] >= begin) & (heads[:, 0] <= end)]
    if len(heads) < LEAST_SAMPLES:
        raise ManipulatorError(
            f'report rejected: {len(heads)} poses of the head since the first of {len(goals)} '
            f'goals, at least {LEAST_SAMPLES} are needed; next: read the logs of the nodes')
    times = heads[:, 0]
    is_new = np.r_[True, np.any(np.diff(goals[:, 1:], axis=0), axis=1)]  # a goal may be repeated
    goal = goals[is_new][np.searchsorted(goals[is_new, 0], times, 'right') - 1]
    elapsed = times - times[0]
    is_learnt = elapsed >= min(LEARNING_TIME, 0.5 * elapsed[-1])
    is_settled = is_learnt & (times - goal[:, 0] >= SETTLING_TIME)
    forces = np.zeros(0)
    if len(wrenches):
        fx, fy, _ = interpolate(times, wrenches).T
        forces = -(np.sin(heads[:, 3]) * fx + np.cos(heads[:, 3]) * fy)
    return Run(
        elapsed, heads[:, 1:], interpolate(times, rails), goal[:, 1:],
        interpolate(times, references), is_settled if is_settled.any() else is_learnt, forces,
        scenario or Scenario(), geometry or Geometry())


def interpolate(times: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Return the columns of a table after the first, its times, at other times."""
    stamps, *columns = table.T
    return np.column_stack([np.interp(times, stamps, column) for column in columns])


def carried(rails: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return on the wall what stands at poses of frame rail, all of shape (..., 3)."""
    (x, y, theta), (px, py, turn) = np.moveaxis(rails, -1, 0), np.moveaxis(points, -1, 0)
    cosine, sine = np.cos(theta), np.sin(theta)
    return np.stack(
        [x + cosine * px - sine * py, y + sine * px + cosine * py, theta + turn], axis=-1)


def figures(run: Run) -> dict[str, dict[str, float | None]]:
    """Return the RMS of disturbance and error and the attenuation of each axis."""
    without, errors = (np.sqrt(np.mean(values[run.is_counted] ** 2, axis=0)).tolist()
                       for values in (run.uncompensated, run.errors))
    return {axis: {
        'disturbance_rms': disturbance, 'residual_rms': error,
        'attenuation_db': 20.0 * math.log10(disturbance / error) if disturbance and error else None
    } for axis, disturbance, error in zip(Pose._fields, without, errors, strict=True)}


def decibels(attenuation: float | None) -> str:
    """Return an attenuation for people; without a disturbance there is none."""
    return '-' if attenuation is None else f'{attenuation:.3g} dB'


def yielding_axes(scenario: Scenario) -> list[str]:
    """Return the axes that yield to the wall: the head leaves the goal along them on purpose."""
    parameters = {'y': 'contact.enabled', 'theta': 'contact.yaw_enabled'}
    return [axis for axis, name in parameters.items() if scenario.compensator.get(name)]
