"""Fetch the kernel of user-mode Linux as a Debian package, without root and without installing."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shutil
import subprocess

PACKAGES = ('user-mode-linux', 'libc6', 'can-utils')
# The kernels of Debian 12 and 13 die at their first process on processors with AMX, because they
# do not restore all registers. The kernel of this suite needs a newer C library than those have,
# so the C library of the suite is fetched as well.
SUITE = 'forky'
# Debian Archive Automatic Signing Key (13/trixie), one of the two that sign the suite:
# 04B5 4C3C DCA7 9751 B16B C6B5 2256 29DF 75B1 88BD. Keyrings of older systems lack it.
KEY = Path(__file__).resolve().with_name('debian_archive_key.asc')
OS_RELEASE = Path('/etc/os-release')
LOADER = 'ld-linux-x86-64.so.2'
TIMEOUT = 600.0  # s


class FetchError(Exception):
    """A package cannot be fetched; the message gives the reason."""


def fetch(folder: Path) -> Path:
    """
    Return the folder that holds the unpacked `PACKAGES`; download them if it is missing.

    Raises
    ------
    FetchError
        Without Debian, apt, dpkg, patchelf, network or disk space.

    """
    root, note = folder / 'root', folder / 'note'
    content = f'{SUITE} for {root}\n'  # the programs name their C library by its absolute path
    if note.is_file() and note.read_text() == content:
        return root
    for tool in ('apt-get', 'dpkg', 'patchelf'):
        if shutil.which(tool) is None:
            raise FetchError(f'{tool} is not on this system')
    if not re.search(r'^ID=debian$', OS_RELEASE.read_text(), re.MULTILINE):
        raise FetchError('this distribution is not Debian; next: sudo modprobe vcan')
    print(
        f'fetching {", ".join(PACKAGES)} of Debian {SUITE} (49 MB) into {folder}',
        flush=True,
    )
    shutil.rmtree(folder, ignore_errors=True)
    partial = folder / 'partial'
    partial.mkdir(parents=True)
    _download(partial)
    for archive in partial.glob('*.deb'):
        _run(['dpkg', '-x', str(archive), str(root)], partial)
    shutil.rmtree(partial)
    _use_own_c_library(root)
    note.write_text(content)
    return root


def _use_own_c_library(root: Path) -> None:
    """Let the unpacked programs load the unpacked C library."""
    loader = next(root.glob(f'usr/lib/*/{LOADER}'), None)
    if loader is None:
        raise FetchError(f'the package libc6 has no {LOADER}')
    for program in (root / 'usr/bin').iterdir():
        if program.is_file() and program.read_bytes().startswith(b'\x7fELF'):
            _run(
                [
                    'patchelf',
                    '--set-interpreter',
                    str(loader),
                    '--set-rpath',
                    str(loader.parent),
                    str(program),
                ],
                root,
            )


def _download(partial: Path) -> None:
    """Download the packages from the first mirror of this Debian that has the signed suite."""
    for folder in ('lists', 'cache/archives'):
        (partial / folder / 'partial').mkdir(parents=True)
    (partial / 'keys').mkdir()
    shutil.copy(KEY, partial / 'keys')
    (partial / 'installed').touch()
    settings = {  # lists and caches lie in `partial`; the system's own sources are not used
        'State::Lists': partial / 'lists',
        'State::Status': partial / 'installed',
        'Cache': partial / 'cache',
        'Etc::SourceList': partial / 'debian.list',
        'Etc::SourceParts': '/dev/null',
        'Etc::Preferences': '/dev/null',
        'Etc::PreferencesParts': '/dev/null',
        'Etc::Trusted': '/dev/null',
        'Etc::TrustedParts': f'{partial}/keys/',
    }
    options = [
        '-o',
        'APT::Sandbox::User=',
        '-o',
        'Acquire::Languages=none',
        '-o',
        'APT::Architecture=amd64',
        '-o',
        'APT::Architectures=amd64',
        *(
            word
            for key, value in settings.items()
            for word in ('-o', f'Dir::{key}={value}')
        ),
    ]
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
    """Return the mirrors from which this Debian installs its packages."""
    sources = _apt(
        partial, '-o', f'Dir::State::Lists={partial}/none', 'update', '--print-uris'
    )
    found = re.findall(r"^'(\S+?)/?/dists/\S+/InRelease'", sources, re.MULTILINE)
    if not found:
        raise FetchError(
            'apt has no sources; next: add a Debian mirror to the sources of apt'
        )
    return list(dict.fromkeys(found))


def _apt(partial: Path, *arguments: str) -> str:
    temporary = partial / 'tmp'
    temporary.mkdir(exist_ok=True)
    return _run(
        ['apt-get', '-q', '-o', 'APT::Update::Error-Mode=any', *arguments],
        partial,
        LC_ALL='C',
        TMPDIR=str(temporary),
    )


def _run(command: list[str], folder: Path, **environment: str) -> str:
    result = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **environment},
        timeout=TIMEOUT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if result.returncode:
        errors = [
            line
            for line in result.stdout.splitlines()
            if line.startswith(('E:', 'dpkg'))
        ]
        raise FetchError(
            f'{command[0]} {command[-1]} failed: '
            f'{" ".join(errors) or result.stdout[-300:]}'
        )
    return result.stdout
