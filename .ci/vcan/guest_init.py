"""
First process of the guest: mount, load modules, bring up CAN, run the command, power off.

The kernel starts ``guest_init.py FOLDER``. FOLDER, on the host's disk, holds ``command.json``. The
process writes ``alive`` at once, then ``status`` (exit status of the command) or ``error``.
"""

from __future__ import annotations

import ctypes
import json
import os
from pathlib import Path
import stat
import sys
import termios
import traceback

import link

DEVICES = {
    'null': (1, 3),
    'zero': (1, 5),
    'full': (1, 7),
    'random': (1, 8),
    'urandom': (1, 9),
    'tty': (5, 0),
    'console': (5, 1),
    'ptmx': (5, 2),
    'ttyS0': (4, 64),
}
MOUNTS = (
    ('proc', '/proc'),
    ('sysfs', '/sys'),
    ('tmpfs', '/dev'),
    ('devpts', '/dev/pts'),
    ('tmpfs', '/dev/shm'),
    ('tmpfs', '/dev/tmp'),
)
MODULES = ('can', 'can-raw', 'can-bcm', 'can-dev', 'vcan')
FINIT_MODULE = 313  # system call number on x86-64
POWER_OFF = 0x4321FEDC

libc = ctypes.CDLL(None, use_errno=True)


def main() -> None:
    """Run the command, write its exit status and power off; never return."""
    folder = Path(sys.argv[1])
    try:
        (folder / 'alive').touch()
        status = prepare_and_run(json.loads((folder / 'command.json').read_text()))
        (folder / 'status').write_text(str(status))
    except BaseException:  # the kernel panics if its first process ends
        (folder / 'error').write_text(traceback.format_exc())
    os.sync()
    libc.reboot(POWER_OFF)


def prepare_and_run(order: dict) -> int:
    """Prepare the system that a command expects, then run it."""
    mount_all()
    open_terminal()
    for module in MODULES:
        if module in order['modules']:  # otherwise it is built into the kernel
            load_module(order['modules'][module])
    link.bring_up()
    status = run(order['command'], order['environment'], order['directory'])
    termios.tcdrain(1)
    return status


def mount_all() -> None:
    """Mount the kernel's file systems and fill /dev."""
    os.umask(0)
    for kind, place in MOUNTS:
        os.makedirs(place, exist_ok=True)
        check(
            libc.mount(kind.encode(), place.encode(), kind.encode(), 0, None),
            f'mount {place}',
        )
        if place == '/dev':
            for name, (major, minor) in DEVICES.items():
                os.mknod(f'/dev/{name}', stat.S_IFCHR | 0o666, os.makedev(major, minor))
            os.symlink('/proc/self/fd', '/dev/fd')
    os.umask(0o022)


def open_terminal() -> None:
    """Connect standard output and error to the first serial line, without CR LF."""
    null = os.open('/dev/null', os.O_RDONLY)
    serial_line = os.open('/dev/ttyS0', os.O_WRONLY | os.O_NOCTTY)
    for source, target in ((null, 0), (serial_line, 1), (serial_line, 2)):
        os.dup2(source, target)
    attributes = termios.tcgetattr(1)
    attributes[1] &= ~termios.OPOST
    termios.tcsetattr(1, termios.TCSANOW, attributes)


def load_module(path: str) -> None:
    """Load a kernel module from its file."""
    descriptor = os.open(path, os.O_RDONLY)
    check(libc.syscall(FINIT_MODULE, descriptor, b'', 0), f'load {path}')
    os.close(descriptor)


def run(command: list[str], environment: dict[str, str], directory: str) -> int:
    """Run a command to its end; reap orphans until then."""
    os.chdir(directory)
    os.environ.clear()
    os.environ.update(environment)
    child = os.posix_spawnp(command[0], command, os.environ, setsid=True)
    while True:
        process, status = os.wait()
        if process == child:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else 128 - code


def check(result: int, what: str) -> None:
    """Raise OSError if a C function returned a negative number."""
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, f'{what}: {os.strerror(code)}')


if __name__ == '__main__':
    main()
