"""Messages on driver/status, which the driver publishes and compensator and ik_service read."""

from __future__ import annotations

from collections.abc import Callable
import math
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.errors import InputError
from facade_manipulator.nodes.conversions import ros_time, steady_timer
from facade_manipulator.nodes.messages import status_values
from facade_manipulator.nodes.publisher_watch import PublisherWatch

STATUS_PERIOD = 0.5  # s, between two equal messages on driver/status
SILENCE = (
    4 * STATUS_PERIOD
)  # s without a message, after which the driver counts as silent


def state_sentence(state: str) -> str:
    """Return a state such as ``'active'`` or ``'bus lost'`` as a sentence."""
    subject, lost, _ = state.partition(' lost')
    return f'the {subject} is lost' if lost else f'the drives are {state}'


class DriverStatus(NamedTuple):
    """State of the drives in a message on driver/status."""

    state: str  #: such as ``'active'`` or ``'stopped'``
    activity: str  #: of the carriages while the state is active, such as ``'holding'``
    next_step: (
        str  #: of the operator before goals are followed, ``''`` if they are followed
    )
    #: since when the drives follow setpoints [s, ROS time]; infinite while they do not
    active_since: float = math.inf
    power: str = 'unknown'  #: of the drives, by their statuswords

    def __str__(self) -> str:
        """Return the state as the reason of a rejection."""
        return 'the driver is silent' if self is SILENT else state_sentence(self.state)

    def values(self) -> dict[str, str]:
        """Return the values of the message on driver/status."""
        return {
            name.replace('_', ' '): str(value) for name, value in self._asdict().items()
        }

    @staticmethod
    def from_message(message: DiagnosticStatus) -> DriverStatus:
        """Return the content of a message; raises an InputError for another program's message."""
        values = status_values(message)
        try:
            since = float(values['active since'])
            if not since > -math.inf:  # NaN neither
                raise ValueError(f'active since {since}')
            return DriverStatus(
                values['state'],
                values['activity'],
                values['next step'],
                since,
                values.get('power', 'unknown'),
            )
        except (KeyError, ValueError) as error:
            raise InputError(
                'names', f'driver/status rejected: {error}; next: end the other program'
            ) from None


SILENT = DriverStatus('silent', 'unknown', 'check whether the driver still runs')


class DriverWatch:
    """
    Receiver of driver/status that detects its silence.

    Parameters
    ----------
    node : rclpy.node.Node
    inputs : PublisherWatch
        Subscribes to the topic.
    on_change : callable
        Called after `status` has changed.

    Attributes
    ----------
    status : DriverStatus or None
        None before the first message, `SILENT` after `SILENCE` without a message.

    """

    def __init__(
        self, node: Node, inputs: PublisherWatch, on_change: Callable[[], None]
    ) -> None:
        self.status: DriverStatus | None = None
        self._active_from = math.inf  # s, monotonic: the system clock may be set
        self._on_change = on_change
        inputs.subscribe(topics.DRIVER_STATUS, self._receive)
        self._silence = steady_timer(
            node, SILENCE, lambda: self._change(SILENT), autostart=False
        )

    @property
    def idle(self) -> DriverStatus | None:
        """Return the status of a driver that does not follow setpoints, otherwise None."""
        status = self.status
        return None if status is None or math.isfinite(status.active_since) else status

    @property
    def end_of_goal(self) -> str:
        """Return why a followed goal has ended, with the next step of the operator."""
        step = self.status.next_step if self.status else ''
        step = step or 'follow the next step on driver/status'
        return f'{self.status}; next: {step}, then send a new goal'

    def may_move(self, received: float) -> bool:
        """Return whether a goal of a time [s, monotonic] was received after the activation."""
        return self.status is None or received >= self._active_from

    def _receive(self, message: DiagnosticStatus) -> None:
        self._change(DriverStatus.from_message(message))
        self._silence.reset()

    def _change(self, status: DriverStatus) -> None:
        if status == self.status:
            return
        if self.status is None or status.active_since != self.status.active_since:
            # a driver that returns starts no earlier motion; the clock may have been set back
            age = (
                0.0
                if self.status is SILENT
                else max(ros_time() - status.active_since, 0.0)
            )
            self._active_from = (
                math.inf
                if math.isinf(status.active_since)
                else (time.monotonic() - age)
            )
        self.status = status
        self._on_change()
