"""Each named number of the machine says beside it what it is: its unit, or why it is so."""

from __future__ import annotations

import ast
from itertools import takewhile
from pathlib import Path

import pytest

import facade_manipulator

PACKAGE = Path(facade_manipulator.__file__).parent
MODULES = [path for path in sorted(PACKAGE.rglob('*.py'))
           if path.relative_to(PACKAGE).parts[0] not in ('tools', 'lab')]


def unexplained(source: str) -> list[str]:
    """Return the assignments of numbers without a comment on them or above their block."""
    lines, found = source.splitlines(), []
    for node in ast.parse(source).body:
        numbers = isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value and [
            one for one in ast.walk(node.value)
            if isinstance(one, ast.Constant) and type(one.value) is float]
        above = takewhile(str.strip, reversed(lines[:node.lineno - 1]))
        if numbers and '#' not in ''.join(lines[node.lineno - 1:node.end_lineno]) and not any(
                line.startswith('#') for line in above):
            found.append(f'{node.lineno}: {lines[node.lineno - 1]}')
    return found


@pytest.mark.parametrize('path', MODULES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_every_named_number_says_what_it_is(path):
    assert not unexplained(path.read_text())


@pytest.mark.parametrize(('source', 'count'), [
    ('A = 0.5', 1), ('A = 0.5  # s', 0), ('# s\nA = 0.5', 0), ('# s\n\nA = 0.5', 1),
    ('A: float = 2.0 * 3', 1), ('N = 3', 0)])
def test_a_number_without_a_word_is_found(source, count):
    assert len(unexplained(source)) == count
