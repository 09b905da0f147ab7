"""
Where the package's data files are: configuration, EDS, scenarios, launch files.

Code and data of one version belong together, so the tree that the package runs from comes first
(a checkout, an editable or a symlink install); an installed package finds the share directory
of its ament prefix, or, installed by pip alone, the one under ``sys.prefix``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from email import message_from_string
from functools import cache
from importlib.metadata import distributions
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

PACKAGE = Path(__file__).resolve().parent
MACHINE_FILE = Path('manipulator.yaml')  # the parameter file of a machine, in the present folder
GIT_TIMEOUT = 10.0  # s; it takes some 20 ms


def config_path(relative: str | os.PathLike[str] = '') -> Path:
    """
    Return the absolute path of a file or folder below ``config/``: ``'drives/epos4.yaml'``.

    Raises a FileNotFoundError with every place that was searched.
    """
    return resource_path(Path('config') / relative)


def resource_path(relative: str | os.PathLike[str]) -> Path:
    """Find an installed file by its path below the package's share directory."""
    places = list(share_directories())
    for place in places:
        if (place / relative).exists():
            return place / relative
    searched = ', '.join(str(place) for place in places) or 'no share directory'
    raise FileNotFoundError(f'{relative} is not among the data files of {PACKAGE.name} '
                            f'(searched: {searched})')


def share_directories() -> Iterator[Path]:
    """Yield the directories that may hold the data files, the nearest to the code first."""
    if (PACKAGE.parent / 'package.xml').is_file():
        yield PACKAGE.parent
    yield from installed_shares(PACKAGE.name)


def installed_shares(package: str) -> Iterator[Path]:
    """Yield the share directories of a ROS package, by ament prefix, then ``sys.prefix``."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    for prefix in (*filter(None, prefixes), sys.prefix):
        share = Path(prefix) / 'share' / package
        if share.is_dir():
            yield share


def import_path() -> list[str]:
    """
    Return where modules are imported from, without the working directory.

    A ``can.py`` or ``queue.py`` that a user keeps there would run in our process. Where the
    working directory holds this package, it is searched last.
    """
    own = str(PACKAGE.parent)
    try:
        here = os.getcwd()
    except FileNotFoundError:  # the directory was removed
        here = ''
    path = [entry for entry in sys.path if entry and os.path.realpath(entry) != here]
    return [*path, own] if own == here else path


def or_installed(path: Path) -> Path:
    """Return a parameter file, or that of the package where it has not been written yet."""
    return path if path.exists() else config_path('manipulator.yaml')


@cache
def version() -> str:
    """
    Return version and commit of the code that runs, ``0.2.0+g1a2b3c4``.

    Those of a checkout are read from its manifest and from git, others from the metadata beside
    the code: a Python path may lead to further installations, and to metadata that is broken.
    """
    folder = PACKAGE.parent
    manifest = folder / 'package.xml'
    if manifest.is_file():
        return f'{ElementTree.parse(manifest).findtext("version")}{commit(folder)}'
    for found in distributions(name=PACKAGE.name, path=[str(folder)]):
        if (metadata := found.read_text('METADATA') or found.read_text('PKG-INFO')):
            return str(message_from_string(metadata)['Version'])
    return 'unknown'


def commit(folder: Path) -> str:
    """Return the commit of a checkout, ``+g1a2b3c4``, ``.dirty`` if files differ, '' of others."""
    if not (folder / '.git').exists():
        return ''
    with suppress(OSError, subprocess.SubprocessError):
        return '+g' + subprocess.run(
            ['git', '-C', folder, 'describe', '--always', '--dirty=.dirty', '--exclude=*'],
            check=True, capture_output=True, text=True, timeout=GIT_TIMEOUT).stdout.strip()
    return ''
