"""What the demo keeps of a run: the newest minutes whole, the whole run thinned."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data

from facade_manipulator.kinematics import compose, invert, Pose, subtract, Wrench
from facade_manipulator.lab.gondola import Facade
from facade_manipulator.messages import planar_pose, planar_wrench, seconds
from facade_manipulator.motion import TimedBuffer
from facade_manipulator.ros import RELIABLE

PARTS = ('head_pose', 'wall_error', 'uncompensated_error')
NEWEST = 30000  # samples kept whole: 5 min at 100 Hz
THINNED = 8000
LONGEST_WAIT = 50  # moments whose parts have not all arrived
GOAL_STEP = 1e-6
# A moment: stamp [s], then x, y and θ of the head on the wall, of its error, of the error without
# compensation, and of where on its path to the goal the head should be.
Row = tuple[float, ...]


class TimeCourse(NamedTuple):
    """Samples as arrays, poses of shape (n, 3)."""

    times: np.ndarray  #: since the first goal [s]
    heads: np.ndarray
    errors: np.ndarray
    uncompensated: np.ndarray
    references: np.ndarray
    settled: np.ndarray  #: whether the goal had stood for long enough to count

    @property
    def goals(self) -> np.ndarray:
        """Goals on the wall, shape (n, 3)."""
        return self.heads - self.errors

    def rails(self) -> list[Pose]:
        """Return the pose of the rail on the wall: it carries a goal to where it is seen."""
        return [compose(Pose(*carried), invert(Pose(*goal)))
                for carried, goal in zip(self.goals + self.uncompensated, self.goals, strict=True)]

    def carried(self, points: np.ndarray) -> np.ndarray:
        """Return how far the gondola carries points on the wall, shape (n, 3) or (3,)."""
        points = np.broadcast_to(points, self.heads.shape)
        return np.array([compose(rail, Pose(*point)) for rail, point in zip(
            self.rails(), points, strict=True)]) - points


class Thinned:
    """Keep items evenly spread over the whole run, however long it gets."""

    def __init__(self, limit: int = THINNED) -> None:
        self.items: list[Any] = []
        self._limit = limit
        self._stride, self._count = 1, 0

    def append(self, item: Any) -> None:
        """Take the next item; every second one goes when there are too many."""
        if self._count % self._stride == 0:
            self.items.append(item)
        self._count += 1
        if len(self.items) > self._limit:
            self.items = self.items[::2]
            self._stride *= 2


class Recorder:
    """
    Keep what the gondola simulator measures of the head on the wall, by subscriptions of a node.

    A goal counts once it has stood for the settling time [s].
    """

    def __init__(self, node: Node, settling_time: float) -> None:
        self._settling_time = settling_time
        self._waiting: dict[float, dict[str, Pose]] = {}
        self._is_complete = False
        self._newest: deque[Row] = deque(maxlen=NEWEST)
        self._whole = Thinned()
        self._wrenches: deque[tuple[float, Wrench]] = deque(maxlen=NEWEST)
        self._references: TimedBuffer[Pose] = TimedBuffer()
        for part in PARTS:
            node.create_subscription(
                PoseStamped, f'gondola_simulator/{part}', partial(self._receive, part), RELIABLE)
        node.create_subscription(
            PoseStamped, 'compensator/reference', self._receive_reference, RELIABLE)
        node.create_subscription(
            WrenchStamped, 'contact_wrench', self._receive_wrench, qos_profile_sensor_data)

    def stop(self) -> None:
        """Keep nothing more: from here on the drives stop."""
        self._is_complete = True

    def newest(self) -> TimeCourse:
        """Return the newest minutes, every sample."""
        return self._course(self._newest)

    def entire(self) -> TimeCourse:
        """Return the whole run, thinned if it was long."""
        return self._course(self._whole.items)

    def forces(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and force on the wall [N], empty without a contact."""
        course = self.newest()
        if not len(course.times):
            return np.empty(0), np.empty(0)
        begin = self._begin()
        wrenches = [(time - begin, wrench) for time, wrench in self._wrenches
                    if 0.0 <= time - begin <= course.times[-1]]
        times = np.array([time for time, _ in wrenches])
        yaws = np.interp(times, course.times, course.heads[:, 2])
        return times, np.array([
            Facade.force_on_wall(Pose(0.0, 0.0, yaw), wrench)
            for yaw, (_, wrench) in zip(yaws, wrenches, strict=True)])

    def _begin(self) -> float:
        return self._whole.items[0][0] if self._whole.items else 0.0

    def _course(self, rows: Iterable[Row]) -> TimeCourse:
        columns = np.array(list(rows)).reshape(-1, 13)
        times = columns[:, 0] - self._begin()
        heads, errors, uncompensated, references = np.split(columns[:, 1:], 4, axis=1)
        return TimeCourse(times, heads, errors, uncompensated, references,
                          settled(times, heads - errors, self._settling_time))

    def _receive(self, part: str, message: PoseStamped) -> None:
        if self._is_complete:
            return
        time = seconds(message.header.stamp)
        parts = self._waiting.setdefault(time, {})
        parts[part] = planar_pose(message.pose, part)
        if len(parts) == len(PARTS):
            head, error, uncompensated = (parts[name] for name in PARTS)
            # the goal where no path to it is known
            reference = self._reference(time) or subtract(head, error)
            row = time, *head, *error, *uncompensated, *reference
            self._newest.append(row)
            self._whole.append(row)
            del self._waiting[time]
        elif len(self._waiting) > LONGEST_WAIT:
            del self._waiting[next(iter(self._waiting))]

    def _receive_reference(self, message: PoseStamped) -> None:
        self._references.append(
            seconds(message.header.stamp), planar_pose(message.pose, 'reference'))

    def _reference(self, time: float) -> Pose | None:
        before, after = self._references.around(time)
        if before is None or after is None:
            return before and before[1]
        (begin, a), (end, b) = before, after
        share = (time - begin) / (end - begin)
        return Pose(*(p + share * (q - p) for p, q in zip(a, b, strict=True)))

    def _receive_wrench(self, message: WrenchStamped) -> None:
        self._wrenches.append((seconds(message.header.stamp), planar_wrench(message)))


def settled(times: np.ndarray, goals: np.ndarray, settling_time: float) -> np.ndarray:
    """Return when the goal had stood for the settling time [s], shape (n,)."""
    if not len(times):
        return np.empty(0, bool)
    changed = np.any(np.abs(np.diff(goals, axis=0)) > GOAL_STEP, axis=1)
    since = np.maximum.accumulate(np.where(np.r_[True, changed], times, times[0]))
    return times - since >= settling_time
