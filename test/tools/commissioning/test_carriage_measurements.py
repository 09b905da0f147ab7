"""Commands `direction`, `jog`, `lead`, `home-switch` and `lag` on drives with known faults."""

import numpy as np
import pytest
from tools.commissioning.rig import own_profile

from facade_manipulator.kinematics.geometry import AXIS_NAMES

pytestmark = pytest.mark.long


@pytest.mark.parametrize('direction', [1, -1])
def test_direction_is_positive_for_a_push_to_the_right(make_rig, direction):
    rig = make_rig('--directions', '1', str(direction), '1').configured()
    rig.push(1, 2.0)
    assert rig.run('direction', 'q2') == 0
    assert rig.parameters['q2.direction'] == direction


def test_direction_without_a_push_times_out(rig, rejected):
    assert 'q1 did not move by 2 mm within 120 s' in rejected('direction', 'q1')


@pytest.mark.parametrize('back', [0.01, 0.02])  # m, to its start and beyond
def test_carriage_that_rolls_back_gets_no_direction(rig, rejected, back):
    rig.overlay.write('direction q2', {}, is_done=False)
    rig.push(1, 2.0)
    motor = rig.drives[1].motor
    rig.later(2.4, lambda: motor.place(motor.carriage_position - back))
    assert 'push of q2 rejected: the carriage moved back' in rejected('direction', 'q2')
    assert 'q2.direction' not in rig.parameters
    assert 'direction q2' not in rig.overlay.steps()


@pytest.mark.parametrize('axis', AXIS_NAMES)
def test_motion_requires_all_directions(make_rig, rejected, axis):
    rig = make_rig().configured(is_moving=False)
    for other in {*AXIS_NAMES} - {axis}:
        rig.overlay.write(f'direction {other}', {})
    assert f'next: commission direction {axis}' in rejected('jog', 'q1', '20')


def test_jog_moves_all_carriages_equally(rig):
    before = rig.places
    assert rig.run('jog', 'q2', '-5') == 0
    moved = np.subtract(rig.places, before)
    assert moved == pytest.approx([-0.005] * 3, abs=1e-4)
    assert not rig.is_powered
    assert 'jog q2' in rig.overlay.steps()


def test_jog_of_one_carriage_keeps_the_others_still(rig):
    before = rig.places
    rig.run('jog', 'q2', '5', '--alone')
    expected = [before[0], before[1] + 0.005, before[2]]
    assert rig.places == pytest.approx(expected, abs=1e-4)


def test_jog_with_an_encoder_beyond_10_m_moves(rig):
    motor = rig.drives[0].motor  # a multi-turn encoder keeps its position without power
    motor.count_from_here = lambda: None
    motor.offset += 12.0 * motor.counts_per_metre
    assert rig.run('jog', 'q1', '5') == 0
    assert rig.places[0] == pytest.approx(-0.095, abs=1e-4)


@pytest.mark.parametrize(
    'words',
    [
        ('jog', 'q1', '201'),
        ('jog', 'q1', '0'),
        ('jog', 'q1', 'nan'),
        ('jog', 'q1', '20', '--speed', '51'),
        ('jog', 'q1', '20', '--speed', '0.4'),
        ('lead', 'q1', '--travel', '300'),
    ],
)
def test_motion_beyond_its_bounds_is_rejected(rig, capsys, words):
    with pytest.raises(SystemExit):
        rig.run(*words)
    assert 'not between' in capsys.readouterr().err
    assert not rig.is_powered


def test_lead_is_corrected_by_the_ruler(rig):
    rig.answers['on the ruler'] = '3,0 mm'
    assert rig.run('lead', 'q3', '--travel', '6', yes=False) == 0
    assert rig.parameters['q3.lead'] == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize('measured', ['-3,0', '-3.0', '-3', '-3,0mm', '-3mm', '-3 mm'])
def test_negative_ruler_distance_is_read_as_option(rig, measured):
    assert rig.run('lead', 'q3', '--travel', '-6,0', '--measured', measured) == 0
    assert rig.parameters['q3.lead'] == pytest.approx(0.01, rel=1e-3)


def test_distance_with_decimal_comma_is_moved(rig):
    before = rig.places
    assert rig.run('jog', 'q2', '-2,5', '--speed', '12,5') == 0
    assert np.subtract(rig.places, before) == pytest.approx([-0.0025] * 3, abs=1e-4)


@pytest.mark.parametrize('measured', ['0', 'nan', '9000', '-10', 'much'])
def test_impossible_ruler_distance_is_rejected(rig, rejected, measured):
    said = rejected('lead', 'q1', '--travel', '6', '--measured', measured)
    assert f'{measured} mm rejected' in said
    assert 'q1.lead' not in rig.parameters


def test_home_switch_is_found_and_its_method_written(make_rig, capsys):
    rig = make_rig('--start-positions', '0.1', '0.2', '-0.012').configured()
    assert rig.run('home-switch', 'q3', '--speed', '20', '--approaches', '2') == 0
    said = capsys.readouterr().out
    assert 'q3: edge at +7.' in said
    assert 'spread is above' not in said
    assert rig.parameters['q3.homing_method'] == 7
    assert 'method 7 homes at an index pulse, at most 4.7 mm' in said


def test_home_switch_method_without_index_pulse_is_preferred(
    make_rig, tmp_path, capsys
):
    profile = own_profile(tmp_path, homing_methods=[37, 23, 7])
    rig = make_rig('--start-positions', '0.1', '0.2', '-0.012').configured(profile)
    assert rig.run('home-switch', 'q3', '--speed', '20', '--approaches', '1') == 0
    assert rig.parameters['q3.homing_method'] == 23
    assert 'index pulse' not in capsys.readouterr().out


@pytest.mark.parametrize('method', [11, 12])
def test_index_pulse_method_of_a_lower_switch_is_announced(
    make_rig, tmp_path, capsys, method
):
    profile = own_profile(tmp_path, homing_methods=[37, method])
    rig = make_rig(
        '--start-positions', '0.1', '0.2', '-0.002', '--home-switch-opens'
    ).configured(profile)
    command = 'home-switch', 'q3', '--towards', '-', '--speed', '20'
    assert rig.run(*command, '--approaches', '1') == 0
    assert f'method {method} homes at an index pulse' in capsys.readouterr().out


def test_switch_that_is_on_at_start_is_rejected(make_rig, rejected):
    rig = make_rig(
        '--start-positions', '0.1', '0.2', '-0.008', '--home-switch-opens'
    ).configured()
    assert 'invert its input' in rejected(
        'home-switch', 'q3', '--speed', '20', '--approaches', '1'
    )
    assert 'q3.homing_method' not in rig.parameters


def test_missing_home_switch_is_rejected_with_power_off(make_rig, rejected):
    rig = make_rig('--start-positions', '0.1', '0.2', '0.3').configured()
    assert 'no change of the home switch within 3 mm' in rejected(
        'home-switch', 'q3', '--window', '3', '--speed', '20'
    )
    assert not rig.is_powered


@pytest.mark.parametrize('rate', [100, 500])
def test_measured_lag_equals_that_of_the_drives(make_rig, capsys, rate):
    rig = make_rig('--lag', '0.012').configured(**{'controller.rate': rate})
    rig.drives[2].motor.lag = 0.016
    assert rig.run('lag') == 0
    assert rig.parameters['controller.drive_lag'] == pytest.approx(0.0133, abs=0.001)
    assert '! q3: its lag differs by' in capsys.readouterr().out
