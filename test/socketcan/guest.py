"""
Run a command in user-mode Linux, whose kernel has CAN whatever the host's has.

`run_in_guest` boots a guest on the host's own file system (no root, nothing installed, processor
time of one CPU), brings up vcan0 in it, streams the command's output and returns its exit status.
A guest that panics, dies or falls silent is an error of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
import json
import math
import os
from pathlib import Path
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time

import fetch

HERE = Path(__file__).resolve().parent
CACHE = HERE.parents[1] / '.venv' / 'uml'
MEMORY = 1 << 30
START = 60.0  # for the first word of its first process
POLL_PERIOD = 0.2
# Faster than to trace the guest's processes. They could break out of it: they may, being ours.
WAYS = (('seccomp=on',), ())
# The kernel and the processes that carry the guest's own are one group; when our end of its
# standard input closes, because we ended in whatever way, the group is killed.
LAUNCH = 'exec 3<&0; (read -r _ <&3; kill -KILL 0) & exec "$@" </dev/null 3<&-'
CONSOLE_LINES = 40


class GuestError(Exception):
    """The guest panicked, died or fell silent; the message ends with its console."""


class GuestUnavailableError(Exception):
    """User-mode Linux cannot be had, or does not start, on this machine."""


@dataclass
class SerialLine:
    """Where the guest writes to, and when it last did on the monotonic clock [s]."""

    descriptor: int
    heard: float = field(default_factory=time.monotonic)


def run_in_guest(
    command: list[str], silence: float = math.inf,
) -> tuple[str, int]:
    """
    Boot a guest and run a command in it; return the kernel's version and the exit status.

    Parameters
    ----------
    command : list of str
    silence : float
        How long the guest may say nothing [s].

    Raises
    ------
    GuestUnavailableError
        There is no kernel for the guest, or no place for its memory, or its first process never
        said a word.
    GuestError
        It started and then did not run the command to its end.

    """
    root = _fetch_kernel()
    for options in WAYS[:-1]:
        with suppress(GuestUnavailableError):
            return _boot(root, options, command, silence)
    return _boot(root, WAYS[-1], command, silence)


def _boot(
    root: Path, options: tuple[str, ...], command: list[str], silence: float
) -> tuple[str, int]:
    """Do so with further options of the kernel's."""
    with _work_folder() as folder, _serial_line() as line:
        _write_order(folder, root, command)
        started = _start(folder, root, options, line.descriptor)
        try:
            why = _watch(started, folder, line, silence)
        finally:
            _kill(started)
        return _outcome(folder, why or f'died (exit status {started.returncode})')


def _watch(
    process: subprocess.Popen, folder: Path, line: SerialLine, silence: float
) -> str | None:
    """Wait for the guest's end; return why it must be stopped, None where it ended."""
    begin = time.monotonic()
    while True:
        with suppress(subprocess.TimeoutExpired):
            process.wait(POLL_PERIOD)
            return None
        now = time.monotonic()
        if now > line.heard + silence:
            return f'has said nothing for {silence:g} s'
        if now > begin + START and not _is_alive(folder):
            return f'has not begun after {START:g} s'


def _fetch_kernel() -> Path:
    try:
        return fetch.fetch(CACHE)
    except (fetch.FetchError, OSError, subprocess.TimeoutExpired) as error:
        raise GuestUnavailableError(str(error)) from error


@contextmanager
def _work_folder() -> Iterator[Path]:
    """Give a folder that the guest sees as well: its /dev, /proc and /sys are its own."""
    try:
        folder = Path(tempfile.mkdtemp(prefix='guest_', dir=CACHE))
    except OSError as error:
        raise GuestUnavailableError(f'no folder for the guest: {error}') from error
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _memory_place() -> str:
    """Choose where the guest's memory is a file: in RAM where possible, never mounted noexec."""
    for place in ('/dev/shm', '/tmp', str(CACHE)):
        if os.access(place, os.W_OK):
            state = os.statvfs(place)
            room = state.f_bavail * state.f_frsize
            if not state.f_flag & os.ST_NOEXEC and room > MEMORY:
                return place
    raise GuestUnavailableError(f"no folder takes the {MEMORY >> 20} MB of the guest's memory")


