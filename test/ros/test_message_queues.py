"""Messages that wait for whoever takes them."""

from __future__ import annotations

import time

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import Int32

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.interfaces import LATCHED, Quality, RELIABLE, SENSOR, Topic
from facade_manipulator.ros.interfaces import publisher
from facade_manipulator.ros.message_queues import MessageQueues

pytestmark = pytest.mark.quick
DEPTH = RELIABLE.depth
TOLD = Topic('told', 'std_msgs/Int32', RELIABLE, ())


def test_messages_wait_with_the_time_at_which_they_came(ros):
    node, taken = ros.node('taker', namespace='gondola_1'), []
    queues = MessageQueues(node)
    queue = queues.subscribe(TOLD, DEPTH, lambda _, messages: taken.extend(messages))
    assert (queue.topic, queue.kind) == ('/gondola_1/told', Int32)
    sender = publisher(node, TOLD)
    ros.until(lambda: sender.get_subscription_count() == 1, 'the queue')
    before = time.monotonic()
    for number in range(DEPTH):
        sender.publish(Int32(data=number))
    ros.until(lambda: queues.take() or len(taken) == DEPTH, 'all of them')
    assert [data[4] for _, data in taken] == list(range(DEPTH))
    times = [came for came, _ in taken]
    assert times == sorted(times) and before - 0.01 <= times[0] and times[-1] <= time.monotonic()
    queues.close()
    ros.until(lambda: sender.get_subscription_count() == 0, 'the end of the queue')


def test_only_the_last_messages_wait_and_one_turn_ends_while_more_come(ros):
    node, taken = ros.node('taker'), []
    sender, queues = publisher(node, TOLD), MessageQueues(node)
    queue = queues.subscribe(TOLD, 2, lambda _, messages: taken.append(
        [data[4] for _, data in messages]))
    ros.until(lambda: sender.get_subscription_count() == 1, 'the queue')
    for number in range(DEPTH):
        sender.publish(Int32(data=number))
    ros.until(lambda: queues.take() or taken and taken[-1][-1] == DEPTH - 1, 'the last')
    assert max(map(len, taken)) <= queue.quality.depth == 2


@pytest.mark.parametrize('offered, is_stream, is_reliable', [
    (RELIABLE, False, True), (RELIABLE, True, False), (SENSOR, False, False),
    (LATCHED, False, True)])
def test_queue_of_a_stream_requests_best_effort(ros, offered, is_stream, is_reliable):
    topic = TOLD._replace(is_stream=is_stream, quality=offered)
    queue = MessageQueues(ros.node('taker')).subscribe(topic, 1, print)
    assert queue.quality == Quality(1, is_reliable, offered.latched)


def test_an_rclpy_that_has_none_is_a_message(ros, monkeypatch):
    monkeypatch.delattr(rclpy_implementation, 'Subscription')
    node = ros.node('taker')
    with pytest.raises(ManipulatorError, match='has no Subscription'):
        MessageQueues(node).subscribe(TOLD, DEPTH, print)
