"""The folder of the files: named by number, namespace and time, whole, bounded in size."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
import re
import shutil
import time

from facade_manipulator.blackbox.recording import metadata_of, SUMMARY
from facade_manipulator.errors import RecordError, without_numbers
from facade_manipulator.files import sync
from facade_manipulator.resources import machine_name

_MEGABYTE = 1_000_000
RESERVE = 50 * _MEGABYTE  # byte of free space that are left to the rest of the machine


class Shelf:
    """
    Write files into a folder and delete the oldest of the same machine.

    They are numbered, since a clock that starts in 1970 would make the newest look oldest. In
    `folder` ``~`` is the user's home; `limit` is space for all files together [MB]. The machine's
    namespace is in their names, and no file of another recorder is written over. The first file of
    each cause goes after all others.
    """

    def __init__(self, folder: str, limit: float, namespace: str = '') -> None:
        self.folder = Path(folder).expanduser()
        self.name = machine_name(namespace)
        self._limit = limit * _MEGABYTE
        self._pattern = re.compile(rf'blackbox_(\d{{6}})_{self.name}_\d{{8}}T\d{{6}}Z\.mcap')

    def write(
        self, stamp: float, write: Callable[[Path], None], draft: Path, over: Path | None = None,
        used: int = 0,
    ) -> Path:
        """
        Let `write` fill a draft, on the same file system, of this time [s]; return its new path.

        The file `over` has fewer of the same causes and gives up its place. Used are bytes of the
        limit that other things take. Raises a RecordError that names the folder, what the system
        says, and what is free.
        """
        try:
            self.make_room(used)
            write(draft)
            sync(draft)
            path = draft.replace(over or self._reserve(stamp))
            sync(self.folder)
            self.make_room(used)
        except OSError as error:
            raise self.error(error) from error
        return path

    def error(self, error: OSError) -> RecordError:
        """Return what to say of an error of the disk."""
        return RecordError(f'{self.folder}: nothing was recorded: {error.strerror or error}')

    def _reserve(self, stamp: float) -> Path:
        """Return the path of a new file, which no other recorder can take."""
        label = time.strftime('%Y%m%dT%H%M%SZ', time.gmtime(stamp))
        number = max((int(path.name.split('_')[1]) for path in self._files()), default=0)
        while True:
            number += 1
            path = self.folder / f'blackbox_{number:06}_{self.name}_{label}.mcap'
            with suppress(FileExistsError):
                path.touch(exist_ok=False)
                return path

    def _files(self) -> list[Path]:
        return sorted(path for path in self.folder.glob('blackbox_*.mcap')
                      if self._pattern.fullmatch(path.name))

    def make_room(self, used: int) -> None:
        """
        Delete own files until others have their reserve, and these and what is used their limit.

        The first file of each cause goes after the others, the newest stays, whatever its size.
        """
        files = self._files()
        free = shutil.disk_usage(self.folder).free
        lacking = max(RESERVE - free, used + sum(map(_size, files)) - self._limit)
        for path in _in_order(files[:-1]) if lacking > 0 else ():
            if lacking > 0:
                lacking -= _size(path)
                path.unlink()
        free = shutil.disk_usage(self.folder).free
        if free < RESERVE:
            raise RecordError(
                f'{self.folder} has {free / _MEGABYTE:.0f} MB free, '
                f'{RESERVE / _MEGABYTE:.0f} MB are left to others: nothing was recorded; '
                'make room')


def _size(path: Path) -> int:
    return path.stat().st_size


def _in_order(files: list[Path]) -> list[Path]:
    """Sort files by when they may go: the first one of each cause after all others."""
    seen: set[str] = set()
    firsts: list[Path] = []
    for path in files:
        kinds = _kinds(path)
        firsts += [path] if kinds - seen else []
        seen |= kinds
    return [*(path for path in files if path not in firsts), *firsts]


def _kinds(path: Path) -> set[str]:
    """Return the causes of a file without their numbers; nothing of one that is damaged."""
    try:
        reasons = metadata_of(path)[SUMMARY]['reasons']
    except Exception:  # damaged bytes raise whatever their decoder does
        return set()
    return set(map(without_numbers, reasons.splitlines()))
