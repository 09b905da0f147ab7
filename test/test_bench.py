"""Bench and measurements: they run, and each row has its fields."""

from importlib import import_module
import json
import os
from pathlib import Path
import subprocess
import sys

from measure_control import PARTS
import pytest

BENCH = Path(__file__).parent / 'bench'
FIELDS = ['name', 'ours', 'competitor', 'unit', 'ratio', 'goal', 'met']


@pytest.mark.parametrize(
    'path', sorted(BENCH.glob('[!_]*.py')), ids=lambda path: path.name
)
def test_imports_of_each_script_succeed(path, monkeypatch):
    """No other test imports most of these scripts."""
    monkeypatch.syspath_prepend(str(BENCH))
    if path.stem in ('ros_nodes', 'processes'):
        pytest.importorskip('rclpy')
    import_module(path.stem)


def test_parts_of_the_ablation_exist():
    for part, (owner, name, _) in PARTS.items():
        assert hasattr(owner, name), part


@pytest.mark.long
def test_quick_bench_writes_rows_with_every_field(tmp_path):
    command = [sys.executable, str(BENCH), '--quick', '--sections', 'kinematics']
    environment = os.environ | {'PYTHONPATH': str(BENCH.parents[1])}
    subprocess.run(command, cwd=tmp_path, check=True, timeout=300.0, env=environment)
    found = json.loads((tmp_path / 'bench_report/bench.json').read_text())
    assert all(list(row) == FIELDS for row in found)
    assert len(found) == 4


@pytest.mark.parametrize(
    ('goal', 'ratio', 'met'),
    [
        ('>= 50', 100.0, True),
        ('>= 200', 100.0, False),
        ('<= 0.02', 0.01, True),
        ('<= 0.001', 0.01, False),
    ],
)
def test_bench_ratio_is_compared_with_the_goal(monkeypatch, goal, ratio, met):
    monkeypatch.syspath_prepend(str(BENCH))
    row = import_module('rows').row('any', 'us', goal, 1e-6, 1e-4)
    assert row['ratio'] == pytest.approx(ratio)
    assert row['met'] is met
