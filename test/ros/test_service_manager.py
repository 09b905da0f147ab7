"""What systemd is told, and how often its watchdog is fed."""

from __future__ import annotations

from contextlib import suppress
import os
import signal
import socket

import pytest
import rclpy

from facade_manipulator.ros import runtime
from facade_manipulator.ros.runtime import ServiceManager

VARIABLES = ('NOTIFY_SOCKET', 'WATCHDOG_USEC', 'WATCHDOG_PID')


@pytest.fixture(params=['path', 'abstract'])
def manager(request, tmp_path):
    """Listen as systemd does; return the address that it puts into the environment."""
    address = str(tmp_path / 'notify') if request.param == 'path' else f'@{tmp_path}'
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(address.replace('@', '\0'))
        listener.setblocking(False)
        yield address, listener


def test_each_word_arrives_and_no_child_hears_of_it(manager, monkeypatch):
    address, listener = manager
    monkeypatch.setenv('NOTIFY_SOCKET', address)
    made = ServiceManager()
    for state in ('READY', 'WATCHDOG', 'STOPPING'):
        made.notify(state)
        assert listener.recv(99) == f'{state}=1'.encode()
    listener.close()
    made.notify('READY')  # to nobody
    assert not {*VARIABLES} & {*os.environ}


@pytest.mark.parametrize('values, period', [
    (('@x', '3000000', ''), 1.5), (('@x', '3000000', str(os.getpid())), 1.5),
    (('@x', '3000000', '1'), None), (('@x', '0', ''), None), (('@x', '', ''), None),
    (('@x', 'soon', ''), None), (('', '3000000', ''), None)])
def test_the_watchdog_is_fed_twice_in_its_time_where_it_waits_for_this_process(
        monkeypatch, values, period):
    for name, value in zip(VARIABLES, values, strict=True):
        monkeypatch.setenv(name, value)
        if not value:
            monkeypatch.delenv(name)
    assert ServiceManager().feed_period == period


@pytest.mark.quick
def test_a_node_says_that_it_is_ready_then_that_it_lives_then_that_it_ends(
        ros_domain, handlers, manager, monkeypatch):
    address, listener = manager
    monkeypatch.setenv('NOTIFY_SOCKET', address)
    monkeypatch.setenv('WATCHDOG_USEC', '100000')

    words = []

    def listen():
        with suppress(BlockingIOError):
            words.append(listener.recv(99))
        if b'WATCHDOG=1' in words:
            os.kill(os.getpid(), signal.SIGTERM)

    def make_nodes():
        node = rclpy.create_node('living')
        node.create_timer(0.02, listen)
        return [node]

    assert runtime.run(make_nodes, []) == 0
    with suppress(BlockingIOError):
        while True:
            words.append(listener.recv(99))
    assert (words[0], words[-1]) == (b'READY=1', b'STOPPING=1')
    assert set(words[1:-1]) == {b'WATCHDOG=1'}
