"""
One publisher for each command and feedback topic: a second one is named, and moves nothing.

rclpy does not name the publisher of a message. While a topic has two publishers, all its messages
are rejected, because the node cannot tell which of the two they come from.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.subscription import Subscription

from facade_manipulator.errors import InputError
from facade_manipulator.interfaces import Topic
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.diagnostics import Rejections
from facade_manipulator.ros.interfaces import subscription

LOOK_PERIOD = 0.5  # s; one look at a topic takes 6 us
BOUND = 1  # publisher of a topic


class PublisherWatch:
    """
    Count the publishers of a node's input topics.

    The middleware reports a new publisher before its first message. A timer looks again, because
    the name of its node may arrive later, and for publishers that are not received.

    Parameters
    ----------
    node : rclpy.node.Node
    rejections : Rejections
        Counts the messages that are rejected because of a second publisher.
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
        self, topic: Topic, callback: Callable[[Any], None], raw: bool = False
    ) -> Subscription:
        """Subscribe to a topic whose messages are rejected while it has two publishers."""
        def receive(message: Any) -> None:
            try:
                self.require_sole(topic.name)
            except InputError as error:
                self._rejections.add(error)
            else:
                callback(message)

        return subscription(self._node, topic, receive, raw, matched=self.watch(topic.name))

    def watch(self, name: str) -> Callable[[Any], None]:
        """Count the publishers of a topic from now on; return its subscription's `matched`."""
        self._resolved[name] = self._node.resolve_topic_name(name)
        return lambda matched: self._count(name, matched.current_count)

    def require_sole(self, name: str) -> None:
        """Raise an InputError with reason ``'publishers'`` while a topic has two publishers."""
        if fault := self._faults.get(name):
            raise InputError('publishers', f'{name} rejected: {fault}')

    def fault_of(self, name: str) -> str:
        """Return how many publishers a topic has, and their nodes, ``''`` for at most one."""
        return self._faults.get(name, '')

    @property
    def fault(self) -> str:
        """Return which topics have a second publisher and the next step, ``''`` for none."""
        faults = '; '.join(self._faults.values())
        return faults and f'{faults}; next: end one of the nodes'

    def _look(self) -> None:
        for name in self._resolved:
            self._count(name)

    def _count(self, name: str, matched: int = 0) -> None:
        """Note the publishers of a topic; the middleware may match one before the graph has it."""
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
