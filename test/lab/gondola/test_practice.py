"""The machine that is made up to practise on, calibrated as the documents say."""

import pytest
import yaml

from facade_manipulator.lab.gondola.practice import main as practise
from facade_manipulator.tools.calibration.__main__ import main as calibrate


@pytest.mark.long
def test_a_made_up_machine_is_calibrated_by_the_commands_of_the_document(tmp_path, capsys):
    poses, folder, target = (str(tmp_path / name) for name in ('poses.csv', 'practice', 'a.yaml'))
    assert calibrate(['geometry', '--plan', poses, '--count', '14']) == 0
    assert practise([poses, '--folder', folder]) == 0
    told = dict(line.split(': ', 1) for line in capsys.readouterr().out.splitlines()
                if line.startswith(('geometry.', 'estimate.')))
    assert calibrate(['geometry', poses, '--output', target]) == 0
    tables = [item for name in ('disturbance', 'joints', 'wall')
              for item in (f'--{name}', f'{folder}/{name}.csv')]
    use = ['--parameters', target, '--output', target]
    assert calibrate(['estimator', *tables, *use]) == 0
    assert calibrate(['wall', f'{folder}/touches.csv', *use]) == 0
    found = yaml.safe_load((tmp_path / 'a.yaml').read_text())
    estimate = found['/**/compensator']['ros__parameters']['estimate']
    for value, true in zip([*estimate['mounting'], estimate['delay']], [
            *yaml.safe_load(told['estimate.mounting']), float(told['estimate.delay'])],
            strict=True):
        assert abs(value - true) < 3e-3


def test_a_plan_that_is_none_is_named(tmp_path, capsys):
    path = tmp_path / 'poses.csv'
    path.write_text('a,b\n1,2\n')
    assert practise([str(path)]) == 1
    assert 'has no column q1; its columns are a, b' in capsys.readouterr().err
    assert practise([str(tmp_path / 'none.csv')]) == 1
