"""
Run a command in user-mode Linux, whose kernel has CAN even if the host's kernel has none.

`run_in_guest` boots a guest on the host's own file system, without root, on one CPU. It brings up
vcan0, copies the output of the command and returns its exit status. A guest that panics, dies or
prints nothing for too long raises an error with its console.
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
MEMORY = 1 << 30  # bytes
BOOT_TIMEOUT = 60.0  # s, until the first process of the guest runs
POLL_PERIOD = 0.2  # s
# The kernel and its helper processes are one group. When our end of its standard input closes,
# because this program ended for whatever reason, the group is killed.
LAUNCH = 'exec 3<&0; (read -r _ <&3; kill -KILL 0) & exec "$@" </dev/null 3<&-'
CONSOLE_LINES = 40


class GuestError(Exception):
    """The guest panicked, died or fell silent; the message ends with its console."""


class GuestUnavailableError(Exception):
    """User-mode Linux cannot be fetched, or does not start, on this machine."""


@dataclass
class SerialLine:
    """The descriptor that the guest writes to, and the monotonic time of its last output [s]."""

    descriptor: int
    last_output: float = field(default_factory=time.monotonic)


def run_in_guest(command: list[str], silence: float = math.inf) -> tuple[str, int]:
    """
    Boot a guest and run a command in it; return the kernel's version and the exit status.

    Parameters
    ----------
    command : list of str
    silence : float
        Longest time without output [s].

    Raises
    ------
    GuestUnavailableError
        The guest has no kernel, no room for its memory, or its first process never ran.
    GuestError
        The guest started and did not run the command to its end.

    """
    try:
        root = fetch.fetch(CACHE)
    except (fetch.FetchError, OSError, subprocess.TimeoutExpired) as error:
        raise GuestUnavailableError(str(error)) from error
    with _work_folder() as folder, _serial_line() as line:
        _write_order(folder, root, command)
        process = _start(folder, root, line.descriptor)
        try:
            reason = _watch(process, folder, line, silence)
        finally:
            # The shell that waits for the end of this program is still in the group.
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            process.stdin.close()
        return _outcome(folder, reason or f'died (exit status {process.returncode})')


def _watch(
    process: subprocess.Popen,
    folder: Path,
    line: SerialLine,
    silence: float,
) -> str | None:
    """Wait for the end of the guest; return the reason if it must be stopped, otherwise None."""
    begin = time.monotonic()
    while True:
        with suppress(subprocess.TimeoutExpired):
            process.wait(POLL_PERIOD)
            return None
        now = time.monotonic()
        if now > line.last_output + silence:
            return f'has printed nothing for {silence:g} s'
        if now > begin + BOOT_TIMEOUT and not (folder / 'alive').exists():
            return f'has not booted after {BOOT_TIMEOUT:g} s'


@contextmanager
def _work_folder() -> Iterator[Path]:
    """Make a folder that the guest can see as well; its /dev, /proc and /sys are its own."""
    try:
        folder = Path(tempfile.mkdtemp(prefix='guest_', dir=CACHE))
    except OSError as error:
        raise GuestUnavailableError(f'no folder for the guest: {error}') from error
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _memory_folder() -> str:
    """Return a folder for the file of the guest's memory: in RAM if possible, never noexec."""
    for place in ('/dev/shm', '/tmp', str(CACHE)):
        if os.access(place, os.W_OK):
            state = os.statvfs(place)
            room = state.f_bavail * state.f_frsize
            if not state.f_flag & os.ST_NOEXEC and room > MEMORY:
                return place
    raise GuestUnavailableError(
        f'no folder has room for {MEMORY >> 20} MB of memory of the guest'
    )


def _write_order(folder: Path, root: Path, command: list[str]) -> None:
    """Write the command for guest_init.py, and a program without arguments for the kernel."""
    modules = {path.stem: str(path) for path in root.glob('usr/lib/**/*.ko')}
    order = {
        'command': command,
        'directory': os.getcwd(),
        'modules': modules,
        'environment': {
            **os.environ,
            'HOME': '/dev/tmp',
            'TMPDIR': '/dev/tmp',
            'ROS_LOG_DIR': '/dev/tmp/ros',
            'TERM': 'dumb',
            'PATH': f'{os.environ["PATH"]}:{root}/usr/bin:/usr/sbin:/sbin',
        },
    }
    (folder / 'command.json').write_text(json.dumps(order))
    python = (
        sys.executable,
        '-I',
        '-S',
        '-c',
        f'import sys; sys.path.insert(0, {str(HERE)!r}); import guest_init; '
        'guest_init.main()',
        str(folder),
    )
    (folder / 'init').write_text(f'#!/bin/sh\nexec {shlex.join(python)}\n')
    (folder / 'init').chmod(0o755)


def _start(folder: Path, root: Path, line: int) -> subprocess.Popen:
    """Start the kernel of the guest on one CPU."""
    kernel = next(root.glob('usr/bin/linux*'), None)
    if kernel is None:
        raise GuestUnavailableError('the package user-mode-linux has no kernel')
    console = os.open(folder / 'console', os.O_WRONLY | os.O_CREAT)
    # seccomp is faster than tracing the processes of the guest; they could leave it, but they
    # are ours.
    options = (
        'seccomp=auto',
        'rootfstype=hostfs',
        'rootflags=/',
        'rw',
        'devtmpfs.mount=0',
        f'init="{folder}/init"',
        'panic=-1',
        f'mem={MEMORY >> 20}M',
        f'umid={folder.name}',
        'con=null',
        f'con0=null,fd:{console}',
        'ssl=null',
        f'ssl0=null,fd:{line}',
    )
    process = subprocess.Popen(
        [
            'taskset',
            '--cpu-list',
            str(max(os.sched_getaffinity(0))),
            'sh',
            '-c',
            LAUNCH,
            'sh',
            kernel,
            *options,
        ],
        env={'TMPDIR': _memory_folder(), 'HOME': str(folder), 'PATH': os.defpath},
        stdin=subprocess.PIPE,
        stdout=console,
        stderr=console,
        pass_fds=(console, line),
        start_new_session=True,
    )
    os.close(console)
    return process


@contextmanager
def _serial_line() -> Iterator[SerialLine]:
    """Open a serial line whose output is copied to our standard output until it ends."""
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
            line.last_output = time.monotonic()
            sys.stdout.buffer.write(data)
            sys.stdout.flush()


def _outcome(folder: Path, reason: str) -> tuple[str, int]:
    """Return the kernel's version and the exit status of the command, or raise an error."""
    text, status, error = ((folder / name) for name in ('console', 'status', 'error'))
    console = text.read_text(errors='replace')
    last_lines = '\n'.join(
        ['the last lines of its console:', *console.splitlines()[-CONSOLE_LINES:]]
    )
    if status.exists():
        version = re.search(r'Linux version (\S+)', console)
        return version[1] if version else 'of unknown version', int(status.read_text())
    if error.exists():
        raise GuestError(f'the guest did not run the command: {error.read_text()}')
    if (folder / 'alive').exists():
        raise GuestError(f'the guest {reason}\n{last_lines}')
    raise GuestUnavailableError(
        f'user-mode Linux does not start here: the guest {reason}\n{last_lines}'
    )
