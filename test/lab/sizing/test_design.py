"""The command, from a scenario to a machine that its nodes take; and what stops it."""

import csv
import re

import numpy as np
import pytest

from facade_manipulator.drives.cia402 import AxisSettings
from facade_manipulator.kinematics import Geometry, mechanism_of, relative
from facade_manipulator.lab.gondola import Facade, load_scenario
from facade_manipulator.lab.sizing import __main__ as design
from facade_manipulator.lab.sizing.candidates import Candidate, front
from facade_manipulator.lab.sizing.forecast import machine_loop
from facade_manipulator.motion import MotionLimits
from facade_manipulator.parameter_file import ALL_NODES, read_settings

SMALL = ('--link-range', 0.34, 0.36, '--platform-range', 0.33, 0.35, '--designs', 8)
SCENARIO = """
mission: {duration: 12.0}
sway:
  x_amplitude: [0.05]
  x_frequency: [0.2]
  x_phase: [0.3]
"""


def run(*arguments):
    try:
        return design.main([str(argument) for argument in arguments])
    except SystemExit as stop:  # argparse's own way
        return stop.code


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / 'gondola.yaml'
    path.write_text(SCENARIO)
    return path


def table(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


@pytest.mark.long
def test_a_machine_is_found_that_its_own_scenario_does_not_leave(tmp_path, scenario, capsys):
    output = tmp_path / 'report'
    assert run(scenario, *SMALL, '--wall-force', 30, '--output', output) == 0
    assert {path.name for path in output.iterdir()} == {
        'machine.yaml', 'axes.csv', 'front.csv', 'design.png', 'gondola.yaml'}
    machine = output / 'machine.yaml'
    geometry = read_settings([machine], ALL_NODES, 'geometry', Geometry)
    limits = read_settings([machine], 'driver', 'limits', MotionLimits)
    moved, mechanism = load_scenario(str(output / 'gondola.yaml')), mechanism_of(geometry)
    motion = moved.motion()
    for time in np.arange(0.0, 12.0, 0.37).tolist():
        mechanism.certify(relative(motion(time), moved.mission.goal(time)))
    rows = {row['quantity']: [float(row[axis]) for axis in ('q1', 'q2', 'q3')]
            for row in table(output / 'axes.csv')}
    assert max(rows['speed [m/s] peak']) < limits.speed
    assert max(rows['acceleration [m/s2] peak']) < limits.acceleration
    for axis in ('q1', 'q2', 'q3'):
        read_settings([machine], 'driver', axis, AxisSettings)
    assert 'What binds is' in capsys.readouterr().out


def candidate(*costs):
    rail, power, margin, area, ratio = costs
    return Candidate(None, None, rail, power, margin, area, ratio, '')


def test_the_front_has_what_nothing_beats_and_nothing_else():
    best = candidate(0.8, 50.0, 1.5, 0.2, 0.9)
    shorter = candidate(0.7, 100.0, 1.5, 0.2, 0.9)
    worse = candidate(0.8, 50.0, 1.4, 0.2, 0.9)
    assert front([best, worse, shorter]) == [best, shorter]
    assert front([best, best]) == [best, best]
    assert front([]) == []


@pytest.mark.parametrize(('arguments', 'message'), [
    (('--longest-stroke', 0.3), r'shortest rail that the motion takes is 0\.\d+ m, which is above'
                                ' 0.3 m'),
    (('--gap', 0.003), r'would not start: .*geometry.carriage_gap'),
    (('--platform-range', 0.2, 0.21),
     'none of 8 designs reaches all poses with l from 0.34 m to 0.36 m'),
    (('--wall-force', 9000), r'none of \d designs reaches all poses'),
    (('--friction', 9000), r'the best of all motors, gears and screws has a margin of 0\.\d+ '
                             r'\(.* of q\d\), which is below 1.25'),
    (('--margin', 0.5), 'margin = 0.5 is below its minimum 1'),
    (('--head-mass', -1), 'head_mass = -1 kg is below its minimum 0 kg'),
    (('--efficiency', 'nan'), 'efficiency = nan is not a finite number'),
    (('--motors', 'absent.csv'), 'absent.csv cannot be read'),
    (('--mounting', 'glued'), "invalid choice: 'glued'"),
    (('--forecast', '--runs', 0), '--runs 0 is below 1'),
    (('--forecast', 'absent.yaml'), 'absent.yaml cannot be read')])
def test_what_cannot_be_is_told_and_nothing_is_written(
        tmp_path, scenario, capsys, arguments, message):
    output = tmp_path / 'report'
    assert run(scenario, *SMALL, '--output', output, *arguments) == design.BAD_INPUT
    assert not output.exists()
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.long
def test_the_reverse_question_has_a_row_for_each_axis(tmp_path, scenario, capsys):
    output = tmp_path / 'report'
    assert run(scenario, '--forecast', '--runs', 2, '--output', output) == 0
    rows = table(output / 'forecast.csv')
    assert [row['axis'] for row in rows] == ['x', 'y', 'theta']
    for row in rows:
        _, _, moves, left, best, worst, inside = row.values()
        assert 0.0 < float(best) < float(left) < float(worst) < 0.1 * float(moves)
        assert float(inside) == 100.0
    assert 'Expected of manipulator.yaml' in capsys.readouterr().out


@pytest.mark.long
def test_a_machine_that_is_sized_for_a_force_presses_with_it(tmp_path):
    """The gondola is pushed back and swung: the machine must reach that, and be quick enough."""
    output = tmp_path / 'report'
    assert run('pressing', '--link-range', 0.4, 0.55, '--platform-range', 0.35, 0.5,
               '--designs', 20, '--output', output) == 0
    loop = machine_loop(output / 'machine.yaml', load_scenario(str(output / 'pressing.yaml')))
    forces = np.array([Facade.force_on_wall(step.sample.head, step.wrench)
                       for step in loop.mission(36.0)])[2000:]
    assert abs(forces - 30.0).max() < 3.0
    assert not loop.rejections and not loop.follower.brakes


def test_a_scenario_that_is_none_is_told(tmp_path, capsys):
    assert run('hurricane', '--output', tmp_path / 'report') == design.BAD_INPUT
    assert "there is no scenario 'hurricane'" in capsys.readouterr().err
