"""Processes of one measurement: started together, their CPU read, ended by number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import ctypes
import json
import os
from pathlib import Path
import select
import signal
from statistics import quantiles
import subprocess
import sys
import tempfile
import time
from typing import IO, NamedTuple

from own_processes import free_domain
from rounds import HERE, SOURCE

END_WITHIN = 5.0
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
        self._domain = free_domain()
        self._environment = {
            **os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'PYTHONPATH': str(SOURCE)}
        self.running: dict[str, subprocess.Popen] = {}
        self._logs: dict[str, IO[str]] = {}

    def __enter__(self) -> Processes:
        self._environment['ROS_DOMAIN_ID'] = str(self._domain.__enter__())
        return self

    def __exit__(self, *_) -> None:
        for key, process in self.running.items():
            if process.poll() is not None:
                print(f'  {key} ended by itself, exit status {process.returncode}: '
                      f'{self.last_line(key)}')
        for process in self.running.values():
            process.send_signal(signal.SIGINT)
        for process in self.running.values():
            try:
                process.wait(END_WITHIN)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for log in self._logs.values():
            log.close()
        self._domain.__exit__(None, None, None)

    def last_line(self, key: str) -> str:
        """Return the last that a process said."""
        self._logs[key].seek(0)
        lines = self._logs[key].read().strip().splitlines() or ['no word of it']
        return lines[-1]

    def node(self, name: str, *parameters: str) -> subprocess.Popen:
        """Start a node of the package."""
        ros = [word for one in parameters for word in ('-p', one)]
        return self._start(name, [
            '-m', f'facade_manipulator.nodes.{name}', '--ros-args',
            '-r', NAMESPACE, *ros])

    def role(self, name: str, kind: str, rate: float) -> subprocess.Popen:
        """Start a role of ros_roles."""
        return self._start(name, [
            str(HERE / 'ros_roles.py'), name, kind, str(rate), '--ros-args',
            '-r', NAMESPACE])

    def script(self, name: str, *arguments: str) -> subprocess.Popen:
        """Start another script of the bench."""
        return self._start(name, [str(HERE / f'{name}.py'), *arguments])

    def _start(self, key: str, arguments: list[str]) -> subprocess.Popen:
        self._logs[key] = tempfile.TemporaryFile('w+')
        self.running[key] = subprocess.Popen(
            [sys.executable, *arguments], env=self._environment, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=self._logs[key], text=True)
        return self.running[key]

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
