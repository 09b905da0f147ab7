"""
The executables: each starts here, on a computer as it is.

Modules of the working directory are not imported, and a terminal need not know every character. An
error of the operating system is one sentence, not a traceback. A signal that comes while modules
are still imported ends the process: importing takes a second, and nothing runs yet that must be
closed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
from io import TextIOWrapper
import os
import signal
import sys
from typing import TextIO

from facade_manipulator.errors import INTERRUPTED, os_error
from facade_manipulator.resources import import_path

FAILED = 1
MODULES = {  # of executables; that of a node is in `nodes`
    'calibrate': 'tools.calibration.__main__',
    'commission': 'tools.commissioning.__main__',
    'demo': 'simulation.demo.demo',
    'drive_simulator': 'simulation.drives.__main__',
    'gondola_simulator': 'simulation.gondola_simulator',
    'stopping': 'tools.stopping',
    'workspace_study': 'study.__main__',
}


def __getattr__(name: str) -> Callable[[], int]:
    """Return the function that starts an executable."""
    if name.startswith('_'):
        raise AttributeError(name)
    return partial(_start, name)


def _start(name: str) -> int:
    sys.path[:] = import_path()
    sys.stdout, sys.stderr = map(_writable, (sys.stdout, sys.stderr))
    try:
        try:
            status = _main(name)()
        except SystemExit as end:  # argparse has answered
            status = end.code  # type: ignore[assignment]
        sys.stdout.flush()
    except OSError as error:
        print(f'{name}: {os_error(error)}', file=sys.stderr)
        _drop_output()
        return FAILED
    return status


def _main(name: str) -> Callable[[], int]:
    """Import an executable; return its main function."""
    is_node = name not in MODULES or name.endswith('_simulator')  # ends by a signal as a rule
    numbers = signal.SIGINT, signal.SIGTERM
    before = [signal.signal(number, lambda *_: os._exit(0 if is_node else INTERRUPTED))
              for number in numbers]
    main = import_module(f'facade_manipulator.{MODULES.get(name, f"nodes.{name}")}').main
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
    return main


def _writable(stream: TextIO | None) -> TextIO:
    """Return a stream that takes every character; nothing is shown where it was closed."""
    if not isinstance(stream, TextIOWrapper):
        return stream or open(os.devnull, 'w')
    stream.reconfigure(errors='backslashreplace')
    return stream


def _drop_output() -> None:
    """Let the interpreter end without a second error about output that cannot be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
