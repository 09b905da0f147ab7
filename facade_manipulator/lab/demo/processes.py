"""Nodes as processes of their own: started with a log each, ended in order, none left behind."""

from __future__ import annotations

from contextlib import suppress
import ctypes
import os
from pathlib import Path
import signal
import subprocess
import sys

from facade_manipulator.errors import ManipulatorError

PATIENCE = (
    (signal.SIGINT, 5.0),
    (signal.SIGTERM, 3.0),
    (signal.SIGKILL, 3.0),
)
PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


class NodeEndedError(ManipulatorError):
    """A node's process ended by itself."""


class NodeProcesses:
    """
    Start node executables and end them again, in the reverse order of their start.

    Each is a session of its own, so that a Ctrl-C in the terminal reaches this process alone and
    the drives can be stopped first; the kernel ends them if this process is killed. The directory
    of logs gets one file per node.
    """

    def __init__(self, log_directory: Path) -> None:
        self._log_directory = log_directory
        self._processes: dict[str, subprocess.Popen] = {}

    def start(self, name: str, arguments: list[str]) -> None:
        """Start ``facade_manipulator.nodes.NAME`` with arguments."""
        command = [sys.executable, '-m', f'facade_manipulator.nodes.{name}', *arguments]
        with open(self.log(name), 'w') as log:
            self._processes[name] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                start_new_session=True, preexec_fn=_die_with_parent,
                env={**os.environ, 'PYTHONUNBUFFERED': '1'})

    def log(self, name: str) -> Path:
        """Return the path of a node's log."""
        return self._log_directory / f'{name}.log'

    def check(self) -> None:
        """Raise a NodeEndedError with the last line of the log of a node that has ended."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                lines = self.log(name).read_text().strip().splitlines() or ['no output']
                raise NodeEndedError(
                    f'{name} ended with exit status {process.returncode}: {lines[-1]} '
                    f'(see {self.log(name)})')

    def end(self) -> None:
        """End every node, the last started first; by force what does not end by itself."""
        for process in reversed(self._processes.values()):
            _end(process)
        self._processes.clear()


def _end(process: subprocess.Popen) -> None:
    for sign, patience in PATIENCE:
        if process.poll() is None:
            os.killpg(process.pid, sign)
        with suppress(subprocess.TimeoutExpired):
            process.wait(patience)
            return


def _die_with_parent() -> None:
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
