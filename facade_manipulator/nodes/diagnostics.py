"""Diagnostics of a node: counts of rejections by reason, and components on /diagnostics."""

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
from facade_manipulator.nodes.conversions import steady_timer
from facade_manipulator.nodes.planar_messages import LEVEL_NAMES

LOG_PERIOD = 10.0  # s, between two warnings in the log for the same reason


def key_values(values: Mapping[str, Any]) -> list[KeyValue]:
    """Convert values to messages; floats have six digits."""
    return [
        KeyValue(
            key=key, value=f'{value:.6g}' if isinstance(value, float) else str(value)
        )
        for key, value in values.items()
    ]


HOST = platform.node()  # hardware id of a component that is not a drive


def diagnostic_status(
    name: str,
    level: str,
    message: str,
    values: Mapping[str, Any],
    hardware_id: str = HOST,
) -> DiagnosticStatus:
    """Return the status message of a component; `level` is one of `LEVEL_NAMES`."""
    return DiagnosticStatus(
        name=name,
        level=bytes([LEVEL_NAMES.index(level)]),
        message=message,
        hardware_id=hardware_id,
        values=key_values(values),
    )


class Diagnostics:
    """
    Counter of rejections, and publisher of the node's components each second and on change.

    Parameters
    ----------
    node : rclpy.node.Node
    components : callable
        Returns a list of DiagnosticStatus, each with the name of its component. The counters of
        the rejections are added to the first.

    """

    DIAGNOSTICS_PERIOD = 1.0  # s, between two messages on /diagnostics

    def __init__(
        self, node: Node, components: Callable[[], list[DiagnosticStatus]]
    ) -> None:
        self._node, self._components = node, components
        self._counts: Counter[str] = Counter()
        self._logged: dict[
            str, float
        ] = {}  # time of the last log line by reason [s, monotonic]
        self._outcome: Any = None
        self.last_rejection = ''
        self._publisher = node.create_publisher(*topics.DIAGNOSTICS)
        steady_timer(node, self.DIAGNOSTICS_PERIOD, self.publish)

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Catch and count a `ManipulatorError` raised in a block; continue after the block."""
        try:
            yield
        except ManipulatorError as error:
            self.reject(error)

    def reject(
        self, error: ManipulatorError, what: str = '', is_logged: bool = True
    ) -> None:
        """
        Count a rejected message or request; log each reason at most once per `LOG_PERIOD`.

        `what` is the name of the message or request, if the error has none.
        """
        reason = getattr(error, 'reason', 'other')
        self._counts[reason] += 1
        self.last_rejection = f'{what}: {error}' if what else str(error)
        if is_logged:
            self.warn(reason, self.last_rejection)

    def warn(self, reason: str, text: str) -> None:
        """
        Log a warning; log each reason at most once per `LOG_PERIOD`.

        The throttle of rclpy's logger searches its caller's file in each call, which takes 0.7 ms.
        """
        now = time.monotonic()
        if now - self._logged.get(reason, -math.inf) >= LOG_PERIOD:
            self._logged[reason] = now
            self._node.get_logger().warning(text)

    def rejections(self) -> dict[str, Any]:
        """Return the counts of rejections as the values of a component."""
        counts = {
            f'rejected: {reason}': count
            for reason, count in sorted(self._counts.items())
        }
        return {
            'rejected': self._counts.total(),
            **counts,
            'last rejection': self.last_rejection,
        }

    def publish_change(self, outcome: Any) -> None:
        """Publish at once if the outcome differs from the previous outcome."""
        if outcome != self._outcome:
            self._outcome = outcome
            self.publish()

    def publish(self) -> None:
        """Publish the present status of all components."""
        message = DiagnosticArray(status=self._components())
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status[0].values.extend(key_values(self.rejections()))
        node_name = self._node.get_fully_qualified_name().lstrip('/')
        for status in message.status:
            status.name = f'{node_name}: {status.name}'
        self._publisher.publish(message)
