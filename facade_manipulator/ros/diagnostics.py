"""What an operator reads in /diagnostics: components at 1 Hz and on change, rejections counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import math
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.runtime import RELIABLE

PERIOD = 1.0
WARN_EVERY = 1.0  # s
REPEAT_AFTER = 60.0  # s, for the very message that stands in the log already


class DiagnosticsPublisher:
    """
    Publish the status of a node's components on /diagnostics.

    Parameters
    ----------
    node : rclpy.node.Node
    components : callable
        Returns the list of `diagnostic_msgs.msg.DiagnosticStatus` of this moment, each named
        after its component alone: the node's name is put before it.

    """

    def __init__(self, node: Node, components: Callable[[], list[DiagnosticStatus]]) -> None:
        self._node = node
        self._name = node.get_fully_qualified_name().lstrip('/')
        self._components = components
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
        self._summary: list[tuple[str, bytes, str]] = []
        steady_timer(node, PERIOD, self.publish)

    def publish(self) -> None:
        """Publish the present status."""
        self._send(self._components())

    def publish_change(self) -> None:
        """Publish if a component's level or message is another than last published."""
        components = self._components()
        if _summary(components) != self._summary:
            self._send(components)

    def _send(self, components: list[DiagnosticStatus]) -> None:
        self._summary = _summary(components)
        for item in components:
            item.name = f'{self._name}: {item.name}'
        message = DiagnosticArray(status=components)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)


def _summary(components: list[DiagnosticStatus]) -> list[tuple[str, bytes, str]]:
    return [(item.name, item.level, item.message) for item in components]


class RepeatedLog:
    """Log at most once a second, the same message once a minute: whoever repeats fills no disk."""

    def __init__(self) -> None:
        self._logged = ''
        self._logged_at = -math.inf

    def add(self, log: Callable[[str], object], message: str) -> None:
        """Log a message unless it is too soon."""
        now = time.monotonic()
        pause = REPEAT_AFTER if message == self._logged else WARN_EVERY
        if now - self._logged_at >= pause:
            self._logged, self._logged_at = message, now
            log(message)


class Rejections:
    """
    Count rejected messages by reason and log why, as often as `RepeatedLog` does.

    ``with rejections:`` adds the `ManipulatorError` that the block raises and goes on after it.
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._counts: Counter[str] = Counter()
        self.last_message = ''
        self._log = RepeatedLog()

    def __enter__(self) -> None:
        pass

    def __exit__(self, _: object, error: BaseException | None, __: object) -> bool:
        if not isinstance(error, ManipulatorError):
            return False
        self.add(error)
        return True

    @property
    def total(self) -> int:
        """Count of all rejections."""
        return self._counts.total()

    def add(self, error: ManipulatorError, what: str = '') -> None:
        """Count a rejection; `what` names the message where the error's message does not."""
        self._counts[getattr(error, 'reason', 'other')] += 1
        self.last_message = f'{what}: {error}' if what else str(error)
        self._log.add(self._logger.warning, self.last_message)

    def values(self) -> dict[str, int | str]:
        """Return the counters as key-value pairs of a diagnostic status."""
        counts = {f'rejected: {reason}': n for reason, n in sorted(self._counts.items())}
        return {'rejected': self.total, **counts, 'last rejection': self.last_message}
