"""The folder of the files: named by number and time, whole or not there, bounded in size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re
import shutil
import time

from facade_manipulator.errors import RecordError
from facade_manipulator.files import atomic_write

_NAME = re.compile(r'blackbox_(\d{6})_\w+\.mcap')
_MEGABYTE = 1_000_000
RESERVE = 50 * _MEGABYTE  # byte of free space that are left to the rest of the machine


class Shelf:
    """
    Write files into a folder and delete the oldest.

    They are numbered, since a clock that starts in 1970 would make the newest look oldest. In
    `folder` ``~`` is the user's home; `limit` is space for all files together [MB].
    """

    def __init__(self, folder: str, limit: float) -> None:
        self.folder = Path(folder).expanduser()
        self._limit = limit * _MEGABYTE

    def write(self, stamp: float, write: Callable[[Path], None]) -> Path:
        """
        Let `write` fill a file of this time [s]; return its path.

        Raises a RecordError that names the folder, what the system says, and what is free.
        """
        label = time.strftime('%Y%m%dT%H%M%SZ', time.gmtime(stamp))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            free = shutil.disk_usage(self.folder).free
            if free < RESERVE:
                raise RecordError(
                    f'{self.folder} has {free / _MEGABYTE:.0f} MB free, '
                    f'{RESERVE / _MEGABYTE:.0f} MB are left to others: nothing was recorded; '
                    'make room')
            number = max((int(_NAME.fullmatch(path.name)[1]) for path in self._files()),
                         default=0) + 1
            path = self.folder / f'blackbox_{number:06}_{label}.mcap'
            with atomic_write(path) as draft:
                write(draft)
            self._drop_oldest()
        except OSError as error:
            raise RecordError(
                f'{self.folder}: nothing was recorded: {error.strerror or error}') from error
        return path

    def _files(self) -> list[Path]:
        return sorted(path for path in self.folder.glob('blackbox_*.mcap')
                      if _NAME.fullmatch(path.name))

    def _drop_oldest(self) -> None:
        """Delete the oldest files beyond the limit; the newest stays, whatever its size."""
        room = self._limit
        for age, path in enumerate(reversed(self._files())):
            room -= path.stat().st_size
            if age and room < 0:
                path.unlink()
