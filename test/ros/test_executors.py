import time

import pytest
import rclpy
from rclpy import experimental
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Empty
from std_srvs.srv import Trigger

from facade_manipulator.ros import runtime
from facade_manipulator.ros.rclpy_internals import take_what_waits
from facade_manipulator.ros.runtime import choose_executor


class Deaf:
    """An executor as rclpy 7.1.6 has it when spun without a time-out: nothing ever arrives."""

    def add_node(self, _):
        pass

    def remove_node(self, _):
        pass

    def spin_once(self, timeout_sec):
        time.sleep(0.001)


def broken():
    raise RuntimeError('not in this build')


def test_messages_arrive_in_the_executor_that_is_chosen(ros):
    node = rclpy.create_node('listener')
    heard = []
    node.create_subscription(Empty, 'told', heard.append, 1)
    publisher = node.create_publisher(Empty, 'told', 1)
    node.create_timer(0.01, lambda: publisher.publish(Empty()))
    executor = choose_executor()
    executor.add_node(node)
    ros.executor = executor
    ros.until(lambda: heard, 'a message')
    node.destroy_node()


@pytest.mark.quick
@pytest.mark.parametrize('events_executor', [Deaf, broken])
def test_an_events_executor_that_does_not_work_is_replaced(ros, monkeypatch, events_executor):
    monkeypatch.setattr(experimental, 'EventsExecutor', events_executor)
    monkeypatch.setattr(runtime, 'CHECK_TIMEOUT', 0.1)
    assert isinstance(choose_executor(), SingleThreadedExecutor)


def test_nothing_of_the_check_remains_in_the_graph(ros):
    choose_executor()
    witness = ros.node('witness')
    ros.until(lambda: witness.get_node_names() == ['witness'], 'the check to be gone')


def test_what_came_before_an_executor_listened_is_heard_and_answered(ros):
    """It comes between counting and listening: 2 of 2,000 messages did, sent at that moment."""
    node, other, heard = rclpy.create_node('unheard'), ros.node('other'), []
    node.create_subscription(Empty, 'told', heard.append, 3)
    node.create_service(
        Trigger, 'asked', lambda request, response: heard.append(request) or response)
    publisher = other.create_publisher(Empty, 'told', 3)
    client = other.create_client(Trigger, 'asked')
    ros.until(lambda: client.service_is_ready() and publisher.get_subscription_count(), 'both')
    for _ in range(3):
        publisher.publish(Empty())
    answers = [client.call_async(Trigger.Request()) for _ in range(2)]

    def all_are_answered():
        take_what_waits(node)
        return all(answer.done() for answer in answers)

    ros.until(all_are_answered, 'the answers')
    assert [type(one) for one in heard] == 3 * [Empty] + 2 * [Trigger.Request]
    node.destroy_node()
