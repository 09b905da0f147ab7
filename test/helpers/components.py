"""Components on /diagnostics, received by a node that its owner spins."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from facade_manipulator.topics import DIAGNOSTICS


def components_of(node: Node) -> dict[str, DiagnosticStatus]:
    """Return the last status of each component by its name; the dictionary is kept up to date."""
    components: dict[str, DiagnosticStatus] = {}

    def receive(message: DiagnosticArray) -> None:
        components.update((status.name, status) for status in message.status)

    node.create_subscription(DIAGNOSTICS.type, DIAGNOSTICS.name, receive, DIAGNOSTICS.qos)
    return components
