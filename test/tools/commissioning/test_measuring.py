"""Commands `direction`, `lead` and `home-switch` against drives with known faults."""

from __future__ import annotations

import pytest
from support import wait_until

from facade_manipulator.tools.commissioning.__main__ import main
from facade_manipulator.tools.commissioning.machine import Machine

UNCOUPLED = ('--links', 'uncoupled')


@pytest.mark.parametrize('count', ['0', '-1'])
def test_no_approach_is_rejected_before_anything_moves(tmp_path, capsys, count):
    assert main(['home-switch', 'q1', '--yes', '--links', 'uncoupled', '--approaches', count,
                 '--interface', 'virtual', '--parameters', str(tmp_path / 'machine.yaml')]) == 1
    assert f'--approaches {count} is not 1 or more' in capsys.readouterr().err


def test_a_carriage_that_nobody_pushes_ends_in_a_message(make_rig, rejected, monkeypatch):
    monkeypatch.setattr('facade_manipulator.tools.commissioning.measuring._PATIENCE', 0.3)
    assert 'counted no 2 mm' in rejected(make_rig().configured().run, 'direction', 'q1')


@pytest.mark.parametrize('measured', ['0', 'nan', '9000', '-10'])
def test_a_measured_distance_that_cannot_be_writes_nothing(make_rig, capsys, measured):
    rig = make_rig().configured()
    before = rig.parameters.read_text()
    assert rig.run('lead', 'q1', *UNCOUPLED, '--travel', '6', '--measured', measured) == 1
    assert 'nothing is written' in capsys.readouterr().err
    assert rig.parameters.read_text() == before


def test_a_home_switch_is_measured_from_ten_approaches(make_rig, capsys):
    rig = make_rig('--start-positions', '0.1', '0.2', '-0.012').configured()
    assert rig.run('home-switch', 'q3', *UNCOUPLED, '--speed', '20', '--approaches', '3') == 0, (
        capsys.readouterr())
    said = capsys.readouterr().out
    assert 'off away from home' in said and 'edge at +6.' in said or 'edge at +7.' in said
    assert 'a spread above 0.1 mm' not in said
    assert Machine(rig.parameters).axis('q3').homing_method == 7


def test_a_switch_that_opens_at_home_is_turned_in_the_drive_and_stored(make_rig, capsys):
    rig = make_rig('--start-positions', '0.1', '0.2', '-0.008', '--home-switch-opens').configured()
    assert rig.run('home-switch', 'q3', *UNCOUPLED, '--speed', '20', '--approaches', '2') == 0, (
        capsys.readouterr())
    rig.power_cut()
    assert rig.drives[2].objects.values[0x3141, 2] == 4
    stored = rig.drives[2].objects.stored
    assert set(stored) == {(0x3141, 2)}  # and none of the limits of this motion


def test_a_switch_that_is_not_there_is_one_message(make_rig, capsys):
    rig = make_rig('--start-positions', '0.1', '0.2', '0.3').configured()
    assert rig.run('home-switch', 'q3', *UNCOUPLED, '--window', '3', '--speed', '20') == 1
    assert 'no change of the home switch within 3 mm' in capsys.readouterr().err
    wait_until(lambda: not rig.is_enabled(2), 'no power')
