"""Files that appear whole or not at all, whatever happens while they are written and after."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import hashlib
import os
from pathlib import Path
import shutil


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """
    Lend the path of a draft beside a file; it takes the file's name when the block ends well.

    A draft that is not completed goes; what had the name before stays. Its mode is kept, and a
    link still leads to it; a file that may not be written is an OSError. When the block has ended
    well, the file outlasts a loss of power.
    """
    path = path.resolve()
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    draft = path.with_name(f'.{path.name}.part')
    try:
        yield draft
        if path.exists():
            shutil.copymode(path, draft)
        sync(draft)
        draft.replace(path)
        sync(path.parent)
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def checksum(content: bytes) -> str:
    """Return eight hexadecimal digits that tell contents apart."""
    return hashlib.sha256(content).hexdigest()[:8]


def sync(path: Path) -> None:
    """Return when the disk has a file, or the names in a folder."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
