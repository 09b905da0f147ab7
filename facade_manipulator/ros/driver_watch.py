"""What the driver is doing, from driver/status; it decides which goals may move the carriages."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from facade_manipulator.ros.conversions import diagnostic_status
from facade_manipulator.ros.runtime import LATCHED

DRIVER_STATUS = 'driver/status'


class DriverStatus(NamedTuple):
    """
    What the driver is doing.

    Attributes
    ----------
    state : str
        Such as ``'active'`` or ``'stopped'``.
    activity : str
        What the carriages are doing while it is active, such as ``'holding'``.
    next_step : str
        What the operator does so that goals are followed, ``''`` if they are.
    active_since : float
        Since when the drives follow setpoints [s]; infinite while they do not.

    """

    state: str
    activity: str
    next_step: str
    active_since: float = math.inf

    @property
    def is_active(self) -> bool:
        """Return whether the drives follow setpoints."""
        return math.isfinite(self.active_since)

    def to_message(self, level: str, message: str) -> DiagnosticStatus:
        """Return the message on driver/status."""
        return diagnostic_status('operation', level, message, {
            'state': self.state, 'activity': self.activity, 'next step': self.next_step,
            'active since': str(self.active_since)})

    @staticmethod
    def from_message(message: DiagnosticStatus) -> DriverStatus:
        """Return what a message on driver/status says."""
        values = {item.key: item.value for item in message.values}
        return DriverStatus(values['state'], values['activity'], values['next step'],
                            float(values['active since']))


class DriverWatch:
    """
    Know what the driver is doing.

    Parameters
    ----------
    node : rclpy.node.Node
    on_change : callable
        Called after `status` has changed.

    Attributes
    ----------
    status : DriverStatus or None
        None before a driver has published it.

    """

    def __init__(self, node: Node, on_change: Callable[[], None]) -> None:
        self.status: DriverStatus | None = None
        self._on_change = on_change
        node.create_subscription(DiagnosticStatus, DRIVER_STATUS, self._receive, LATCHED)

    @property
    def is_idle(self) -> bool:
        """Return whether there is a driver and it does not follow setpoints."""
        return self.status is not None and not self.status.is_active

    def may_move(self, time: float) -> bool:
        """Return whether a goal that came at a time [s] came after the drives were activated."""
        return self.status is None or time >= self.status.active_since

    def _receive(self, message: DiagnosticStatus) -> None:
        self.status = DriverStatus.from_message(message)
        self._on_change()
