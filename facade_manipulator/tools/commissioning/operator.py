"""The person at the terminal: what is said, what is asked, what is agreed to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from facade_manipulator.errors import CommissioningError


class Operator:
    """Somebody who stands at the machine; with `agrees` every answer is yes, unattended."""

    def __init__(self, agrees: bool = False) -> None:
        self.agrees = agrees
        self._console = Console(highlight=False, markup=False, soft_wrap=True)
        if not self._console.is_terminal:
            self._console.width = 80

    def say(self, text: str = '') -> None:
        """Print a line."""
        self._console.print(text)

    def table(self, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        """Print a table; None is an empty cell."""
        table = Table(*columns)
        for row in rows:
            table.add_row(*('' if cell is None else str(cell) for cell in row))
        self._console.print(table)

    def agree(self, action: str) -> None:
        """Say what will be done and wait for a yes; a CommissioningError for another answer."""
        self.say(action)
        if self.agrees:
            return
        try:
            answer = self._answer('Do this? [y/N] ')
        except KeyboardInterrupt:
            answer = 'no'
        if answer.lower() not in ('y', 'yes'):
            raise CommissioningError('not done, nothing is changed: the answer was not yes')

    def ask(self, question: str, option: str) -> str:
        """
        Ask for what only somebody at the machine knows.

        Raises a CommissioningError if nobody is there: `option` gives it.
        """
        if self.agrees:
            raise CommissioningError(f'{question} Nobody is asked with --yes: give {option}')
        return self._answer(f'{question} ')

    def _answer(self, question: str) -> str:
        try:
            return self._console.input(question, markup=False).strip()
        except EOFError:
            raise CommissioningError(
                'not done: nobody answers here; give the answers as options, see --help') from None
