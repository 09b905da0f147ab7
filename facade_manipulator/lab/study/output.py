"""
Where the study writes: rejected before any work, complete or as it was before.

Work that takes long has a progress bar in a terminal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
import json
import os
from pathlib import Path
import shutil
import sys
import tempfile
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from facade_manipulator.errors import file_errors
from facade_manipulator.files import atomic_write

# columns of words, not of numbers
WORDS = ('objective', 'quantity', 'unit', 'active', 'scenario', 'axis', 'motor', 'screw', 'binds')


def console(width: int) -> Console:
    """Return where tables are shown; so wide [columns] where the output is no terminal."""
    return Console(width=None if sys.stdout.isatty() else width)


def table(
    title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]], caption: str | None = None
) -> Table:
    """Return a table as people read it."""
    # As texts: in plain strings rich would take the units for its markup.
    made = Table(title=Text(title, no_wrap=True, overflow='ignore'), title_justify='left',
                 caption=caption, caption_justify='left')
    for name in columns:
        made.add_column(Text(name), justify='left' if name in WORDS else 'right')
    for row in rows:
        made.add_row(*(Text(str(cell)) for cell in row))
    return made


@contextmanager
def json_file(path: Path) -> Iterator[dict[str, Any]]:
    """
    Lend a dictionary that is written to `path` when the block ends well.

    Raises a ParameterError before the block if the file cannot be written.
    """
    with atomic_write(path) as draft:
        with file_errors(path):
            if path.is_dir():
                raise IsADirectoryError('it is a directory')
            draft.touch()
        content: dict[str, Any] = {}
        yield content
        draft.write_text(json.dumps(content, indent=2, allow_nan=False) + '\n', encoding='utf-8')


@contextmanager
def folder(path: Path) -> Iterator[Path]:
    """
    Lend an empty folder whose files move to `path` when the block ends well.

    Raises a ParameterError before the block if the folder cannot be made or written.
    """
    created = not path.exists()
    with file_errors(path):
        path.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix='.draft.', dir=path))
    try:
        yield draft
        for file in sorted(draft.iterdir()):
            os.replace(file, path / file.name)
        created = False
    finally:
        shutil.rmtree(draft, ignore_errors=True)
        if created:
            path.rmdir()


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Callable[..., None]]:
    """Lend a function that counts steps done, of a known number; the bar is on standard error."""
    console = Console(stderr=True)
    with Progress(
            TextColumn('{task.description}'), BarColumn(), TextColumn('{task.percentage:3.0f} %'),
            TimeRemainingColumn(), console=console, transient=True,
            disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=total)
        yield lambda count=1: bar.advance(task, count)
