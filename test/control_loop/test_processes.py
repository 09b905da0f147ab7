"""Loop and node as processes: signals, a terminal, an interpreter that is held up."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
import ctypes
from dataclasses import replace
import os
import signal
import subprocess
import sys

from loop_bench import CONTROLLER, loop_setup, LoopThread, PATIENCE
import pytest

from facade_manipulator.control_loop import process as process_module
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.resources import import_path, PACKAGE

pytestmark = pytest.mark.realtime

# a loop in a process of its own, in which something is otherwise
TALKING = """
import sys
from facade_manipulator.control_loop import __main__ as main
main.END_TIMEOUT = 5
"""
HANGING = TALKING + """
import threading
main.END_TIMEOUT = 1
main.ControlLoop.close = lambda loop: threading.Event().wait()
"""


def start(end, source, **details):
    """Start the loop with a changed source in a process of its own."""
    number = end.fileno()
    return subprocess.Popen(
        [sys.executable, '-c', source + 'sys.exit(main.main(int(sys.argv[1])))', str(number)],
        pass_fds=(number,), stdin=subprocess.DEVNULL, **details)


def test_a_loop_that_cannot_end_in_order_is_ended_by_the_kernel(make_bench):
    bench = make_bench(launch=lambda end: start(end, HANGING))
    bench.do('configure')
    bench.process._channel._socket.shutdown(2)
    assert bench.process._process.wait(PATIENCE) == -signal.SIGALRM


def test_modules_of_the_working_directory_stay_out_of_the_loop(
        make_bench, monkeypatch, tmp_path):
    for name in ('can', 'numpy', 'queue', 'sitecustomize'):
        (tmp_path / f'{name}.py').write_text('import os; os._exit(77)')
    monkeypatch.chdir(tmp_path)
    for entry in ('', str(tmp_path)):  # of python -c, of python -m and PYTHONPATH
        monkeypatch.syspath_prepend(entry)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    assert 'are configured' in make_bench().do('configure')


def test_import_path_keeps_the_package_where_it_is_the_working_directory(monkeypatch):
    monkeypatch.chdir(PACKAGE.parent)
    monkeypatch.setattr(sys, 'path', ['', str(PACKAGE.parent), '/elsewhere'])
    assert import_path() == ['/elsewhere', str(PACKAGE.parent)]


def test_import_path_is_known_in_a_directory_that_was_removed(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    tmp_path.rmdir()
    monkeypatch.setattr(sys, 'path', ['', '/elsewhere'])
    assert import_path() == ['/elsewhere']


def test_a_terminal_that_takes_no_more_output_holds_nothing_up(make_bench):
    """As after Ctrl-S, which holds up the node, too."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    setup = loop_setup(replace(CONTROLLER, watchdog_timeout=0.3))
    bench = make_bench(setup, launch=lambda end: start(end, TALKING, stderr=writer))
    bench.do('configure', 'home', 'activate')
    bench.feeds.clear()
    bench.until(ControllerState.CLOSED, ControllerState.LOST)
    os.close(reader)
    os.close(writer)


def test_a_hundred_requests_at_once_are_all_answered(make_bench):
    bench = make_bench(launch=LoopThread)
    with ThreadPoolExecutor(20) as threads:
        jobs = [job.result() for job in [
            threads.submit(bench.process.request, 'self_test') for _ in range(100)]]
    rejected = [str(job.exception(PATIENCE)) for job in jobs if job.exception(PATIENCE)]
    assert 0 < len(rejected) < len(jobs)
    assert all('self_test is not possible while self_test is under way' in one for one in rejected)


def test_a_loop_that_hangs_is_ended_and_said_to_have_hung(make_bench, monkeypatch):
    monkeypatch.setattr(process_module, 'MAX_UNANSWERED', 75)
    bench = make_bench()
    bench.do('configure')
    os.kill(bench.process._process.pid, signal.SIGSTOP)
    bench.until(ControllerState.LOST)
    assert 'has sent no state while it was fed' in bench.process.snapshot().cause
    assert bench.process._process.returncode == -signal.SIGKILL  # collected: it is no zombie


def test_a_node_that_stood_still_does_not_blame_the_loop(make_bench, monkeypatch):
    monkeypatch.setattr(process_module, 'MAX_UNANSWERED', 20)
    bench = make_bench()
    bench.do('configure')
    bench.feeds.clear()
    ctypes.PyDLL(None).usleep(1_000_000)
    bench.feeds.set()
    assert 'homed' in bench.do('home')


def test_sigterm_to_the_loop_alone_ends_it_in_order(make_bench):
    bench = make_bench()
    bench.move()
    os.kill(bench.process._process.pid, signal.SIGTERM)
    assert bench.process._process.wait(PATIENCE) == 0


def test_the_signals_of_a_terminal_are_the_nodes_matter_and_it_says_how_it_is_scheduled(
        make_bench, capfd):
    bench = make_bench()
    bench.do('configure')
    assert capfd.readouterr().err.count('[control loop]: the control loop runs with') == 1
    for number in (signal.SIGINT, signal.SIGHUP):
        os.kill(bench.process._process.pid, number)
    assert 'homed' in bench.do('home')


def test_no_ros_is_imported_by_the_loop():
    found = subprocess.run(
        [sys.executable, '-c', 'import facade_manipulator.control_loop.__main__, sys; '
         'print([name for name in sys.modules'
         ' if name.startswith(("rclpy", "rcl_", "rosidl", "rpyutils"))'
         ' or name.endswith(("_msgs", "_srvs"))])'],
        capture_output=True, text=True, check=True)
    assert found.stdout.strip() == '[]'
