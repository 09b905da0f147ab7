"""
Files: package data, user files, and directories of imported modules.

Code and data of one version belong together. A checkout therefore uses its own files; an installed
package uses the share directory of its ament prefix, or the share directory of pip below
``sys.prefix``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
import errno
import os
from pathlib import Path
import stat
import sys

PACKAGE = Path(__file__).resolve().parent
# parameter file of a machine, in the working directory
MACHINE_FILE = Path('manipulator.yaml')
OVERLAY = 'machine.yaml'  # results of `commission`, beside the parameter file


def config_path(relative: str | os.PathLike[str] = '') -> Path:
    """
    Return the path of a file or directory in ``config/``, such as ``'drives/epos4.yaml'``.

    Raises a FileNotFoundError with every directory that was searched.
    """
    of_ament = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    prefixes = [*of_ament, sys.prefix]
    shares = [Path(prefix, 'share', PACKAGE.name) for prefix in prefixes if prefix]
    if (PACKAGE.parent / 'package.xml').is_file():
        shares.insert(0, PACKAGE.parent)
    for share in shares:
        if (path := share / 'config' / relative).exists():
            return path
    raise FileNotFoundError(
        f'config/{relative} is not among the data files of {PACKAGE.name} '
        f'(searched: {", ".join(map(str, shares))})'
    )


def machine_files(given: Sequence[Path] = ()) -> list[Path]:
    """
    Return the machine's parameter files; later files override earlier files.

    Without given files, the first is `MACHINE_FILE` of the working directory, or the file of the
    package if this file does not exist. An `OVERLAY` in the folder of the first given file, or
    else in the working directory, follows the first file unless it is given.
    """
    first, *others = given or [MACHINE_FILE]
    overlay = overlay_of(first)
    is_given = any(path.absolute() == overlay.absolute() for path in given)
    if not given and not first.exists():
        first = config_path(MACHINE_FILE)
    if is_given or not overlay.exists():
        return [first, *others]
    return [first, overlay, *others]


def overlay_of(first: Path) -> Path:
    """Return the path of the `OVERLAY` that belongs to the first parameter file."""
    return first.parent / OVERLAY  # also for a path without a name, such as `.`


def import_path() -> list[str]:
    """
    Return the directories of imported modules, without the working directory.

    A ``can.py`` or ``queue.py`` of a user in that directory would run in this process. The folder
    of this package is searched last if it is the working directory.
    """
    here = os.path.realpath('.')
    folders = [entry for entry in sys.path if entry and os.path.realpath(entry) != here]
    return [*folders, str(PACKAGE.parent)]


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """
    Yield the path of a draft, which replaces the file if the block raises no exception.

    After an exception the previous file stays. After a loss of power, one of the two files is
    complete. The file keeps its mode, and its owner and group if this user may set them. A
    symbolic link remains, and its target is replaced. A file that is a mount point cannot be
    replaced: it is copied to ``NAME.bak`` and then overwritten. The draft of a FIFO or a device is
    the path itself. Raises an OSError with the path of the file instead of the draft's.
    """
    if path.exists() and not path.is_file():
        yield path
        return
    # beside the target of a link, which may be on another file system
    target = Path(os.path.realpath(path))
    draft = target.with_name(f'.{target.name}.part')
    try:
        yield draft
        with draft.open('rb+') as file:
            if target.exists():
                _copy_access(target.stat(), file.fileno())
            os.fsync(file.fileno())
        try:
            draft.replace(target)
        except OSError as error:
            if error.errno != errno.EBUSY:
                raise
            backup = target.with_name(f'{target.name}.bak')
            _write_synchronised(backup, target.read_bytes())
            _write_synchronised(target, draft.read_bytes())
    except OSError as error:
        if error.filename == str(draft):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        with suppress(OSError):
            draft.unlink()


def _copy_access(status: os.stat_result, file: int) -> None:
    """Give an open file the owner, the group and the mode of another file."""
    # only root can give a file away; the group can be one of the groups of this user
    for owner, group in ((status.st_uid, -1), (-1, status.st_gid)):
        with suppress(PermissionError):
            os.fchown(file, owner, group)
    os.fchmod(file, stat.S_IMODE(status.st_mode))


def _write_synchronised(path: Path, content: bytes) -> None:
    """Write a file, and wait until its content is stored on the disk."""
    with path.open('wb') as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
