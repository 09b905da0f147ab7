"""
software_stop: a true stops and stays in force until the operator's clear_faults.

Each topic belongs to one supervisor, because rclpy does not name the publisher of a message. A
second publisher forbids power: its false would hide the silence of the first. So does a publisher
that cannot be received because its quality of service is not reliable.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
import time

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from std_msgs.msg import Bool

from facade_manipulator import topics
from facade_manipulator.errors import DriveStateError
from facade_manipulator.nodes.publisher_watch import incompatible, PublisherWatch

SEND_FALSE = 'publish false on {topic} ten times a second, then clear_faults'
ONE_EACH = ('end one of the nodes, or give it its own topic in software_stop_topics, then '
            'clear_faults')
RELIABLE = 'publish {topic} with reliable quality of service, then clear_faults'


@dataclass
class _Topic:
    """The messages of one supervisor; times are monotonic [s]."""

    newest: bool | None = None  #: None before the first message
    received_at: float = 0.0
    silence: str = ''  #: how long it was silent when that was found, if too long
    is_latched: bool = False  #: whether a true has come since the last clear_faults
    publishers: str = ''  #: how many there are, if more than one
    incompatible: str = ''


class SoftwareStop:
    """
    The stops of all supervisors, without ROS: messages, publishers and times are arguments.

    Parameters
    ----------
    topics : sequence of str
        One for each supervisor.

    """

    def __init__(self, topics: Sequence[str] = (topics.SOFTWARE_STOP.name,)) -> None:
        self._topics = {name: _Topic() for name in topics}

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the topics of the supervisors."""
        return tuple(self._topics)

    @property
    def cause(self) -> str:
        """Return why no drive may have power, ``''`` if all supervisors allow it."""
        return '; '.join(filter(None, (
            _cause(name, topic) for name, topic in self._topics.items())))

    def receive(self, name: str, is_set: bool, now: float) -> None:
        """Note a message of a supervisor at a time [s]."""
        topic = self._topics[name]
        topic.newest, topic.received_at = is_set, now
        topic.silence = topic.incompatible = ''
        topic.is_latched = topic.is_latched or is_set

    def note_publishers(self, name: str, fault: str) -> None:
        """Note a second publisher of a topic, ``''`` for none."""
        self._topics[name].publishers = fault

    def note_incompatible(self, name: str, fault: str) -> None:
        """Note a publisher that cannot be received, until a message arrives."""
        self._topics[name].incompatible = fault

    def watch(self, now: float, timeout: float) -> None:
        """Note the supervisors that have been silent for longer than a timeout [s]."""
        for name, topic in self._topics.items():
            age = now - topic.received_at
            if topic.newest is not None and not topic.silence and age > timeout:
                topic.silence = f'{name} has been silent for {age:.2f} s, bound {timeout:g} s'

    def clear(self, now: float, timeout: float) -> frozenset[str]:
        """
        Release the stops that are in force; return their topics.

        Raises a DriveStateError while a newest message is true, or a topic is silent, has two
        publishers, or one that cannot be received.
        """
        self.watch(now, timeout)
        for name, topic in self._topics.items():
            if rejection := _rejection(name, topic, now, timeout):
                raise DriveStateError(f'clear_faults rejected: {rejection}')
        released = frozenset(name for name, topic in self._topics.items() if topic.is_latched)
        self._latch(released, False)
        return released

    def restore(self, names: Iterable[str]) -> None:
        """Put released stops in force again: the drives have rejected clear_faults."""
        self._latch(names, True)

    def _latch(self, names: Iterable[str], is_latched: bool) -> None:
        for name in names:
            self._topics[name].is_latched = is_latched


def _cause(name: str, topic: _Topic) -> str:
    """Return why a topic forbids power, the same text each time, ``''`` if it does not."""
    if topic.is_latched:
        return f'{name} was set'
    return topic.publishers or topic.silence or topic.incompatible


def _rejection(name: str, topic: _Topic, now: float, timeout: float) -> str:
    """Return why the stop of a topic cannot be cleared and the next step, ``''`` if it can."""
    age = now - topic.received_at
    if topic.publishers:
        return f'{topic.publishers}; next: {ONE_EACH}'
    if topic.newest:
        return (f'{name} is true, received {age:.2f} s ago, required is false; '
                f'next: {SEND_FALSE.format(topic=name)}')
    if topic.silence:
        return (f'{name} has been silent for {age:.2f} s, bound {timeout:g} s; '
                f'next: {SEND_FALSE.format(topic=name)}')
    if topic.incompatible:
        return f'{topic.incompatible}; next: {RELIABLE.format(topic=name)}'
    return ''


def subscribe_software_stops(
    node: Node, stop: SoftwareStop, publishers: PublisherWatch, on_change: Callable[[], None]
) -> None:
    """Let a stop receive the messages of its topics; `on_change` is called after each."""
    def receive(name: str, message: Bool) -> None:
        stop.receive(name, message.data, time.monotonic())
        on_change()

    def find_incompatible(name: str, _: object) -> None:
        stop.note_incompatible(name, incompatible(name))
        on_change()

    for name in stop.topics:
        node.create_subscription(
            Bool, name, partial(receive, name), topics.SOFTWARE_STOP.qos,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=partial(find_incompatible, name),
                matched=publishers.watch(name)))
