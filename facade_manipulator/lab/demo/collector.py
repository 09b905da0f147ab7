"""Time series of a run: the poses and wrenches from which the demo draws its pictures."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from itertools import islice
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
from rclpy.node import Node
from rclpy.subscription import Subscription

from facade_manipulator import interfaces
from facade_manipulator.diagnostics import DiagnosticComponent
from facade_manipulator.errors import InputError
from facade_manipulator.interfaces import Quality, Topic
from facade_manipulator.kinematics import difference, Pose
from facade_manipulator.lab.gondola.course import between
from facade_manipulator.messages import planar_pose, planar_wrench, seconds, status_values
from facade_manipulator.ros.interfaces import subscription

SAMPLES = 30_000  # of each topic; a run of more than 300 s at 100 Hz is drawn from its end
DEPTH = 100  # messages that may wait for the next turn, 1 s at 100 Hz
LATEST = 100  # references, among which that of the newest pose of the head is searched
Read = Callable[[Any], Sequence[float]]


def _pose(message: Any) -> Pose:
    return planar_pose(message.pose, 'pose')


READERS: dict[Topic, Read] = {
    interfaces.HEAD_POSE: _pose, interfaces.GOAL_POSE: _pose, interfaces.REFERENCE: _pose,
    interfaces.END_EFFECTOR_POSE: _pose, interfaces.CONTACT_WRENCH: planar_wrench,
}


class Collector:
    """
    Collect stamps [s] and planar values of topics by subscriptions of a node.

    Values are x, y, θ [m, m, rad] of poses and the wrench [N, N, N m] of a contact.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._components: dict[str, DiagnosticStatus] = {}
        self.series: dict[Topic, deque[tuple[float, ...]]] = {}
        self._subscriptions: list[Subscription] = []
        for topic, read in READERS.items():
            self.series[topic] = deque(maxlen=SAMPLES)
            # streams are best effort, so that no node waits for the demo
            quality = Quality(DEPTH, reliable=topic is interfaces.GOAL_POSE)
            self._subscriptions.append(subscription(
                node, topic._replace(quality=quality), partial(self._keep, topic, read)))

        self._subscriptions.append(
            subscription(node, interfaces.DIAGNOSTICS, self._receive_diagnostics))

    def component(self, name: object) -> DiagnosticStatus | None:
        """Return the last status of a component of this manipulator on /diagnostics."""
        return self._components.get(f'{self._node.get_namespace()}/{name}'.lstrip('/'))

    def value(self, component: DiagnosticComponent, key: str) -> str | None:
        """Return a value of a component on /diagnostics; None before its first status."""
        status = self.component(component)
        return status_values(status).get(component.key(key)) if status else None

    def _receive_diagnostics(self, message: DiagnosticArray) -> None:
        self._components |= {status.name: status for status in message.status}

    def close(self) -> None:
        """Collect no longer: the stopping of the drives is not part of the run."""
        while self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop())

    def _keep(self, topic: Topic, read: Read, message: Any) -> None:
        with suppress(InputError):  # the nodes reject such a message as well
            self.series[topic].append((seconds(message.header.stamp), *read(message)))

    def table(self, topic: Topic) -> np.ndarray:
        """Return stamps and values of a topic by ascending stamps, each once, shape (n, 4)."""
        rows = np.array(self.series[topic]).reshape(-1, 4)
        return rows[np.unique(rows[:, 0], return_index=True)[1]]

    def error(self) -> Pose | None:
        """Return the newest pose of the head less its reference [m, m, rad], None before both."""
        heads, references = self.series[interfaces.HEAD_POSE], self.series[interfaces.REFERENCE]
        if not heads or not references:
            return None
        time, *head = heads[-1]
        latest = sorted(islice(reversed(references), LATEST))
        return difference(Pose(*head), Pose(*between(np.array([time]), latest)[0]))
