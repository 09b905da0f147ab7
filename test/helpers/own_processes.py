"""Processes that tests start and always end; ROS domains that no other test uses."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import ctypes
import fcntl
import gc
import itertools
import os
from pathlib import Path
import resource
import signal
import subprocess
import sys
import tempfile
from typing import IO

import pytest

SOURCE = Path(__file__).resolve().parents[2]
# the package, the bus `loopback_can`, programs of tests
PLACES = (SOURCE, SOURCE / 'test' / 'helpers', SOURCE / 'test' / 'processes')
DOMAINS = range(1, 100)
STOP_DEADLINE = 10.0
_DROP_CAPABILITY = 24  # PR_CAPBSET_DROP of prctl
_SYS_NICE = 23  # CAP_SYS_NICE
_next_domain = itertools.count(os.getpid())
_left: list[IO[str]] = []  # locks of left domains that uncollected nodes may still use


@contextmanager
def free_domain() -> Iterator[int]:
    """
    Return a ROS domain that no other test on this machine uses.

    The domain is released when the next domain is requested: a managed node, whose object is part
    of a cycle, offers its services to the whole domain until it is collected.
    """
    gc.collect()
    while _left:
        _left.pop().close()
    for number in itertools.islice(_next_domain, len(DOMAINS)):
        domain = DOMAINS[number % len(DOMAINS)]
        lock = open(
            Path(tempfile.gettempdir()) / f'ros_domain_{domain}_{os.getuid()}.lock', 'w'
        )
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except OSError:
            lock.close()
    else:
        pytest.fail('no free ROS domain')
    try:
        yield domain
    finally:
        _left.append(lock)


class Processes:
    """Processes, each with its process group and a log in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._started: list[subprocess.Popen] = []

    def start(self, module: str, *args: str, **popen) -> subprocess.Popen:
        """
        Start ``python -m MODULE ARGS…``; its `log` is the path of its output.

        It gets no real-time priority, so that a test does not depend on the account and does not
        delay the tests beside it.
        """
        environment = {**os.environ, 'PYTHONUNBUFFERED': '1', **popen.pop('env', {})}
        places = [str(place) for place in PLACES]
        if inherited := environment.get('PYTHONPATH'):
            places.append(inherited)
        environment['PYTHONPATH'] = os.pathsep.join(places)
        log = self._folder / f'{module}_{len(self._started)}.log'
        with open(log, 'w') as output:
            details = {
                'stdout': output,
                'stderr': output,
                'preexec_fn': forbid_priority,
                'env': environment,
                'cwd': self._folder,
                'start_new_session': True,
            }
            command = [sys.executable, '-m', module, *args]
            process = subprocess.Popen(command, **(details | popen))
        process.log = log
        self._started.append(process)
        return process

    def end(self) -> None:
        """End all processes, commanding processes first, and print their output."""
        for process in reversed(self._started):
            end_process(process)
        for process in self._started:
            print(f'--- {process.args}\n{process.log.read_text()}')


def forbid_priority() -> None:
    """
    Forbid real-time priority to this process and to all that it starts.

    It is the `preexec_fn` of processes: root keeps its permission until it executes a program.
    """
    # without effect if not root
    ctypes.CDLL(None).prctl(_DROP_CAPABILITY, _SYS_NICE, 0, 0, 0)
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))


def end_process(process: subprocess.Popen) -> int:
    """End a process group as an operator does, and by force after a deadline."""
    for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        if process.poll() is None:
            os.killpg(process.pid, sign)
        with suppress(subprocess.TimeoutExpired):
            return process.wait(STOP_DEADLINE)
    return process.wait()
