"""
software_stop: true forbids power, and so does silence once a message was received.

Each topic is the level of one supervisor: the message info of rclpy names no publisher, so that a
second supervisor has a topic of its own. Two publishers on one topic forbid power as well: one's
false would undo the other's true, and its messages would hide the other's silence. So does one
that cannot be heard, with a quality of service that is not reliable.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import time

from rclpy.node import Node
from std_msgs.msg import Bool

from facade_manipulator import interfaces
from facade_manipulator.ros.interfaces import incompatible, subscription


class SoftwareStop:
    """
    Subscribe to the stops of supervisors, and watch their silence.

    Parameters
    ----------
    node : Node
    forbid : callable
        Takes why there may be no power, ``''`` when there may; called when that has changed.
    topics : sequence of str
        One for each supervisor.

    """

    def __init__(
        self, node: Node, forbid: Callable[[str], None],
        topics: Sequence[str] = (interfaces.SOFTWARE_STOP.name,),
    ) -> None:
        self._node = node
        self._forbid = forbid
        self._received_at: dict[str, float] = {}
        self._causes: dict[str, str] = {}
        for topic in topics:
            subscription(node, interfaces.SOFTWARE_STOP, partial(self._receive, topic), name=topic,
                         incompatible=partial(self._find_incompatible, topic))

    def watch(self, timeout: float) -> None:
        """Forbid power for a supervisor that has been silent for a time [s], until it speaks."""
        now = time.monotonic()
        for topic, received_at in list(self._received_at.items()):
            if now - received_at > timeout:
                del self._received_at[topic]  # said once; the cause stays
                self._note(topic, self._causes.get(topic) or (
                    f'{topic} has been silent for {now - received_at:.2f} s, '
                    f'bound {timeout:g} s'))

    def _receive(self, topic: str, message: Bool) -> None:
        self._received_at[topic] = time.monotonic()
        publishers = self._node.count_publishers(topic)
        if message.data:
            self._note(topic, f'{topic} was set')
        elif publishers > 1:
            self._note(topic, f'{topic} has {publishers} publishers, bound 1 (see '
                              'software_stop_topics)')
        else:
            self._note(topic, '')

    def _find_incompatible(self, topic: str, _: object) -> None:
        """Forbid power for a supervisor of which no true would come, until a message comes."""
        self._note(topic, incompatible(topic))

    def _note(self, topic: str, cause: str) -> None:
        before = list(self._causes.values())
        self._causes[topic] = cause
        if list(self._causes.values()) != before:
            self._forbid('; '.join(filter(None, self._causes.values())))
