"""
Run a command where there is a virtual CAN interface, vcan0, without asking for root.

``python vcan.py -- COMMAND…`` looks for it in a network namespace of its own, then among the
machine's interfaces, and boots user-mode Linux where the kernel has no vcan at all. Without any
of them it says so loudly and runs the command all the same: the tests then skip themselves, which
is a failure where CI=true.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys

import guest
import link

NAMESPACE = ('unshare', '--net', '--mount')
NAMESPACES = ((*NAMESPACE,), (*NAMESPACE, '--user', '--map-root-user'))
INSIDE = (sys.executable, str(Path(__file__).resolve()), '--inside')
INTERFACE = Path('/sys/class/net/vcan0')
PROBE_TIMEOUT = 20.0
MISSING = 'FACADE_MANIPULATOR_NO_VCAN'


def run(command: list[str], silence: float = math.inf) -> tuple[str, int]:
    """
    Run a command beside a vcan0; return where that was and its exit status.

    A guest that says nothing for longer than `silence` [s] is an error.

    """
    for namespace in NAMESPACES if shutil.which('unshare') else ():
        if _succeeds([*namespace, *INSIDE, 'true']):
            return 'a network namespace', call([*namespace, *INSIDE, *command])
    if INTERFACE.exists():
        return 'this machine, which has a vcan0', call(command)
    try:
        kernel, status = guest.run_in_guest(command, silence)
        return f'user-mode Linux {kernel}', status
    except guest.GuestUnavailableError as error:
        reason = f'the kernel has no vcan and user-mode Linux cannot be had: {error}'
    print(f'\n!!! NO SOCKETCAN TESTS: {reason}\n', flush=True)
    status = call(command, {**os.environ, MISSING: reason.partition('\n')[0]})
    return 'this machine, without a vcan', status or int(os.environ.get('CI') == 'true')


def call(command: list[str], environment: dict[str, str] | None = None) -> int:
    """Run a command and return its exit status; what Ctrl-C means is the command's affair."""
    previous = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        return subprocess.call(command, env=environment)
    finally:
        signal.signal(signal.SIGINT, previous)


def _succeeds(command: list[str]) -> bool:
    try:
        return subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              timeout=PROBE_TIMEOUT).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def _run_inside(command: list[str]) -> None:
    """Turn into the command, in a fresh network namespace with lo, vcan0 and its own /sys."""
    link.bring_up()
    if ctypes.CDLL(None).mount(b'sysfs', b'/sys', b'sysfs', 0, None) < 0:
        sys.exit('the namespace cannot have a /sys of its own')
    os.execvp(command[0], command)


def main() -> int:
    """Run the command of the command line."""
    if sys.argv[1:2] == ['--inside']:
        _run_inside(sys.argv[2:])
    options, command = argparse.ArgumentParser(description=__doc__), sys.argv.index('--')
    options.add_argument('--silence', type=float, default=math.inf, help='longest of a guest [s]')
    try:
        place, status = run(
            sys.argv[command + 1:], options.parse_args(sys.argv[1:command]).silence)
    except guest.GuestError as error:
        sys.exit(f'guest: {error}')
    print(f'this ran in {place}')
    return status


if __name__ == '__main__':
    sys.exit(main())
