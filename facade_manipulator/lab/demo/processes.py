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

PATIENCE = {signal.SIGINT: 5.0, signal.SIGTERM: 3.0, signal.SIGKILL: 3.0}  # s
START = 'from facade_manipulator import start; raise SystemExit(start.{}())'
PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


class NodeProcesses:
    """
    Start node executables and end them again, in the reverse order of their start.

    Each is a session of its own, so that a Ctrl-C in the terminal reaches this process alone and
    the drives can be stopped first; the kernel ends them if this process is killed. The folder
    gets a log of each.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._processes: dict[Path, subprocess.Popen[bytes]] = {}

    def start(self, name: str, arguments: list[str]) -> None:
        """Start a node by the name of its executable, as users do."""
        path = self._folder / f'{name}.log'
        with path.open('w') as log:
            self._processes[path] = subprocess.Popen(
                [sys.executable, '-c', START.format(name), *arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                start_new_session=True, env={**os.environ, 'PYTHONUNBUFFERED': '1'},
                preexec_fn=lambda: _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM))

    def check(self) -> None:
        """Raise a ManipulatorError with the last line of the log of a node that has ended."""
        for log, process in self._processes.items():
            if process.poll() is not None:
                lines = log.read_text().strip().splitlines() or ['no output']
                raise ManipulatorError(f'{log.stem} ended with exit status {process.returncode}: '
                                       f'{lines[-1]} (see {log})')

    def end(self) -> None:
        """End every node, the last started first; by force what does not end by itself."""
        for process in reversed(self._processes.values()):
            for sign, patience in PATIENCE.items():
                if process.poll() is None:
                    os.killpg(process.pid, sign)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(patience)
                    break
