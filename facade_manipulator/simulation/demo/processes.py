"""Nodes as separate processes: each with a log, all ended together, none left behind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import ctypes
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.nodes.run import STOP_SIGNALS

PATIENCE = {signal.SIGINT: 5.0, signal.SIGTERM: 3.0, signal.SIGKILL: 3.0}  # s
POLL_PERIOD = 0.02  # s
PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


class NodeProcesses:
    """
    Start node executables and end them again.

    Each has its own session, so that Ctrl-C in the terminal reaches only this process and the
    drives can be stopped first. The kernel ends the nodes if this process is killed. The folder
    gets the log of each.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._processes: dict[Path, subprocess.Popen[bytes]] = {}

    def start(self, name: str, arguments: list[str]) -> None:
        """Start a node by the name of its executable, as users do."""
        path = self._folder / f'{name}.log'
        folder = 'simulation' if name == 'gondola_simulator' else 'nodes'
        with signals_deferred(), path.open('w') as log:
            self._processes[path] = subprocess.Popen(
                [sys.executable, '-P', '-m', f'facade_manipulator.{folder}.{name}', *arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                start_new_session=True, env={**os.environ, 'PYTHONUNBUFFERED': '1'},
                preexec_fn=lambda: _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM))

    def check(self) -> None:
        """Raise a ManipulatorError with the last line of the log of a node that has ended."""
        for log, process in self._processes.items():
            if process.poll() is not None:
                lines = log.read_text('utf-8', 'replace').strip().splitlines() or ['no output']
                raise ManipulatorError(f'{log.stem} ended with exit status {process.returncode}: '
                                       f'{lines[-1]} (see {log})')

    def end(self) -> None:
        """End all nodes at once; kill those that do not end by themselves."""
        for sign, patience in PATIENCE.items():
            deadline = time.monotonic() + patience
            for process in self._running():
                os.killpg(process.pid, sign)
            while self._running() and time.monotonic() < deadline:
                time.sleep(POLL_PERIOD)

    def _running(self) -> list[subprocess.Popen[bytes]]:
        return [process for process in self._processes.values() if process.poll() is None]


@contextmanager
def signals_deferred() -> Iterator[None]:
    """
    Let a stop signal wait for the end of a block.

    Python ignores an exception raised in its callbacks of a fork, and a node started but not yet
    in the table would be left behind.
    """
    received: list[int] = []
    before = [signal.signal(number, lambda number, _: received.append(number))
              for number in STOP_SIGNALS]
    try:
        yield
    finally:
        for number, handler in zip(STOP_SIGNALS, before, strict=True):
            signal.signal(number, handler)
    if received:
        signal.raise_signal(received[0])
