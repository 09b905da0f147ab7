"""Pack what somebody far away needs to find out why a machine stopped into one archive."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import suppress
import io
import os
from pathlib import Path
import platform
import shutil
import stat
import subprocess
import sys
import tarfile
import time

from facade_manipulator.errors import above_zero, exit_status
from facade_manipulator.files import atomic_write
from facade_manipulator.resources import installed_versions, PACKAGE, version, written_folder

DAY = 86_400.0  # s
TIMEOUT = 60.0  # s, of a command
LASTING = 'counters_', 'changes_'
DOCTOR = sys.executable, '-m', 'facade_manipulator.tools.doctor'


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the archive; return the exit status."""
    parser = argparse.ArgumentParser(prog='support', description=__doc__.strip())
    parser.add_argument('parameters', type=Path, nargs='*', help='parameter files of the machine')
    parser.add_argument('--folder', type=Path, default=written_folder(),
                        help='of the black box and the counters (default %(default)s)')
    parser.add_argument('--days', type=above_zero, default=7.0,
                        help='how old files and logs may be (default %(default)g)')
    parser.add_argument('--output', type=Path, default=Path(
        time.strftime('support_%Y%m%dT%H%M%SZ.tar.gz', time.gmtime())), metavar='FILE')
    options = parser.parse_args(arguments)
    return exit_status('support', lambda: _pack(options))


def _pack(options: argparse.Namespace) -> None:
    oldest = time.time() - options.days * DAY
    journals = (path for one in options.parameters
                for path in one.resolve().parent.glob(f'{one.stem}.journal.*'))
    kept = [*_files(options.folder, oldest)]
    if not kept:
        print(f'support: nothing of the last {options.days:g} days, counters or changes in '
              f'{options.folder}; next: --folder FOLDER, or a user who may look there',
              file=sys.stderr)
    found = [*kept, *_files(_logs(), oldest)]
    with atomic_write(options.output) as draft, tarfile.open(draft, 'w:gz') as archive:
        for path in (*options.parameters, *journals):
            _add_file(archive, path)
        for path in found:
            with suppress(FileNotFoundError):  # a recorder that runs deletes its oldest
                _add_file(archive, path)
        count = len(archive.getmembers())
        for name, text in (('versions.txt', _versions()), ('journal.txt', _journal(oldest)),
                           ('doctor.txt', _output(*DOCTOR, *map(str, options.parameters)))):
            _add(archive, name, text.encode())
    print(f'{options.output}: {count} files, {options.output.stat().st_size / 1e6:.1f} MB, of '
          f'{options.folder}; it names hosts and users')


def _files(folder: Path, oldest: float) -> Iterator[Path]:
    """Yield the files of a folder that are not older; lasting ones, whatever their age."""
    for path in sorted(folder.rglob('*')):
        with suppress(FileNotFoundError):  # it was there a moment ago
            if stat.S_ISREG((found := path.stat()).st_mode) and (
                    path.name.startswith(LASTING) or found.st_mtime >= oldest):
                yield path


def _logs() -> Path:
    home = os.environ.get('ROS_HOME') or '~/.ros'
    return written_folder(os.environ.get('ROS_LOG_DIR') or f'{home}/log')


def _versions() -> str:
    installed = {**installed_versions(), PACKAGE.name: version()}
    return '\n'.join([platform.platform(), f'Python {platform.python_version()}', *sorted(
        f'{name} {one}' for name, one in installed.items())])


def _journal(oldest: float) -> str:
    """Return what the services said, or why that cannot be had."""
    command = ['journalctl', '--no-pager', f'--since=@{oldest:.0f}', '--unit=facade*']
    if shutil.which(command[0]) is None:
        return 'this computer has no journalctl'
    return ''.join(_output(*command, *user) for user in ((), ('--user',)))


def _output(*command: str) -> str:
    """Return what a command writes, or that it does not end."""
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=TIMEOUT)
    except subprocess.TimeoutExpired as error:
        return str(error)
    return done.stdout + done.stderr


def _add_file(archive: tarfile.TarFile, path: Path) -> None:
    archive.add(path, str(path.resolve()).lstrip('/'))


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mtime = len(content), int(time.time())
    archive.addfile(entry, io.BytesIO(content))


if __name__ == '__main__':
    raise SystemExit(main())
