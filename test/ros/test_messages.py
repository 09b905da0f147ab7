"""What the nodes say and what docs/operation.md says about it are the same."""

from __future__ import annotations

import ast
from pathlib import Path
import re

import pytest
from support import nodes

import facade_manipulator
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.following import HOLDS
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import LimitError

PACKAGE = Path(facade_manipulator.__file__).parent
OPERATION = PACKAGE.parent / 'docs' / 'operation.md'
OF_THE_GROUP_ALONE = {'holding', 'coming to rest', 'stopping'}
OF_A_STOP = ('Cause', '_lose_position', '_supervised', '_stop_drives', '_forbid')

if not OPERATION.is_file():
    pytest.skip('the documents stand in the source tree alone', allow_module_level=True)


def text(node: ast.expr) -> str:
    """Return a literal string with … for what is formatted into it, '' for anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return ''.join(text(part) or '…' for part in node.values)
    return ''


def first_arguments(*names: str) -> set[str]:
    """Return the first argument of every call of a function in the package, if it is literal."""
    found = set()
    tool = set((PACKAGE / 'tools' / 'commissioning').glob('*.py'))
    for path in set(PACKAGE.rglob('*.py')) - tool:
        if not any(name in path.read_text() for name in names):
            continue
        for node in nodes(path):
            if isinstance(node, ast.Call) and node.args:
                called = getattr(node.func, 'id', getattr(node.func, 'attr', ''))
                if called in names:
                    found.add(text(node.args[0]))
    return {item for item in found if item.strip('…: ')}


def may_be(said: str, codes: set[str]) -> set[str]:
    """Return what a document quotes that a text of the source may be or contain."""
    found = {code for code in codes if code in said}
    if len(said.strip('… ')) > 8 and len(said.replace('…', '')) <= max(map(len, codes)):
        pattern = re.compile('.*'.join(map(re.escape, said.split('…'))))
        found |= {code for code in codes if pattern.search(code)}
    return found


def table(after: str) -> list[str]:
    """Return the code of the first column of the document's table after a phrase."""
    rest = OPERATION.read_text().split(after, 1)[1]
    rows = re.search(r'\n\n\|.*\n\|[-|]+\n((?:\|.*\n)+)', rest).group(1).splitlines()
    return [code for row in rows for code in re.findall('`([^`]+)`', row.split('|')[1])]


def subclasses(kind: type) -> set[type]:
    return {kind}.union(*(subclasses(child) for child in kind.__subclasses__()))


def test_every_reason_of_a_rejection_is_documented_and_no_other():
    reasons = first_arguments('InputError')
    reasons |= {kind.reason for kind in subclasses(LimitError) - {LimitError}}
    reasons |= {state.value for state in ControllerState} - {'active', *OF_THE_GROUP_ALONE}
    documented = table('## Rejected messages')
    assert len(documented) == len(set(documented))
    assert set(documented) == reasons | {'other'}


def test_every_cause_of_a_stop_is_documented_and_no_other():
    causes = first_arguments(*OF_A_STOP)
    documented = {code for code in table('## Stopped drives') if not re.match(r'\d{4}h', code)}
    assert len(causes) > 8
    missing = {cause for cause in causes if not any(code in cause for code in documented)}
    assert not missing
    said = {text(node) for path in PACKAGE.rglob('*.py')
            for node in nodes(path)}
    assert documented == set().union(*(may_be(one, documented) for one in said))


def test_everything_that_keeps_the_compensator_from_compensating_is_documented():
    assert set(table('## Not compensating')) == (
        {mode.value for mode in CorrectionMode} - {'compensating'} | set(HOLDS))