def _write_order(folder: Path, root: Path, command: list[str]) -> None:
    """Leave for guest_init.py what to run, and for the kernel a program with no arguments."""
    modules = {path.stem: str(path) for path in root.glob('usr/lib/**/*.ko')}
    order = {'command': command, 'directory': os.getcwd(), 'modules': modules,
             'environment': _environment(root)}
    (folder / 'command.json').write_text(json.dumps(order))
    python = (sys.executable, '-I', '-S', '-c',
              f'import sys; sys.path.insert(0, {str(HERE)!r}); import guest_init; '
              'guest_init.main()', str(folder))
    (folder / 'init').write_text(f'#!/bin/sh\nexec {shlex.join(python)}\n')
    (folder / 'init').chmod(0o755)


def _environment(root: Path) -> dict[str, str]:
    """Return the host's environment with what is different in the guest."""
    size = shutil.get_terminal_size()
    return {**os.environ, 'HOME': '/dev/tmp', 'TMPDIR': '/dev/tmp', 'ROS_LOG_DIR': '/dev/tmp/ros',
            'PATH': f'{os.environ["PATH"]}:{root}/usr/bin:/usr/sbin:/sbin',
            'TERM': os.environ.get('TERM', 'dumb') if sys.stdout.isatty() else 'dumb',
            'COLUMNS': str(size.columns), 'LINES': str(size.lines)}


def _start(
    folder: Path, root: Path, options: tuple[str, ...], line: int
) -> subprocess.Popen:
    """Start the guest's kernel."""
    kernel = next(root.glob('usr/bin/linux*'), None)
    if kernel is None:
        raise GuestUnavailableError('there is no kernel in the package user-mode-linux')
    console = os.open(folder / 'console', os.O_WRONLY | os.O_CREAT)
    options += ('rootfstype=hostfs', 'rootflags=/', 'rw', 'devtmpfs.mount=0',
               f'init="{folder}/init"', 'panic=-1',
               f'mem={MEMORY >> 20}M', f'umid={folder.name}', 'con=null',
               f'con0=null,fd:{console}', 'ssl=null', f'ssl0=null,fd:{line}')
    process = subprocess.Popen(
        ['taskset', '--cpu-list', str(max(os.sched_getaffinity(0))),
         'sh', '-c', LAUNCH, 'sh', kernel, *options],
        env={'TMPDIR': _memory_place(), 'HOME': str(folder), 'PATH': os.defpath},
        stdin=subprocess.PIPE, stdout=console, stderr=console, pass_fds=(console, line),
        start_new_session=True)
    os.close(console)
    return process


@contextmanager
def _serial_line() -> Iterator[SerialLine]:
    """Give a line whose output goes to our standard output, to its end."""
    read_end, write_end = os.pipe()
    line = SerialLine(write_end)
    copier = threading.Thread(target=_copy, args=(read_end, line))
    copier.start()
    try:
        yield line
    finally:
        os.close(write_end)
        copier.join()


def _copy(descriptor: int, line: SerialLine) -> None:
    with open(descriptor, 'rb', buffering=0) as read_end:
        while data := read_end.read(4096):
            line.heard = time.monotonic()
            sys.stdout.buffer.write(data)
            sys.stdout.flush()


def _kill(process: subprocess.Popen) -> None:
    """Kill what is left of the guest: its kernel and the processes that carry its own."""
    os.killpg(process.pid, signal.SIGKILL)  # the shell that waits for our end is there at least
    process.wait()
    process.stdin.close()


def _is_alive(folder: Path) -> bool:
    """Tell whether the guest's first process has said a word."""
    return (folder / 'alive').exists()


def _outcome(folder: Path, why: str) -> tuple[str, int]:
    """Return the kernel's version and the exit status of the command."""
    console, status, error = ((folder / name) for name in ('console', 'status', 'error'))
    if status.exists():
        version = re.search(r'Linux version (\S+)', console.read_text(errors='replace'))
        return version[1] if version else 'of no known version', int(status.read_text())
    if error.exists():
        raise GuestError(f'the guest did not run the command: {error.read_text()}')
    if _is_alive(folder):
        raise GuestError(f'the guest {why}\n{_console(folder)}')
    raise GuestUnavailableError(
        f'user-mode Linux does not start here: the guest {why}\n{_console(folder)}')


def _console(folder: Path) -> str:
    lines = (folder / 'console').read_text(errors='replace').splitlines()
    return '\n'.join(['the last lines of its console:', *lines[-CONSOLE_LINES:]])
