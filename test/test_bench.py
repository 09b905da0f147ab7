import ast
from importlib import import_module
from importlib.util import find_spec
import json
from pathlib import Path
import subprocess
import sys

import pytest

BENCH = Path(__file__).parent / 'bench'
FIELDS = ['name', 'goal_id', 'ours', 'competitor', 'unit', 'ratio', 'goal', 'met']


@pytest.fixture(autouse=True)
def scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))


@pytest.fixture
def table():
    return import_module('table')


@pytest.mark.parametrize('path', [*BENCH.glob('*.py'), *BENCH.parent.glob('[!t]*.py')],
                         ids=lambda path: path.name)
def test_what_a_script_imports_of_the_package_is_there(path):
    """No test runs them, and most of what they need they import where they need it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module.startswith('facade_manipulator'):
            module = import_module(node.module)
            for name in node.names:
                assert hasattr(module, name.name) or find_spec(f'{node.module}.{name.name}')


@pytest.mark.long
def test_a_quick_bench_writes_rows_with_every_field(tmp_path):
    subprocess.run(
        [sys.executable, str(BENCH), '--quick', '--sections', 'kinematics',
         '--output', str(tmp_path)],
        check=True, timeout=300.0, env={'PYTHONPATH': str(BENCH.parents[1])})
    rows = json.loads((tmp_path / 'bench.json').read_text())
    assert all(list(row) == FIELDS for row in rows)
    assert {row['goal_id'] for row in rows} == {'K1'}


@pytest.mark.parametrize(('goal', 'ratio', 'met'), [
    ('>= 50', 100.0, True), ('>= 200', 100.0, False),
    ('<= 0.02', 0.01, True), ('<= 0.001', 0.01, False),
])
def test_a_speed_and_a_cost_are_ratios_of_their_own_sense(table, goal, ratio, met):
    row = table.compare('any', 1e-6, 1e-4, 'us', 'K1', goal)
    assert row.ratio == pytest.approx(ratio)
    assert row.met is met


def test_a_competitor_that_could_not_run_makes_no_row(table):
    assert table.compare('any', 1e-6, None, 'us', 'K1', '>= 1') is None
