"""Processes of one measurement: started together, their CPU read, ended by number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
import ctypes
import json
from pathlib import Path
import select
import signal
from statistics import quantiles
import subprocess
from tempfile import TemporaryDirectory
import time
from typing import NamedTuple

import own_processes
from own_processes import end_process, free_domain
from rounds import HERE

READY_WITHIN = 20.0
NAMESPACE = '__ns:=/bench'
_libc = ctypes.CDLL(None)


class Load(NamedTuple):
    """What a layout cost: latency [s] at the median and the 99th percentile, CPU share."""

    p50: float
    p99: float
    cpu: float


class Processes:
    """Context of processes in a ROS domain of their own."""

    def __init__(self) -> None:
        self.running: dict[str, subprocess.Popen] = {}
        self._stack = ExitStack()

    def __enter__(self) -> Processes:
        domain = self._stack.enter_context(free_domain())
        self._own = own_processes.Processes(Path(self._stack.enter_context(TemporaryDirectory())))
        self._environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
                             'ROS_DOMAIN_ID': str(domain), 'PYTHONPATH': str(HERE)}
        return self

    def __exit__(self, *_) -> None:
        for key, process in self.running.items():
            if process.poll() is not None:
                print(f'  {key} ended by itself, exit status {process.returncode}: '
                      f'{self.last_line(key)}')
        for process in self.running.values():
            process.send_signal(signal.SIGINT)
        for process in self.running.values():
            end_process(process)
        self._stack.close()

    def last_line(self, key: str) -> str:
        """Return the last that a process said."""
        return (self.running[key].log.read_text().strip().splitlines() or ['no word of it'])[-1]

    def node(self, name: str, *parameters: str) -> None:
        """Start a node of the package."""
        ros = [word for one in parameters for word in ('-p', one)]
        self._start(name, f'facade_manipulator.nodes.{name}', '--ros-args', '-r', NAMESPACE, *ros)

    def role(self, name: str, kind: str, rate: float) -> None:
        """Start a role of ros_roles."""
        self._start(name, 'ros_roles', name, kind, str(rate), '--ros-args', '-r', NAMESPACE)

    def script(self, name: str, *arguments: str) -> None:
        """Start another script of the bench."""
        self._start(name, name, *arguments)

    def _start(self, key: str, module: str, *arguments: str) -> None:
        self.running[key] = self._own.start(
            module, *arguments, env=self._environment, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True)

    def measure(self, counted: list[str], listener: str, warm_up: float, duration: float) -> Load:
        """Return latencies at the listener and the CPU of some processes over a time."""
        ear = self.running[listener]
        until(lambda: listen(ear, 0.2))
        time.sleep(warm_up)
        before, begin = self.cpu(counted), time.monotonic()
        latencies = listen(ear, duration)
        cpu = (self.cpu(counted) - before) / (time.monotonic() - begin)
        return load(latencies, cpu)

    def cpu(self, names: Sequence[str]) -> float:
        """Return the processor time that processes have used [s]."""
        return sum(cpu_of(self.running[name].pid) for name in names)

    def memory(self) -> float:
        """Return what all processes have of their own in memory [MiB]."""
        return sum(int(line.split()[1]) for process in self.running.values()
                   for line in Path(f'/proc/{process.pid}/smaps_rollup').read_text().splitlines()
                   if line.startswith('Private')) / 1024.0


def load(latencies: list[float], cpu: float) -> Load:
    """Return what latencies [s] and a CPU share amount to."""
    if len(latencies) < 2:
        raise RuntimeError(f'{len(latencies)} messages were heard')
    cuts = quantiles(latencies, n=100)
    return Load(cuts[49], cuts[98], cpu)


def until(heard: Callable[[], bool]) -> None:
    """Wait for the first messages, not for ever."""
    deadline = time.monotonic() + READY_WITHIN
    while not heard() and time.monotonic() < deadline:
        continue


def listen(ear: subprocess.Popen, duration: float) -> list:
    """Return what a process tells of a time: of a listener the latencies [s]."""
    say(ear, 'begin')
    time.sleep(duration)
    say(ear, 'end')
    if not select.select([ear.stdout], [], [], READY_WITHIN)[0]:
        raise ChildProcessError(f'the process that listens said nothing for {READY_WITHIN} s')
    line = ear.stdout.readline()
    if not line:
        raise ChildProcessError('the process that listens has ended')
    return json.loads(line)


def say(process: subprocess.Popen, word: str) -> None:
    """Send a line to a process."""
    process.stdin.write(word + '\n')
    process.stdin.flush()


def cpu_of(pid: int) -> float:
    """Return the processor time of a process, all threads, to the microsecond [s]."""
    clock = ctypes.c_int()
    if _libc.clock_getcpuclockid(pid, ctypes.byref(clock)) != 0:
        raise ProcessLookupError(f'there is no process {pid}')
    return time.clock_gettime(clock.value)
