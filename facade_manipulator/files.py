"""Files of the user: complete or absent after an interruption, errors with the path."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path

from facade_manipulator.errors import ParameterError


@contextmanager
def file_errors(path: Path, done: str = 'written') -> Iterator[None]:
    """Raise a ParameterError with the path if the block cannot write, or read, the file."""
    try:
        yield
    except (OSError, UnicodeError) as error:
        raise ParameterError(
            f'{path} cannot be {done}: {getattr(error, "strerror", None) or error}') from error


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """
    Lend the path of a draft, which replaces the file when the block ends without an exception.

    After an exception the previous file stays; after a loss of power one of both is complete.
    Raises a ParameterError with the path if the file cannot be written.
    """
    draft = path.with_name(f'.{path.name}.part')
    with file_errors(path):
        try:
            yield draft
            with draft.open('rb+') as file:
                os.fsync(file.fileno())
            draft.replace(path.resolve())
        finally:
            draft.unlink(missing_ok=True)
