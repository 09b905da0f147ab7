"""Diagnostics of a node: rejections counted by reason, and its components on /diagnostics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
import math
import platform
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.nodes.clock import steady_timer

LEVELS = {
    'ok': DiagnosticStatus.OK, 'warn': DiagnosticStatus.WARN, 'error': DiagnosticStatus.ERROR,
    'stale': DiagnosticStatus.STALE}
PERIOD = 1.0  # s, between two messages on /diagnostics
LOG_PERIOD = 10.0  # s, between two log lines of rejections for the same reason
# axes of a pose as diagnostics show them: name, factor from SI, unit
POSE_AXES = (('x', 1e3, 'mm'), ('y', 1e3, 'mm'), ('theta', math.degrees(1.0), 'deg'))
HOST = platform.node()  # hardware id of a component that is not a drive


def diagnostic_status(
    name: str, level: str, message: str, values: Mapping[str, Any], hardware_id: str = ''
) -> DiagnosticStatus:
    """Return the status of a component; `level` is a key of `LEVELS`."""
    return DiagnosticStatus(
        name=name, level=LEVELS[level], message=message, hardware_id=hardware_id,
        values=[KeyValue(key=key, value=f'{value:.6g}' if isinstance(value, float) else str(value))
                for key, value in values.items()])


class Rejections:
    """Count rejected messages and requests by reason; log each reason every `LOG_PERIOD`."""

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._counts: Counter[str] = Counter()
        self._logged: dict[str, float] = {}  # time of the last log line by reason [s, monotonic]
        self.last_message = ''

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count the `ManipulatorError` of a block and continue after it."""
        try:
            yield
        except ManipulatorError as error:
            self.add(error)

    @property
    def total(self) -> int:
        """Number of all rejections."""
        return self._counts.total()

    def add(self, error: ManipulatorError, what: str = '', is_logged: bool = True) -> None:
        """Count a rejection; `what` names the message or request where the error does not."""
        reason, now = getattr(error, 'reason', 'other'), time.monotonic()
        self._counts[reason] += 1
        self.last_message = f'{what}: {error}' if what else str(error)
        if is_logged and now - self._logged.get(reason, -math.inf) >= LOG_PERIOD:
            self._logged[reason] = now
            self._logger.warning(self.last_message)

    def values(self) -> dict[str, str]:
        """Return the counters as values of a component."""
        counts = {f'rejected: {reason}': str(count)
                  for reason, count in sorted(self._counts.items())}
        return {'rejected': str(self.total), **counts, 'last rejection': self.last_message}


class DiagnosticsPublisher:
    """
    Publish the components of a node on /diagnostics, once a second and on change.

    Parameters
    ----------
    node : rclpy.node.Node
    rejections : Rejections
        The first component has their counters.
    components : callable
        Returns a list of DiagnosticStatus, each with the name of its component.

    """

    def __init__(
        self, node: Node, rejections: Rejections, components: Callable[[], list[DiagnosticStatus]]
    ) -> None:
        self._node, self._rejections, self._components = node, rejections, components
        self._prefix = node.get_fully_qualified_name().lstrip('/')
        self._outcome: Any = None
        self._publisher = node.create_publisher(*topics.DIAGNOSTICS)
        steady_timer(node, PERIOD, self.publish)

    def publish_change(self, outcome: Any) -> None:
        """Publish at once where the outcome differs from the previous one."""
        if outcome != self._outcome:
            self._outcome = outcome
            self.publish()

    def publish(self) -> None:
        """Publish the present status of all components."""
        message = DiagnosticArray(status=self._components())
        message.status[0].values.extend(
            KeyValue(key=key, value=value) for key, value in self._rejections.values().items())
        for status in message.status:
            status.name = f'{self._prefix}: {status.name}'
            status.hardware_id = status.hardware_id or HOST
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)
