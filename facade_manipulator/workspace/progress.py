"""A progress bar that appears only when the work takes longer than a second."""

from __future__ import annotations

import time
from types import TracebackType

PATIENCE = 1.0  # s before the bar appears


class ProgressBar:
    """
    Progress of a known number of steps, on standard error.

    Parameters
    ----------
    title : str
        What is being done.
    total : int
        Number of steps.

    """

    def __init__(self, title: str, total: int) -> None:
        self._title, self._total, self._done = title, total, 0
        self._begun = time.monotonic()
        self._bar = None

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def tick(self, count: int = 1) -> None:
        """Count steps done."""
        self._done += count
        if self._bar is None and time.monotonic() - self._begun > PATIENCE:
            self._show()
        if self._bar is not None:
            self._bar.update(self._task, completed=min(self._done, self._total))

    def _show(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        console = Console(stderr=True)
        self._bar = Progress(
            TextColumn('{task.description}'), BarColumn(), TextColumn('{task.percentage:3.0f} %'),
            TimeRemainingColumn(), console=console, transient=True,
            disable=not console.is_terminal)
        self._task = self._bar.add_task(self._title, total=self._total)
        self._bar.start()
