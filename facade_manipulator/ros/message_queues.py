"""Subscriptions whose messages wait until they are taken, for observers of other nodes."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from itertools import islice
from typing import Any

from rclpy.node import Node
from rclpy.type_support import check_for_type_support

from facade_manipulator.arrivals import Arrivals
from facade_manipulator.interfaces import Quality, Topic
from facade_manipulator.ros.codec import message_from
from facade_manipulator.ros.interfaces import class_of, profile
from facade_manipulator.ros.rclpy_internals import subscription_without_executor

Arrived = list[tuple[float, bytes]]  #: messages, each with the time at which it came [s]


class MessageQueue:
    """The last messages of a topic, as bytes; a queue does not delay the publisher of a stream."""

    def __init__(self, node: Node, topic: Topic, depth: int) -> None:
        self.kind, self.topic = class_of(topic), node.resolve_topic_name(topic.name)
        check_for_type_support(self.kind)
        latched = topic.quality.latched
        self.quality = Quality(depth, topic.quality.reliable and not topic.is_stream, latched)
        self._subscription = subscription_without_executor(
            node, self.kind, topic.name, profile(self.quality))

    def take(self) -> Arrived:
        """Return what has come since, no more than its depth, by the system's clock."""
        take = partial(self._subscription.take_message, self.kind, True)
        with self._subscription:
            return [(1e-9 * info['received_timestamp'], data)
                    for data, info in islice(iter(take, None), self.quality.depth)]

    def read(self, messages: Arrived, receive: Callable[[float, Any], None],
             errors: AbstractContextManager[Any]) -> None:
        """Let a function receive messages; other bytes are an InputError, in a context."""
        for came, data in messages:
            with errors:
                receive(came, message_from(data, self.kind, self.topic))

    def close(self) -> None:
        """Subscribe no longer."""
        self._subscription.destroy_when_not_in_use()


class MessageQueues:
    """
    Topics of a node that no executor knows: what came is taken in turns.

    An executor calls Python for each message: for five topics at 100 Hz that are only kept, 3 % of
    a processor, of which queues take a quarter. The depth of a topic has to last for a turn.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._arrivals = node, Arrivals()
        self.queues: dict[MessageQueue, Callable[[MessageQueue, Arrived], None]] = {}

    def subscribe(
        self, topic: Topic, depth: int, receive: Callable[[MessageQueue, Arrived], None]
    ) -> MessageQueue:
        """Let a function receive what came in a turn, oldest first, by the monotonic clock."""
        queue = MessageQueue(self._node, topic, depth)
        self.queues[queue] = receive
        return queue

    def take(self) -> None:
        """Hand on what has come since the turn before."""
        self._arrivals.begin()
        for queue, receive in self.queues.items():
            if messages := queue.take():
                receive(queue, [(self._arrivals.time(came), data) for came, data in messages])

    def close(self) -> None:
        """Subscribe no longer."""
        while self.queues:
            self.queues.popitem()[0].close()
