"""Fetch distribution packages without root: apt-get and dpkg unpack, nothing is installed."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import subprocess

PACKAGES = ('user-mode-linux', 'can-utils')
SYSTEM_LISTS = Path('/var/lib/apt/lists')
TIMEOUT = 600.0
MIRROR = 'DEBIAN_MIRROR'  # environment variable: URL of a Debian mirror, for other distributions
SUITE = 'bookworm main'
# Debian Stable Release Key (12/bookworm), 4D64 FEC1 19C2 0290 67D6 E791 F8D2 585B 8783 D481;
# Ubuntu 22.04 has no package with it.
DEBIAN_KEY = """\
-----BEGIN PGP PUBLIC KEY BLOCK-----

mDMEY865UxYJKwYBBAHaRw8BAQdAd7Z0srwuhlB6JKFkcf4HU4SSS/xcRfwEQWzr
crf6AEq0SURlYmlhbiBTdGFibGUgUmVsZWFzZSBLZXkgKDEyL2Jvb2t3b3JtKSA8
ZGViaWFuLXJlbGVhc2VAbGlzdHMuZGViaWFuLm9yZz6IlgQTFggAPhYhBE1k/sEZ
wgKQZ9bnkfjSWFuHg9SBBQJjzrlTAhsDBQkPCZwABQsJCAcCBhUKCQgLAgQWAgMB
Ah4BAheAAAoJEPjSWFuHg9SBSgwBAP9qpeO5z1s5m4D4z3TcqDo1wez6DNya27QW
WoG/4oBsAQCEN8Z00DXagPHbwrvsY2t9BCsT+PgnSn9biobwX7bDDg==
=5NZE
-----END PGP PUBLIC KEY BLOCK-----
"""


class FetchError(Exception):
    """A package cannot be had; the message says why."""


def fetch(folder: Path) -> Path:
    """
    Return the folder into which `PACKAGES` are unpacked, after fetching them where it is missing.

    Raises
    ------
    FetchError
        Without apt, dpkg, a mirror, a network or room on the disk.

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
    _download(partial)
    for archive in partial.glob('*.deb'):
        _run(['dpkg', '-x', str(archive), str(partial / 'root')], partial, dict(os.environ))
    (partial / 'root').rename(root)
    shutil.rmtree(partial)
    return root


def _download(partial: Path) -> None:
    """Download with the system's package lists, where they will do, or else with our own."""
    debian = 'ID=debian\n' in Path('/etc/os-release').read_text()
    if debian and any(SYSTEM_LISTS.glob('*_Packages*')) and _downloads_at_once(partial):
        return
    options = _private_state(partial) + ([] if debian else _debian_sources(partial))
    _apt(partial, *options, 'update')
    _apt(partial, *options, 'download', *PACKAGES)


def _downloads_at_once(partial: Path) -> bool:
    try:
        _apt(partial, 'download', *PACKAGES)
    except FetchError:  # lists that are out of date name files that are gone
        return False
    return True


def _debian_sources(partial: Path) -> list[str]:
    """Return apt options for Debian's packages: Ubuntu has no user-mode-linux of its own."""
    mirror = os.environ.get(MIRROR)
    if not mirror:
        raise FetchError(
            f'this distribution has no package user-mode-linux: load the kernel module vcan (sudo '
            f'modprobe vcan), or set {MIRROR} to the URL of a Debian mirror')
    sources, keys = partial / 'debian.list', partial / 'keys'
    sources.write_text(f'deb {mirror} {SUITE}\n')
    keys.mkdir()
    (keys / 'debian.asc').write_text(DEBIAN_KEY)
    return ['-o', f'Dir::Etc::SourceList={sources}', '-o', 'Dir::Etc::SourceParts=/dev/null',
            '-o', 'Dir::Etc::Trusted=/dev/null', '-o', f'Dir::Etc::TrustedParts={keys}/']


def _private_state(partial: Path) -> list[str]:
    """Return apt options that keep lists and caches in `partial` instead of /var."""
    for folder in ('lists', 'cache/archives'):
        (partial / folder / 'partial').mkdir(parents=True, exist_ok=True)
    return ['-o', f'Dir::State::Lists={partial}/lists', '-o', f'Dir::Cache={partial}/cache',
            '-o', 'APT::Sandbox::User=', '-o', 'Acquire::Languages=none']


def _apt(partial: Path, *arguments: str) -> None:
    environment = {**os.environ, 'LC_ALL': 'C', 'TMPDIR': str(partial / 'tmp')}
    _run(['apt-get', '-q', '-o', 'APT::Update::Error-Mode=any', *arguments], partial, environment)


def _run(command: list[str], folder: Path, environment: dict[str, str]) -> None:
    result = subprocess.run(command, cwd=folder, env=environment, timeout=TIMEOUT, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if result.returncode:
        errors = [line for line in result.stdout.splitlines() if line.startswith(('E:', 'dpkg'))]
        raise FetchError(f'{command[0]} {command[-1]} failed: '
                         f'{" ".join(errors) or result.stdout[-300:]}')
