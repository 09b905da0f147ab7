"""How a node's process ends."""

import os
import signal
import subprocess
import sys
from threading import Timer
import time
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from support import patiently

from facade_manipulator import start
from facade_manipulator.ros import runtime
from facade_manipulator.ros.lifecycle import ManagedNode

pytestmark = pytest.mark.realtime

DEADLINE = 10.0


@pytest.fixture(params=['chosen', 'fall-back'], autouse=True)
def executor(request, monkeypatch):
    """Run every test in the executor that is chosen here, and in that of last resort."""
    if request.param == 'fall-back':
        monkeypatch.setattr(runtime, 'choose_executor', lambda _: SingleThreadedExecutor())
    return request.param


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_that_comes_before_a_node_is_imported_ends_it_without_a_traceback(number):
    process = subprocess.run([sys.executable, '-c', f"""
import os, sys
sys.meta_path.insert(0, type('', (), {{'find_spec': lambda name, *_: (
    os.kill(os.getpid(), {number}) if name == 'facade_manipulator.nodes.driver' else None)}}))
from facade_manipulator.start import driver
sys.exit(driver())"""], capture_output=True, text=True, timeout=DEADLINE)
    assert (process.returncode, process.stderr) == (0, '')


def test_the_start_of_a_node_leaves_its_signals_to_it(monkeypatch):
    module = SimpleNamespace(main=lambda: signal.getsignal(signal.SIGINT))
    monkeypatch.setattr(start, 'import_module', lambda _: module)
    assert start.driver() is signal.getsignal(signal.SIGINT)


def ending(how, close=int):
    """Return what makes a node that ends its process in a callback."""
    def make_nodes():
        node = rclpy.create_node('ending')
        node.close = close
        node.create_timer(0.01, how)
        return [node]

    return make_nodes


@pytest.mark.quick
@pytest.mark.parametrize('number', runtime.STOP_SIGNALS)
def test_a_node_says_when_it_is_ready_and_a_signal_ends_it_in_order(
        ros_domain, handlers, capfd, number):
    closed = []
    make_nodes = ending(
        lambda: os.kill(os.getpid(), number), lambda: closed.append(rclpy.ok()))
    assert runtime.run(make_nodes, []) == 0
    assert closed == [True]  # once, while ROS still runs
    said = capfd.readouterr().err
    assert '[ending]: ready' in said and 'ended' not in said


@pytest.mark.parametrize('number', runtime.STOP_SIGNALS)
def test_a_signal_ends_a_node_where_nothing_happens(ros_domain, handlers, number):
    timers = [Timer(0.3, os.kill, (os.getpid(), number)), Timer(DEADLINE, rclpy.try_shutdown)]
    for timer in timers:
        timer.start()
    assert runtime.run(lambda: [rclpy.create_node('idle')], []) == 0
    timers[1].cancel()


@pytest.mark.quick
@pytest.mark.parametrize('number', runtime.STOP_SIGNALS)
def test_a_signal_ends_within_a_second_what_still_starts(ros_domain, handlers, number):
    def end_a_start():
        timer = Timer(0.3, os.kill, (os.getpid(), number))
        timer.start()
        begin = time.monotonic()
        assert runtime.run(lambda: time.sleep(DEADLINE), []) == 0
        assert time.monotonic() < begin + 0.3 + 1.0

    patiently(end_a_start)


@pytest.mark.quick
def test_every_node_rejects_simulated_time(ros_domain, handlers, capfd):
    arguments = ['--ros-args', '-p', 'use_sim_time:=true']
    assert runtime.run(lambda: [rclpy.create_node('idle')], arguments) == 2
    assert 'use_sim_time = true is not possible' in capfd.readouterr().err


@pytest.mark.quick
def test_a_shutdown_ends_the_process_with_success(ros_domain, handlers, capfd):
    def make_nodes():
        node = ManagedNode('managed')
        timer = node.create_timer(0.1, lambda: (timer.cancel(), node.trigger_shutdown()))
        return [node]

    assert runtime.run(make_nodes, []) == 0
    assert 'ended' not in capfd.readouterr().err


@pytest.mark.quick
def test_an_error_in_a_callback_ends_the_node_and_is_not_hidden(ros_domain, handlers):
    def fail():
        raise ZeroDivisionError('nobody foresaw this')

    with pytest.raises(ZeroDivisionError, match='nobody foresaw'):
        runtime.run(ending(fail), [])


def test_what_waits_is_taken_once_the_executor_listens(ros_domain, handlers, monkeypatch):
    taken = []
    monkeypatch.setattr(runtime, 'take_what_waits', lambda node: taken.append(
        (node.get_name(), node.executor is not None)))
    assert runtime.run(ending(lambda: os.kill(os.getpid(), signal.SIGINT)), []) == 0
    assert taken == [('ending', True)]


def test_no_event_leaves_anything_on_the_future_that_ends_it(ros, executor):
    end, left = Future(), []

    def look():
        left.append(len(end._callbacks))
        if len(left) > 200:
            end.set_result(None)

    chosen = runtime.choose_executor() if executor == 'chosen' else SingleThreadedExecutor()
    node = rclpy.create_node('busy')
    node.create_timer(0.001, look)
    chosen.add_node(node)
    runtime.spin_until(chosen, end)
    assert max(left) <= 2
    node.destroy_node()


@pytest.mark.quick
def test_no_node_ends_in_silence_when_ros_is_shut_down(ros_domain, handlers, capfd):
    assert runtime.run(ending(rclpy.try_shutdown), []) == 1
    assert 'by no signal' in capfd.readouterr().err


@pytest.mark.parametrize('arguments, status, text', [
    (['--help'], 0, '--params-file'), (['--bogus'], 2, 'unrecognized arguments: --bogus'),
    (['--ros-args', '-p', 'a:=1', '--', 'more'], 2, 'unrecognized arguments: more')])
def test_other_arguments_start_nothing(handlers, capfd, arguments, status, text):
    with pytest.raises(SystemExit) as end:
        runtime.run(pytest.fail, arguments)
    captured = capfd.readouterr()
    assert end.value.code == status and text in captured.out + captured.err
