"""
One publisher for each input topic of a node: a second one is named, and moves nothing.

rclpy does not name the publisher of a message. While a topic has two publishers, the node rejects
all its messages, because it cannot tell which of the two they come from.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription

from facade_manipulator.errors import InputError, LimitError, ManipulatorError
from facade_manipulator.nodes.clock import steady_timer
from facade_manipulator.nodes.diagnostics import Rejections
from facade_manipulator.topics import Topic

LOOK_PERIOD = 0.5  # s; counting the publishers of a topic takes 6 us
BOUND = 1  # publisher of a topic


class PublisherWatch:
    """
    Subscribe to the input topics of a node and count their publishers.

    The middleware reports a new publisher before its first message. A timer counts again, because
    the name of its node may arrive later, and for publishers whose messages cannot be received.

    Parameters
    ----------
    node : rclpy.node.Node
    rejections : Rejections
        Counts the rejected messages.
    on_change : callable
        Called after the publishers of a topic have changed.

    """

    def __init__(
        self, node: Node, rejections: Rejections, on_change: Callable[[], None] = lambda: None
    ) -> None:
        self._node, self._rejections, self._on_change = node, rejections, on_change
        self._resolved: dict[str, str] = {}  # name in the graph of each topic
        self._faults: dict[str, str] = {}  # of the topics with a second publisher
        steady_timer(node, LOOK_PERIOD, self._look)

    def subscribe(
        self, topic: Topic, callback: Callable[[Any], None],
        on_rejection: Callable[[Any, ManipulatorError], None] = lambda *_: None,
    ) -> Subscription:
        """
        Subscribe to a topic; its messages are rejected while it has two publishers.

        Parameters
        ----------
        topic : Topic
        callback : callable
            Receives a message; a `ManipulatorError` that it raises is counted as a rejection.
        on_rejection : callable, optional
            Receives the rejected message and the error.

        """
        def receive(message: Any) -> None:
            try:
                self.require_sole(topic.name)
                callback(message)
            except ManipulatorError as error:
                self._rejections.add(error, topic.name if isinstance(error, LimitError) else '')
                on_rejection(message, error)

        return self._node.create_subscription(
            topic.type, topic.name, receive, topic.qos, event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=lambda _: self._rejections.add(
                    InputError('quality', incompatible(topic.name))),
                matched=self.watch(topic.name)))

    def watch(self, name: str) -> Callable[[Any], None]:
        """Count the publishers of a topic from now on; return its subscription's `matched`."""
        self._resolved[name] = self._node.resolve_topic_name(name)
        return lambda matched: self._count(name, matched.current_count)

    def require_sole(self, name: str) -> None:
        """Raise an InputError with reason ``'publishers'`` while a topic has two publishers."""
        if fault := self._faults.get(name):
            raise InputError('publishers', f'{name} rejected: {fault}')

    def fault_of(self, name: str) -> str:
        """Return the number of publishers of a topic and their nodes, ``''`` for at most one."""
        return self._faults.get(name, '')

    @property
    def fault(self) -> str:
        """Return the topics with a second publisher and the next step, ``''`` for none."""
        faults = '; '.join(self._faults.values())
        return faults and f'{faults}; next: end one of the nodes'

    def _look(self) -> None:
        for name in self._resolved:
            self._count(name)

    def _count(self, name: str, matched: int = 0) -> None:
        """Count the publishers of a topic; a match may precede the graph."""
        topic = self._resolved[name]
        count = max(matched, self._node.count_publishers(topic))
        fault = ''
        if count > BOUND:
            nodes = ', '.join(sorted(
                f"{one.node_namespace.rstrip('/')}/{one.node_name}"
                for one in self._node.get_publishers_info_by_topic(topic)))
            fault = f'{name} has {count} publishers ({nodes}), bound {BOUND}'
        if fault != self._faults.get(name, ''):
            self._faults[name] = fault
            self._faults = {one: what for one, what in self._faults.items() if what}
            self._on_change()


def incompatible(name: str) -> str:
    """Return the fault of a topic whose publisher is not reliable."""
    return f'{name} has an incompatible publisher: its quality of service is not reliable'
