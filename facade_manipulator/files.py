"""Files that appear whole or not at all, whatever happens while they are written."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
import csv
from pathlib import Path


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """
    Lend the path of a draft beside a file; it takes the file's name when the block ends well.

    A draft that is not completed goes; what had the name before stays.
    """
    draft = path.with_name(f'.{path.name}.part')
    try:
        yield draft
        draft.replace(path)
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def write_table(path: Path, header: Iterable[str], rows: Iterable[Iterable]) -> None:
    """Write a CSV file; as `atomic_write`."""
    with atomic_write(path) as draft, draft.open('w', newline='', encoding='utf-8') as file:
        csv.writer(file).writerows([header, *rows])
