"""Fetch distribution packages without root: apt-get and dpkg unpack, nothing is installed."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import subprocess

PACKAGES = ('user-mode-linux', 'can-utils')
SYSTEM_LISTS = Path('/var/lib/apt/lists')
DEBIAN = 'deb [signed-by={keyring}] http://deb.debian.org/debian bookworm main\n'
KEYRING = 'usr/share/keyrings/debian-archive-keyring.gpg'
TIMEOUT = 600.0


class FetchError(Exception):
    """A package cannot be had; the message says why."""


def fetch(folder: Path) -> Path:
    """
    Return the folder into which `PACKAGES` are unpacked, after fetching them where it is missing.

    Raises
    ------
    FetchError
        Without apt, dpkg, a network or room on the disk.

    """
    root = folder / 'root'
    if root.is_dir():
        return root
    for tool in ('apt-get', 'dpkg'):
        if shutil.which(tool) is None:
            raise FetchError(f'{tool} is not on this system')
    print(f'fetching {" and ".join(PACKAGES)} (42 MB) into {folder}', flush=True)
    shutil.rmtree(folder, ignore_errors=True)
    partial = folder / 'partial'
    (partial / 'tmp').mkdir(parents=True)
    for package in PACKAGES:
        _unpack(_download(package, partial, _debian_options(partial)), partial / 'root')
    (partial / 'root').rename(root)
    shutil.rmtree(partial)
    return root


def _debian_options(partial: Path) -> list[str]:
    """Return apt options for Debian's packages: Ubuntu has no user-mode-linux of its own."""
    if 'ID=debian\n' in Path('/etc/os-release').read_text():
        return []
    _unpack(_download('debian-archive-keyring', partial, []), partial)
    sources = partial / 'debian.list'
    sources.write_text(DEBIAN.format(keyring=partial / KEYRING))
    return ['-o', f'Dir::Etc::SourceList={sources}', '-o', 'Dir::Etc::SourceParts=/dev/null']


def _download(package: str, partial: Path, options: list[str]) -> Path:
    """Download with the system's package lists, or else with lists of our own."""
    if options or not any(SYSTEM_LISTS.glob('*_Packages*')) or not _try(package, partial, options):
        private = [*options, *_private_state(partial, 'debian' if options else 'system')]
        _apt(partial, *private, 'update')
        _apt(partial, *private, 'download', package)
    return next(partial.glob(f'{package}_*.deb'))


def _try(package: str, partial: Path, options: list[str]) -> bool:
    try:
        _apt(partial, *options, 'download', package)
    except FetchError:  # out-of-date lists name files that are gone
        return False
    return True


def _private_state(partial: Path, name: str) -> list[str]:
    """Return apt options that keep lists and caches in `partial` instead of /var."""
    state = partial / name
    (state / 'lists' / 'partial').mkdir(parents=True, exist_ok=True)
    (state / 'cache' / 'archives' / 'partial').mkdir(parents=True, exist_ok=True)
    return ['-o', f'Dir::State::Lists={state}/lists', '-o', f'Dir::Cache={state}/cache',
            '-o', 'APT::Sandbox::User=', '-o', 'Acquire::Languages=none']


def _apt(partial: Path, *arguments: str) -> None:
    environment = {**os.environ, 'LC_ALL': 'C', 'TMPDIR': str(partial / 'tmp')}
    _run(['apt-get', '-q', '-o', 'APT::Update::Error-Mode=any', *arguments], partial, environment)


def _unpack(archive: Path, into: Path) -> None:
    _run(['dpkg', '-x', str(archive), str(into)], archive.parent, dict(os.environ))
    archive.unlink()


def _run(command: list[str], folder: Path, environment: dict[str, str]) -> None:
    result = subprocess.run(command, cwd=folder, env=environment, timeout=TIMEOUT, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if result.returncode:
        errors = [line for line in result.stdout.splitlines() if line.startswith(('E:', 'dpkg'))]
        raise FetchError(f'{command[0]} {command[-1]} failed: '
                         f'{" ".join(errors) or result.stdout[-300:]}')
