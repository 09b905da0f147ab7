"""Loop and node as processes: the signals, the modules and the end of the loop."""

from contextlib import suppress
from dataclasses import replace
import os
import signal
import subprocess
import sys
import time

from control_loop.loop_rig import ask, loop_arguments, SETUP
import pytest
from support import DEADLINE, wait_until

from facade_manipulator.control_loop.loop_client import (
    FEED_PERIOD,
    LoopClient,
    start_process,
)
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.errors import ManipulatorError, ParameterError

pytestmark = pytest.mark.realtime

# a process of which a method of the loop hangs
HANGING = """
import sys, threading
from facade_manipulator.control_loop import control_loop
control_loop.END_TIMEOUT = control_loop.HANG_TIMEOUT = 1.0
control_loop.ControlLoop.%s = lambda loop: threading.Event().wait()
sys.exit(control_loop.main(*map(int, sys.argv[1:])))
"""


class StartedLoop(LoopClient):
    """Client of a loop in a separate process, which a test may kill."""

    def __init__(self, launch, **changes):
        self._start = launch
        super().__init__(replace(SETUP, **changes), lambda *_: None, self._start_loop)

    def _start_loop(self, *ends):
        self.process = self._start(*ends)
        return self.process


@pytest.fixture
def start_loop():
    """Return a function that starts loops in separate processes."""
    clients = []

    def start(launch=start_process, **changes):
        clients.append(StartedLoop(launch, **changes))
        return clients[-1]

    yield start
    for client in clients:
        with suppress(ManipulatorError):  # a test may have killed its loop
            client.close()


def request(client, *names):
    """Request one transition after another; return the last answer."""

    def feed():
        client.feed()
        time.sleep(FEED_PERIOD)

    for name in names:
        job = ask(client, name)
        wait_until(job.done, name, step=feed)
    return job.result()


def test_contradictory_setup_is_rejected(start_loop):
    with pytest.raises(ParameterError, match='two axes have the same node_id'):
        start_loop(axes=(DEFAULT_AXES[0], *DEFAULT_AXES[:2]))


def test_sigterm_ends_the_loop_cleanly(start_loop):
    client = start_loop()
    request(client, 'configure', 'home', 'activate')
    # a terminal's signals concern only the node
    os.kill(client.process.pid, signal.SIGINT)
    os.kill(client.process.pid, signal.SIGHUP)
    with pytest.raises(ManipulatorError, match='cleanup is not possible'):
        request(client, 'cleanup')
    os.kill(client.process.pid, signal.SIGTERM)
    assert client.process.wait(DEADLINE) == 0


def hanging(method):
    """Return the function that starts a loop of which a method hangs."""

    def start(*ends):
        command = [sys.executable, '-c', HANGING % method, *loop_arguments(ends)]
        return subprocess.Popen(command, pass_fds=[end.fileno() for end in ends])

    return start


def test_loop_that_cannot_end_is_ended_by_the_kernel(start_loop):
    client = start_loop(hanging('close'))
    request(client, 'configure')
    os.kill(client.process.pid, signal.SIGTERM)
    assert client.process.wait(DEADLINE) == -signal.SIGALRM


def test_loop_hanging_in_a_turn_is_ended(start_loop):
    client = start_loop(hanging('_require_node'))
    assert client.process.wait(DEADLINE) == -signal.SIGALRM


def test_modules_of_the_working_directory_are_ignored(
    start_loop, monkeypatch, tmp_path
):
    for name in ('can', 'numpy', 'queue', 'sitecustomize'):
        (tmp_path / f'{name}.py').write_text('import os; os._exit(77)')
    monkeypatch.chdir(tmp_path)
    for entry in ('', str(tmp_path)):  # of python -c, of python -m and PYTHONPATH
        monkeypatch.syspath_prepend(entry)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    assert 'are configured' in request(start_loop(), 'configure')
