"""software_stop: true keeps the power off, and silence stops once a message was received."""

from __future__ import annotations

from collections.abc import Callable
import time

from rclpy.node import Node
from std_msgs.msg import Bool

from facade_manipulator.ros.runtime import LATEST


class SoftwareStop:
    """
    Subscribe to a supervisor's stop, and watch its silence.

    Parameters
    ----------
    node : rclpy.node.Node
    stop : callable
        Takes the cause of a stop; called when there is silence.
    forbid : callable
        Takes why there may be no power, ``''`` when there may; called with every message.

    """

    def __init__(
        self, node: Node, stop: Callable[[str], None], forbid: Callable[[str], None],
    ) -> None:
        self._stop_drives = stop
        self._forbid = forbid
        self._received_at: float | None = None
        node.create_subscription(Bool, 'software_stop', self._receive, LATEST)

    def watch(self, timeout: float) -> None:
        """Stop when it has been silent for a time [s], once until the next message."""
        if self._received_at is None:
            return
        silence = time.monotonic() - self._received_at
        if silence > timeout:
            self._received_at = None
            self._stop_drives(
                f'software_stop has been silent for {silence:.2f} s, bound {timeout:g} s')

    def _receive(self, message: Bool) -> None:
        self._received_at = time.monotonic()
        if message.data:
            self._forbid('software_stop was set')
        else:
            self._forbid('')
