"""
Install the nodes as services of systemd: units, environment, parameter file, network.

Everything is rendered from config/deploy with what this process runs in, so that the services find
the same ROS, packages and middleware as whoever installs them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import getpass
import os
from pathlib import Path
import pwd
import re
import shutil
import subprocess
import sys
from typing import NamedTuple

from facade_manipulator.errors import exit_status, ParameterError
from facade_manipulator.files import atomic_write
from facade_manipulator.resources import config_path

ENVIRONMENT = 'environment'
KEPT = re.compile(r'(AMENT_\w+|ROS_\w+|RMW_\w+|FASTDDS_\w+|FASTRTPS_\w+|CYCLONEDDS_\w+|PYTHONPATH|'
                  r'LD_LIBRARY_PATH)')
NAMESPACE = re.compile(r'[A-Za-z_][A-Za-z0-9_]*')
ONLY_SYSTEM = '@SYSTEM@'
NEW_HOME = '/var/lib/facade_manipulator'
MODE = 0o644


class InstalledFile(NamedTuple):
    """A file to be there."""

    path: Path
    content: str
    is_kept: bool = False  #: whether what stands there stays, since the user edits it
    is_compared: bool = True  #: whether another content is wrong

    def difference(self) -> str:
        """Return what is wrong with the file on the disk; empty if nothing is."""
        try:
            present = self.path.read_text(encoding='utf-8')
        except FileNotFoundError:
            return 'is not there'
        except (OSError, UnicodeDecodeError) as error:
            return f'cannot be read: {error}'
        alike = not self.is_compared or present == self.content
        return '' if alike else 'differs from what this version has'

    def write(self) -> bool:
        """Write it unless it is kept; return whether it was written."""
        if self.is_kept and self.path.exists():
            return False
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(self.path) as draft:
            draft.write_text(self.content, encoding='utf-8')
            draft.chmod(MODE)
        return True


def planned_files(options: argparse.Namespace) -> Iterator[InstalledFile]:
    """Yield what belongs on the disk for the services of one namespace."""
    units, folder = _folders(options)
    there = folder if options.user else Path('/') / folder.relative_to(options.root)
    values = {'PYTHON': sys.executable, 'USER': options.account, 'HOME': _home(options.account),
              'FOLDER': str(there),  # on the computer that it is written for
              # a user's systemd has no multi-user.target (systemd.special(7), user units)
              'BOOT': 'default.target' if options.user else 'multi-user.target'}
    for source in sorted(config_path('deploy/systemd').iterdir()):
        yield InstalledFile(units / source.name, _render(source, values, not options.user))
    if not options.user:
        tree = config_path('deploy/system')
        for source in sorted(path for path in tree.rglob('*') if path.is_file()):
            yield InstalledFile(options.root / source.relative_to(tree), _render(source, values))
    yield InstalledFile(folder / ENVIRONMENT, _environment(), is_compared=False)
    yield InstalledFile(
        folder / f'{options.namespace}.yaml',
        config_path('manipulator.yaml').read_text('utf-8'), is_kept=True, is_compared=False)


def _folders(options: argparse.Namespace) -> tuple[Path, Path]:
    """Return where the units are, and the environment with the parameter files."""
    if options.user:
        home = Path(os.environ.get('XDG_CONFIG_HOME') or Path.home() / '.config')
        return home / 'systemd/user', home / 'facade_manipulator'
    return options.root / 'etc/systemd/system', options.root / 'etc/facade_manipulator'


def _home(account: str) -> str:
    """Return an account's home; sysusers.d makes one that is not there yet."""
    try:
        return pwd.getpwnam(account).pw_dir
    except KeyError:
        return NEW_HOME


def _render(source: Path, values: dict[str, str], is_system: bool = True) -> str:
    lines = source.read_text('utf-8').splitlines(keepends=True)
    text = ''.join(line.removeprefix(ONLY_SYSTEM) for line in lines
                   if is_system or not line.startswith(ONLY_SYSTEM))
    return re.sub(r'@([A-Z]+)@', lambda match: values[match[1]], text)


def _environment() -> str:
    """Return the environment that ROS needs, as systemd reads it."""
    kept = {name: value for name, value in sorted(os.environ.items()) if KEPT.fullmatch(name)}
    quoted = (value.replace('\\', '\\\\').replace('"', '\\"') for value in kept.values())
    return ''.join(f'{name}="{value}"\n' for name, value in zip(kept, quoted, strict=True))


def verify_units(options: argparse.Namespace) -> str:
    """Return what systemd says of the units on the disk; empty if they are right."""
    if shutil.which('systemd-analyze') is None:
        return 'systemd-analyze is not installed: the units could not be checked'
    folder, _ = _folders(options)
    done = subprocess.run(
        ['systemd-analyze', 'verify', '--man=no', '--generators=no',
         *(['--user'] if options.user else []), *map(str, sorted(folder.glob('facade*@.*')))],
        capture_output=True, text=True, check=False,
        env={**os.environ, 'SYSTEMD_UNIT_PATH': f'{folder}:'})
    ours = [line for line in done.stderr.splitlines() if 'facade' in line]
    return '\n'.join(ours)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _options(arguments)
    return exit_status('install_services', lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    if not NAMESPACE.fullmatch(options.namespace):
        raise ParameterError(
            f'namespace {options.namespace!r} is not a name: letters, digits and _, as gondola_1')
    files = list(planned_files(options))
    return _check(files, options) if options.check else _install(files, options)


def _check(files: list[InstalledFile], options: argparse.Namespace) -> int:
    wrong = '\n'.join(
        f'{file.path} {difference}' for file in files if (difference := file.difference()))
    wrong = wrong or verify_units(options)
    print(wrong or f'all {len(files)} files are in place, systemd accepts the units')
    return 1 if wrong else 0


def _install(files: list[InstalledFile], options: argparse.Namespace) -> int:
    for file in files:
        if file.write():
            print(f'written: {file.path}')
    if complaint := verify_units(options):
        print(complaint, file=sys.stderr)
        return 1
    command = f'systemctl{" --user" if options.user else ""}'
    account = ('  loginctl enable-linger    # else they start and end with your login\n'
               if options.user else '  systemd-sysusers && systemd-tmpfiles --create\n')
    print(f"""next:
  edit {files[-1].path}: node ids, serial numbers, lead, stroke
{account}  {command} daemon-reload
  {command} enable --now facade@{options.namespace}.target
The driver configures itself. Nothing has power before somebody homes and activates it.""")
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='install_services',
        description='Install the nodes of a gondola as services of systemd.')
    parser.add_argument('--check', action='store_true',
                        help='write nothing: say what is missing, other, or wrong')
    parser.add_argument('--user', action='store_true',
                        help="services of this user, without real-time rights or can0's settings")
    parser.add_argument('--namespace', default='gondola_1',
                        help='namespace of the nodes and name of the target (default gondola_1)')
    parser.add_argument('--account', default=os.environ.get('SUDO_USER') or getpass.getuser(),
                        help='who the services run as (default: who installs them)')
    parser.add_argument('--root', type=Path, default=Path('/'), metavar='DIR',
                        help='write below this folder, as into the image of another computer')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    raise SystemExit(main())
