"""
Limit of one publisher per input topic: messages are rejected while a second publisher exists.

Rclpy does not name the publisher of a message. While a topic has two publishers, the node rejects
all its messages, because it cannot attribute them to either publisher.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import monotonic
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import (
    qos_check_compatible,
    qos_profile_sensor_data,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
)

from facade_manipulator.errors import InputError, LimitError, ManipulatorError
from facade_manipulator.nodes.conversions import steady_timer
from facade_manipulator.nodes.diagnostics import Diagnostics
from facade_manipulator.nodes.planar_messages import require_frame
from facade_manipulator.topics import Topic


@dataclass
class IncompatiblePublisher:
    """Publisher whose quality of service is incompatible with the subscription."""

    fault: str
    expected_until: float  #: when the graph must list the publisher [s, monotonic]
    was_in_graph: bool = False


class PublisherWatch:
    """
    Subscriber to the input topics of a node, which also counts the publishers.

    The middleware reports a new publisher before its first message. A timer counts again, because
    the name of the publisher's node may arrive later. The timer also finds publishers whose
    messages cannot be received.

    Parameters
    ----------
    node : rclpy.node.Node
    diagnostics : Diagnostics
        Counts the rejected messages.
    on_change : callable
        Called after the publishers of a topic have changed.

    """

    PUBLISHER_CHECK_PERIOD = 0.5  # s; counting the publishers of a topic takes 6 us
    BOUND = 1  # publisher of a topic
    # Fast DDS keeps a killed node in the graph for its lease of 20 s
    PUBLISHER_REMEDY = 'next: end one of the nodes, or wait 20 s if a node has crashed'
    ANY_PUBLISHER = qos_profile_sensor_data  # compatible with every publisher
    NAMELESS = '_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_'  # until the name arrives
    # s; the middleware may report a publisher before the graph lists it
    GRAPH_DELAY = 5.0
    # words of the quality of service that a subscription requires, by the kind of its policy
    POLICIES = {
        QoSPolicyKind.RELIABILITY: 'reliability is best effort and must be reliable',
        QoSPolicyKind.DURABILITY: 'durability is volatile and must be transient local',
    }

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self._node = node
        self._diagnostics = diagnostics
        self._on_change = on_change
        self._names: list[str] = []
        self._faults: dict[str, str] = {}  # of the topics with a second publisher
        # by topic: publishers whose messages cannot be received
        self._incompatible: dict[str, IncompatiblePublisher] = {}
        self._qos: dict[str, QoSProfile] = {}  # of the subscriptions, by topic
        steady_timer(node, self.PUBLISHER_CHECK_PERIOD, self.look)

    def watch(self, topic: Topic) -> None:
        """
        Count the publishers of a topic that this node itself publishes.

        The node subscribes, because a discovery server reports the publishers of a topic only to
        its subscribers. The messages are ignored.
        """
        self._names.append(topic.name)

        def count(status: Any) -> None:
            self._count(topic.name, status.current_count)

        self._node.create_subscription(
            topic.type,
            topic.name,
            lambda _: None,
            self.ANY_PUBLISHER,
            event_callbacks=SubscriptionEventCallbacks(matched=count),
        )

    def subscribe(
        self,
        topic: Topic,
        callback: Callable[[Any], None],
        on_rejection: Callable[[Any, ManipulatorError], None] = lambda *_: None,
        frame_id: str = '',
    ) -> None:
        """
        Subscribe to a topic; reject its messages while it has two publishers.

        Parameters
        ----------
        topic : Topic
        callback : callable
            Receives a message; a `ManipulatorError` that it raises is counted as a rejection.
        on_rejection : callable, optional
            Receives the rejected message and the error.
        frame_id : str, optional
            Frame that the messages must have.

        """
        name = topic.name
        self._names.append(name)
        self._qos[name] = topic.subscription_qos

        def receive(message: Any) -> None:
            def use() -> None:
                if frame_id:
                    require_frame(message.header.frame_id, frame_id, name)
                callback(message)

            self.accept(topic, use, partial(on_rejection, message))

        def count(status: Any) -> None:
            self._count(name, status.current_count)

        def report_incompatible(status: Any) -> None:
            words = self.POLICIES.get(
                QoSPolicyKind(status.last_policy_kind), 'quality of service'
            )
            fault = f'{name} has an incompatible publisher: its {words}'
            end = monotonic() + self.GRAPH_DELAY
            self._incompatible[name] = IncompatiblePublisher(fault, end)
            self._diagnostics.reject(InputError('quality', fault))
            self._on_change()

        self._node.create_subscription(
            topic.type,
            name,
            receive,
            topic.subscription_qos,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=report_incompatible, matched=count
            ),
        )

    def accept_calls(self, topic: Topic) -> None:
        """Count the publishers of a topic that is received through calls in this process."""
        self._names.append(topic.name)

    def accept(
        self,
        topic: Topic,
        use: Callable[[], None],
        on_rejection: Callable[[ManipulatorError], None] = lambda _: None,
    ) -> None:
        """
        Use an input, unless its topic has two publishers.

        A `ManipulatorError` of `use` is counted as a rejection and passed to `on_rejection`.
        """
        try:
            self.require_sole(topic.name)
            use()
        except ManipulatorError as error:
            what = topic.name if isinstance(error, LimitError) else ''
            self._diagnostics.reject(error, what)
            on_rejection(error)

    def require_sole(self, name: str) -> None:
        """Raise an InputError with reason ``'publishers'`` while a topic has two publishers."""
        if fault := self._faults.get(name):
            raise InputError('publishers', f'{fault}; {self.PUBLISHER_REMEDY}')

    def fault_of(self, name: str) -> str:
        """Return the fault of a topic: two publishers, or an incompatible publisher."""
        incompatible = self._incompatible.get(name)
        return self._faults.get(name, '') or (
            incompatible.fault if incompatible else ''
        )

    @property
    def fault(self) -> str:
        """Return the topics with two publishers and the next step, or ``''``."""
        faults = '; '.join(self._faults.values())
        return faults and f'{faults}; {self.PUBLISHER_REMEDY}'

    def look(self) -> None:
        """Count the publishers of all topics."""
        for name in self._names:
            self._count(name)
        for name in [*self._incompatible]:
            self._look_for_incompatible(name)

    def _look_for_incompatible(self, name: str) -> None:
        """Forget an incompatible publisher that is no longer in the graph."""
        topic = self._node.resolve_topic_name(name)
        is_in_graph = any(
            qos_check_compatible(one.qos_profile, self._qos[name])[0]
            is QoSCompatibility.ERROR
            for one in self._node.get_publishers_info_by_topic(topic)
        )
        found = self._incompatible[name]
        if is_in_graph:
            found.was_in_graph = True
        elif found.was_in_graph or monotonic() > found.expected_until:
            del self._incompatible[name]
            self._on_change()

    def _count(self, name: str, matched: int = 0) -> None:
        """Count the publishers of a topic; a match may be reported before the graph changes."""
        topic = self._node.resolve_topic_name(name)
        count = max(matched, self._node.count_publishers(topic))
        before = self._faults.pop(name, '')
        if count > self.BOUND:
            nodes = ', '.join(
                sorted(
                    f'{one.node_namespace.rstrip("/")}/{one.node_name}'
                    for one in self._node.get_publishers_info_by_topic(topic)
                )
            )
            nodes = nodes.replace(self.NAMELESS, 'unknown')
            self._faults[name] = (
                f'{name} has {count} publishers ({nodes}), above the limit {self.BOUND}'
            )
        if self._faults.get(name, '') != before:
            self._on_change()
