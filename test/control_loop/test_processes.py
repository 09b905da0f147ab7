"""Loop and node as processes: the signals, the modules and the end of the loop."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
import os
import signal
import subprocess
import sys
import time

from loop_bench import loop_setup, PATIENCE
import pytest
from support import wait_until

from facade_manipulator.control_loop import process as process_module
from facade_manipulator.control_loop.process import FEED_PERIOD, LoopClient, start_process
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.resources import import_path, PACKAGE

pytestmark = pytest.mark.realtime

# a process whose loop cannot end in order
HANGING = """
import sys, threading
from facade_manipulator.control_loop import __main__ as main
main.END_TIMEOUT = 1
main.ControlLoop.close = lambda loop: threading.Event().wait()
sys.exit(main.main(int(sys.argv[1])))
"""


def start_hanging(end):
    number = end.fileno()
    return subprocess.Popen([sys.executable, '-c', HANGING, str(number)], pass_fds=(number,))


@pytest.fixture
def start_loop():
    """Start loops in separate processes; return the node's side of each."""
    clients = []

    def start(launch=start_process, **changes):
        clients.append(LoopClient(replace(loop_setup(), **changes), lambda *_: None, launch))
        return clients[-1]

    yield start
    for client in clients:
        with suppress(ManipulatorError):  # a test may have killed its loop
            client.close()


def finished(client, name):
    """Return a request once it is answered."""
    job = client.request(name)

    def feed():
        client.feed()
        time.sleep(FEED_PERIOD)

    wait_until(job.done, name, step=feed)
    return job


def request(client, *names):
    """Ask for one thing after another; return the last answer."""
    return [finished(client, name).result() for name in names][-1]


def test_contradictory_setup_is_rejected(start_loop):
    with pytest.raises(ParameterError, match='two axes have the same node_id'):
        start_loop(axes=(DEFAULT_AXES[0], *DEFAULT_AXES[:2]))


def test_sigterm_to_the_loop_ends_it_in_order(start_loop):
    client = start_loop()
    request(client, 'configure', 'home', 'activate')
    for number in (signal.SIGINT, signal.SIGHUP):  # a terminal's signals concern only the node
        os.kill(client._process.pid, number)
    assert 'self_test is not possible' in str(finished(client, 'self_test').exception())
    os.kill(client._process.pid, signal.SIGTERM)
    assert client._process.wait(PATIENCE) == 0


def test_loop_that_hangs_is_killed_and_reported(start_loop, monkeypatch):
    monkeypatch.setattr(process_module, 'MAX_UNANSWERED', 75)
    client = start_loop()
    request(client, 'configure')
    os.kill(client._process.pid, signal.SIGSTOP)
    wait_until(lambda: client.feed() or time.sleep(FEED_PERIOD) or client.is_lost, 'the loss')
    assert client.snapshot().state is ControllerState.LOST
    assert 'has sent no state while it was fed' in client.snapshot().cause
    assert client._process.returncode == -signal.SIGKILL  # collected, so that no zombie stays


def test_loop_that_cannot_end_is_ended_by_the_kernel(start_loop):
    client = start_loop(start_hanging)
    request(client, 'configure')
    client._channel._socket.shutdown(2)
    assert client._process.wait(PATIENCE) == -signal.SIGALRM


def test_modules_of_the_working_directory_stay_out(start_loop, monkeypatch, tmp_path):
    for name in ('can', 'numpy', 'queue', 'sitecustomize'):
        (tmp_path / f'{name}.py').write_text('import os; os._exit(77)')
    monkeypatch.chdir(tmp_path)
    for entry in ('', str(tmp_path)):  # of python -c, of python -m and PYTHONPATH
        monkeypatch.syspath_prepend(entry)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    assert 'are configured' in request(start_loop(), 'configure')


def test_import_path_has_the_package_but_not_the_directory(monkeypatch, tmp_path):
    monkeypatch.chdir(PACKAGE.parent)
    monkeypatch.setattr(sys, 'path', ['', str(PACKAGE.parent), '/elsewhere'])
    assert import_path() == ['/elsewhere', str(PACKAGE.parent)]


def test_no_ros_is_imported_by_the_loop():
    found = subprocess.run(
        [sys.executable, '-c', 'import facade_manipulator.control_loop.__main__, sys; '
         'print([name for name in sys.modules'
         ' if name.startswith(("rclpy", "rcl_", "rosidl", "rpyutils"))'
         ' or name.endswith(("_msgs", "_srvs"))])'],
        capture_output=True, text=True, check=True)
    assert found.stdout.strip() == '[]'
