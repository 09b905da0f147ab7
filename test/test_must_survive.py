"""Tests that docs/design.md names for the behaviour that must survive exist."""

from pathlib import Path
import re

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
ROW = re.compile(r'^\| (\d+) \|.*\| (`test/.*`) \|$', re.MULTILINE)
ROWS = dict(ROW.findall((CHECKOUT / 'docs/design.md').read_text()))


def test_table_has_seventeen_sentences_with_tests():
    assert [*ROWS] == [str(number) for number in range(1, 18)]


@pytest.mark.parametrize('number', ROWS)
def test_named_tests_exist(number):
    for name in re.findall(r'`(.*?)`', ROWS[number]):
        file, _, function = name.partition('::')
        assert f'def {function}(' in (CHECKOUT / file).read_text(), name
