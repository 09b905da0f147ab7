"""A progress bar that appears only when the work takes longer than a second."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import time

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

PATIENCE = 1.0  # s before the bar appears


@contextmanager
def progress_bar(title: str, total: int) -> Iterator[Callable[[int], None]]:
    """Lend a function that counts steps done, of a known number; the bar is on standard error."""
    console = Console(stderr=True)
    bar = Progress(
        TextColumn('{task.description}'), BarColumn(), TextColumn('{task.percentage:3.0f} %'),
        TimeRemainingColumn(), console=console, transient=True, disable=not console.is_terminal)
    task, begun = bar.add_task(title, total=total), time.monotonic()

    def tick(count: int = 1) -> None:
        bar.advance(task, count)
        if time.monotonic() - begun > PATIENCE:
            bar.start()

    try:
        yield tick
    finally:
        if bar.live.is_started:
            bar.stop()
