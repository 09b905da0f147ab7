"""How a node's process ends."""

import os
import signal

import pytest
import rclpy

from facade_manipulator.nodes import runtime


@pytest.fixture
def handlers():
    """Put back the signal handlers that a process of nodes has for itself."""
    before = {number: signal.getsignal(number) for number in runtime.STOP_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def ending(how):
    """Return what makes a node that ends its process in a callback."""
    def make_nodes():
        node = rclpy.create_node('ending')
        node.create_timer(0.01, how)
        return [node]

    return make_nodes


@pytest.mark.parametrize('number', runtime.STOP_SIGNALS)
def test_a_signal_ends_a_node_in_order(ros_domain, handlers, capfd, number):
    assert runtime.run(ending(lambda: os.kill(os.getpid(), number))) == 0
    assert 'ended' not in capfd.readouterr().err


def test_no_node_ends_in_silence_when_ros_is_shut_down(ros_domain, handlers, capfd):
    assert runtime.run(ending(rclpy.try_shutdown)) == 1
    assert 'by no signal' in capfd.readouterr().err
