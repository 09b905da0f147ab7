"""
Software stop: the message true stops the drives until the operator requests clear_faults.

Each topic belongs to one supervisor, because rclpy does not name the publisher of a message. A
second publisher forbids power, because its message false would hide the silence of the first
publisher. A publisher with an incompatible quality of service also forbids power.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from facade_manipulator.errors import DriveStateError


@dataclass
class _Topic:
    """State of one supervisor's stop topic."""

    newest: bool | None = None  #: None before the first message
    received_at: float = 0.0  #: [s, monotonic]
    is_latched: bool = False  #: whether a true was received since the last clear_faults


class SoftwareStop:
    """
    Software stops of all supervisors, without ROS; messages and monotonic times [s] are arguments.

    Parameters
    ----------
    names : sequence of str
        Topics, one for each supervisor.
    timeout : float
        Silence of a topic that forbids power, after its first message [s].
    fault_of : callable
        Returns the fault of the publishers of a topic, ``''`` for none.

    """

    SEND_FALSE = 'publish false on {} ten times a second'
    ONE_EACH = (
        'let one node publish {} with reliable quality of service, or wait 20 s if a node '
        'has crashed'
    )
    # a supervisor in another namespace or domain, or on another topic, is otherwise invisible
    NEVER_RECEIVED = '{} was never received: no supervisor can stop the drives with it'
    NO_TOPIC = (
        'no topic of software_stop is configured: no supervisor can stop the drives'
    )

    def __init__(
        self, names: Sequence[str], timeout: float, fault_of: Callable[[str], str]
    ) -> None:
        self._topics = {name: _Topic() for name in names}
        self._timeout, self._fault_of = timeout, fault_of

    def cause(self, now: float) -> str:
        """Return why drives must not have power, ``''`` if all supervisors permit power."""
        return '; '.join(
            filter(
                None,
                (
                    f'{name} was set'
                    if topic.is_latched
                    else self._fault_of(name) or self._silence(name, now)
                    for name, topic in self._topics.items()
                ),
            )
        )

    @property
    def is_latched(self) -> bool:
        """Return whether a true forbids power until clear_faults."""
        return any(topic.is_latched for topic in self._topics.values())

    def next_step(self, now: float) -> str:
        """Return the steps before the requests, ``''`` if each newest message is false."""
        return ', '.join(
            filter(None, (self._obstacle(name, now)[1] for name in self._topics))
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes about missing supervision, which forbids no power."""
        if not self._topics:
            return (self.NO_TOPIC,)
        return tuple(
            self.NEVER_RECEIVED.format(name)
            for name, topic in self._topics.items()
            if topic.newest is None
        )

    def receive(self, name: str, is_set: bool, now: float) -> None:
        """Record a supervisor's message received at a time [s]."""
        topic = self._topics[name]
        topic.newest, topic.received_at = is_set, now
        topic.is_latched = topic.is_latched or is_set

    def clear(self, now: float) -> frozenset[str]:
        """
        Release the active stops; return their topics.

        Raises a DriveStateError while a newest message is true, or while a topic is silent, has
        two publishers, or has an incompatible publisher.
        """
        for name in self._topics:
            reason, next_step = self._obstacle(name, now)
            if reason:
                raise DriveStateError(
                    f'clear_faults rejected: {reason}; next: {next_step}, then clear_faults'
                )
        released = frozenset(
            name for name, topic in self._topics.items() if topic.is_latched
        )
        for name in released:
            self._topics[name].is_latched = False
        return released

    def restore(self, names: Iterable[str]) -> None:
        """Restore the released stops after the drives have rejected clear_faults."""
        for name in names:
            self._topics[name].is_latched = True

    def _obstacle(self, name: str, now: float) -> tuple[str, str]:
        """Return why clear_faults is impossible, with a next step; ``''`` if it is possible."""
        topic = self._topics[name]
        if fault := self._fault_of(name):
            return fault, self.ONE_EACH.format(name)
        reason = self._silence(name, now)
        if topic.newest:
            reason = (
                f'{name} is true (received {now - topic.received_at:.2f} s ago) '
                'and must be false'
            )
        return reason, reason and self.SEND_FALSE.format(name)

    def _silence(self, name: str, now: float) -> str:
        """Return the message for a silent supervisor, which is constant during the silence."""
        topic = self._topics[name]
        if topic.newest is None or now - topic.received_at <= self._timeout:
            return ''
        return f'{name} has been silent for more than {self._timeout:g} s'
