"""
Run a command beside a virtual CAN interface, vcan0, without root.

``python vcan.py -- COMMAND…`` makes vcan0 in a network namespace, or uses vcan0 of this machine,
or boots user-mode Linux. Without any of them it prints a warning and runs the command, whose
tests skip themselves; with CI=true that is a failure.
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
NAMESPACES = (NAMESPACE, (*NAMESPACE, '--user', '--map-root-user'))
INSIDE = (sys.executable, str(Path(__file__).resolve()), '--inside')
INTERFACE = Path('/sys/class/net/vcan0')
PROBE_TIMEOUT = 20.0  # s
MISSING = 'FACADE_MANIPULATOR_NO_VCAN'


def run(command: list[str], silence: float = math.inf) -> tuple[str, int]:
    """
    Run a command beside a vcan0; return the place of vcan0 and the exit status.

    A guest without output for longer than `silence` [s] is an error.

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
        reason = f'the kernel has no vcan and user-mode Linux is not available: {error}'
    print(f'\n!!! NO SOCKETCAN TESTS: {reason}\n', flush=True)
    status = call(command, {**os.environ, MISSING: reason.partition('\n')[0]})
    return 'this machine, without a vcan', status or int(os.environ.get('CI') == 'true')


def call(command: list[str], environment: dict[str, str] | None = None) -> int:
    """Run a command and return its exit status; the command itself reacts to Ctrl-C."""
    previous = signal.signal(signal.SIGINT, lambda *_: None)
    try:
        return subprocess.call(command, env=environment)
    finally:
        signal.signal(signal.SIGINT, previous)


def _succeeds(command: list[str]) -> bool:
    try:
        return (
            subprocess.run(
                command,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=PROBE_TIMEOUT,
            ).returncode
            == 0
        )
    except (OSError, subprocess.TimeoutExpired):
        return False


def _run_inside(command: list[str]) -> None:
    """Replace this process by the command, beside lo, vcan0 and the namespace's own /sys."""
    link.bring_up()
    if ctypes.CDLL(None).mount(b'sysfs', b'/sys', b'sysfs', 0, None) < 0:
        sys.exit('the namespace cannot have a /sys of its own')
    os.execvp(command[0], command)


def main() -> int:
    """Run the command of the command line."""
    if sys.argv[1:2] == ['--inside']:
        _run_inside(sys.argv[2:])
    parser, command = argparse.ArgumentParser(description=__doc__), sys.argv.index('--')
    parser.add_argument(
        '--silence',
        type=float,
        default=math.inf,
        help='longest time without output [s]',
    )
    options = parser.parse_args(sys.argv[1:command])
    try:
        place, status = run(sys.argv[command + 1 :], options.silence)
    except guest.GuestError as error:
        sys.exit(f'guest: {error}')
    print(f'the command ran in {place}')
    return status


if __name__ == '__main__':
    sys.exit(main())
