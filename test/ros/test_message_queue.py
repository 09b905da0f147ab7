"""Messages that wait for whoever takes them."""

from __future__ import annotations

import time

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import Int32

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.interfaces import RELIABLE, Topic
from facade_manipulator.ros import MessageQueue, publisher

DEPTH = RELIABLE.depth
TOLD = Topic('told', 'std_msgs/Int32', RELIABLE, ())


def test_messages_wait_with_the_time_at_which_they_came(ros):
    node = ros.node('taker', namespace='gondola_1')
    queue = MessageQueue(node, TOLD, RELIABLE)
    assert (queue.topic, queue.kind) == ('/gondola_1/told', Int32)
    sender = publisher(node, TOLD)
    ros.until(lambda: sender.get_subscription_count() == 1, 'the queue')
    before, taken = time.time(), []
    for number in range(DEPTH):
        sender.publish(Int32(data=number))
    ros.until(lambda: taken.extend(queue.take()) or len(taken) == DEPTH, 'all of them')
    assert [data[4] for _, data in taken] == list(range(DEPTH))
    times = [received for received, _ in taken]
    assert times == sorted(times) and before <= times[0] and times[-1] <= time.time()
    queue.close()
    ros.until(lambda: sender.get_subscription_count() == 0, 'the end of the queue')


def test_an_rclpy_that_has_none_is_a_message(ros, monkeypatch):
    monkeypatch.delattr(rclpy_implementation, 'Subscription')
    node = ros.node('taker')
    with pytest.raises(ManipulatorError, match='has no Subscription'):
        MessageQueue(node, TOLD, RELIABLE)
