"""Fetch Debian packages without root: apt-get and dpkg unpack, nothing is installed."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shutil
import subprocess

PACKAGES = ('user-mode-linux', 'libc6', 'can-utils')
# Not the distribution's own kernel: that of Debian 12 and 13 dies at its first process on
# processors with AMX, whose registers it does not restore whole, and Ubuntu has none. This one
# wants a newer C library than they have, so it gets that of its suite.
SUITE = 'forky'
# Debian Archive Automatic Signing Key (13/trixie), one of the two that sign the suite:
# 04B5 4C3C DCA7 9751 B16B C6B5 2256 29DF 75B1 88BD. Keyrings of older systems lack it.
KEY = Path(__file__).resolve().with_name('debian_archive_key.asc')
MIRROR = 'DEBIAN_MIRROR'  # environment variable: URL of a Debian mirror, for other distributions
OS_RELEASE = Path('/etc/os-release')
LOADER = 'ld-linux-x86-64.so.2'
TIMEOUT = 600.0


class FetchError(Exception):
    """A package cannot be had; the message says why."""


def fetch(folder: Path) -> Path:
    """
    Return the folder into which `PACKAGES` are unpacked, after fetching them where it is missing.

    Raises
    ------
    FetchError
        Without apt, dpkg, patchelf, a mirror, a network or room on the disk.

    """
    root, note = folder / 'root', folder / 'note'
    made = f'{SUITE} for {root}\n'  # the programs in it name their C library by its path
    if note.is_file() and note.read_text() == made:
        return root
    _require('apt-get', 'dpkg', 'patchelf')
    print(f'fetching {", ".join(PACKAGES)} of Debian {SUITE} (49 MB) into {folder}', flush=True)
    _unpack(folder)
    _bind(root)
    note.write_text(made)
    return root


def _unpack(folder: Path) -> None:
    """Empty the folder and unpack `PACKAGES` into `folder`/root."""
    shutil.rmtree(folder, ignore_errors=True)
    partial = folder / 'partial'
    partial.mkdir(parents=True)
    _download(partial)
    for archive in partial.glob('*.deb'):
        _run(['dpkg', '-x', str(archive), str(folder / 'root')], partial)
    shutil.rmtree(partial)


def _require(*tools: str) -> None:
    for tool in tools:
        if shutil.which(tool) is None:
            raise FetchError(f'{tool} is not on this system')


def _bind(root: Path) -> None:
    """Let the programs run with the C library that lies beside them."""
    loaders = list(root.glob(f'usr/lib/*/{LOADER}'))
    if not loaders:
        raise FetchError(f'there is no {LOADER} in the package libc6')
    for program in (root / 'usr/bin').iterdir():
        if program.is_file() and program.read_bytes().startswith(b'\x7fELF'):
            _run(['patchelf', '--set-interpreter', str(loaders[0]),
                  '--set-rpath', str(loaders[0].parent), str(program)], root)


def _download(partial: Path) -> None:
    """Download from the first mirror that has the suite, signed with `KEY`."""
    options = [*_private_state(partial), '-o', 'APT::Architecture=amd64',
               '-o', 'APT::Architectures=amd64']
    mirrors = _mirrors(partial)
    for mirror in mirrors:
        (partial / 'debian.list').write_text(f'deb {mirror} {SUITE} main\n')
        try:
            _apt(partial, *options, 'update')
            break
        except FetchError:
            if mirror == mirrors[-1]:
                raise
    _apt(partial, *options, 'download', *PACKAGES)


def _mirrors(partial: Path) -> list[str]:
    """Return the mirror that the environment names, or those from which this Debian comes."""
    if mirror := os.environ.get(MIRROR):
        return [mirror]
    if not re.search(r'^ID=debian$', OS_RELEASE.read_text(), re.MULTILINE):
        raise FetchError(
            f'this distribution is not Debian: set {MIRROR} to the URL of a Debian mirror (for a '
            f'vcan, load the kernel module instead: sudo modprobe vcan)')
    sources = _apt(partial, '-o', f'Dir::State::Lists={partial}/none', 'update', '--print-uris')
    found = re.findall(r"^'(\S+?)/?/dists/\S+/InRelease'", sources, re.MULTILINE)
    if not found:
        raise FetchError(f'apt has no sources: set {MIRROR} to the URL of a Debian mirror')
    return list(dict.fromkeys(found))


def _private_state(partial: Path) -> list[str]:
    """Return apt options for nothing but the suite, with lists and caches in `partial`."""
    for folder in ('lists', 'cache/archives'):
        (partial / folder / 'partial').mkdir(parents=True)
    (partial / 'keys').mkdir()
    shutil.copy(KEY, partial / 'keys')
    (partial / 'installed').touch()
    settings = {
        'State::Lists': partial / 'lists', 'State::Status': partial / 'installed',
        'Cache': partial / 'cache', 'Etc::SourceList': partial / 'debian.list',
        'Etc::SourceParts': '/dev/null', 'Etc::Preferences': '/dev/null',
        'Etc::PreferencesParts': '/dev/null', 'Etc::Trusted': '/dev/null',
        'Etc::TrustedParts': f'{partial}/keys/'}
    return ['-o', 'APT::Sandbox::User=', '-o', 'Acquire::Languages=none',
            *(word for key, value in settings.items() for word in ('-o', f'Dir::{key}={value}'))]


def _apt(partial: Path, *arguments: str) -> str:
    temporary = partial / 'tmp'
    temporary.mkdir(exist_ok=True)
    return _run(['apt-get', '-q', '-o', 'APT::Update::Error-Mode=any', *arguments], partial,
                LC_ALL='C', TMPDIR=str(temporary))


def _run(command: list[str], folder: Path, **environment: str) -> str:
    result = subprocess.run(
        command, cwd=folder, env={**os.environ, **environment}, timeout=TIMEOUT, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    if result.returncode:
        errors = [line for line in result.stdout.splitlines() if line.startswith(('E:', 'dpkg'))]
        raise FetchError(f'{command[0]} {command[-1]} failed: '
                         f'{" ".join(errors) or result.stdout[-300:]}')
    return result.stdout
