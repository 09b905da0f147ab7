"""The results of commissioning in one file; nodes load it after the parameter file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import time
from typing import Any

import yaml

from facade_manipulator.errors import ParameterError
from facade_manipulator.files import atomic_write, file_errors

HEADER = """\
# Written by `commission`; nodes load this file after the parameter file of the machine.
"""
DONE = '# done: '
Sections = Mapping[str, Mapping[str, Any]]


class Overlay:
    """Parameters of the driver, and when each step of commissioning was done."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def steps(self) -> dict[str, str]:
        """Return the time of each step that was done, by the words of its command."""
        lines = [line.removeprefix(DONE).partition(' at ') for line in self._text().splitlines()
                 if line.startswith(DONE)]
        return {step: when for step, _, when in lines}

    def write(self, step: str, sections: Sections) -> None:
        """
        Record a step and set parameters of the driver by section and name; all others stay.

        Raises a ParameterError for a file of another form, or that cannot be written.
        """
        steps = self.steps() | {step: time.strftime('%Y-%m-%d %H:%M')}
        try:
            content = dict(yaml.safe_load(self._text()) or {})
            for section, values in sections.items():
                driver = content.setdefault('/**/driver', {}).setdefault('ros__parameters', {})
                driver.setdefault(section, {}).update(values)
        except (yaml.YAMLError, AttributeError, TypeError, ValueError) as error:
            raise ParameterError(
                f'{self.path} rejected: it is not a parameter file ({error}); next: remove it'
            ) from error
        text = HEADER + ''.join(f'{DONE}{name} at {when}\n' for name, when in steps.items())
        if content:
            text += yaml.safe_dump(content, sort_keys=False)
        with atomic_write(self.path) as draft:
            draft.write_text(text, 'utf-8')

    def _text(self) -> str:
        with file_errors(self.path, 'read'):
            return self.path.read_text('utf-8') if self.path.exists() else ''


def described(sections: Sections) -> str:
    """Return parameters as an operator reads them: ``q2.direction: -1``."""
    return ', '.join(f'{section}.{name}: {value}' for section, values in sections.items()
                     for name, value in values.items())
