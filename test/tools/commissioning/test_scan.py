"""Command `scan`, and the questions that every command asks."""

from __future__ import annotations

import pytest

from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning.operator import Operator


def test_a_scan_lists_the_drives_with_serial_firmware_and_profile(make_rig, capsys):
    rig = make_rig('--serial-numbers', '11', '12', '13', '--firmware-version', '7.3')
    assert rig.run('scan') == 0
    said = capsys.readouterr().out
    for word in ('11', '12', '13', '7.3', 'simulated'):
        assert word in said


def test_a_scan_shows_what_went_wrong_in_a_drive_in_eighty_columns(make_rig, capsys):
    rig = make_rig()
    with rig.simulator.access() as drives:
        for code in (0x7300, 0x8611):
            drives[1].inject_fault(code)
            drives[1].remove_cause()
    rig.run('scan')
    said = capsys.readouterr().out
    assert 'node 2 has had the errors (newest first) 8611h, 7300h' in said
    assert max(len(line) for line in said.splitlines() if '│' in line) <= 80


@pytest.mark.parametrize('ending', ['n', KeyboardInterrupt, EOFError])
def test_a_prompt_shows_what_may_be_answered_and_without_a_yes_nothing_is_done(
        capsys, monkeypatch, ending):
    def answer(*_):
        if ending == 'n':
            return ending
        raise ending

    monkeypatch.setattr('builtins.input', answer)
    with pytest.raises(CommissioningError, match='not done'):
        Operator().agree('The drive is reset.')
    assert 'Do this? [y/N]' in capsys.readouterr().out


def test_a_scan_finds_drives_without_a_node_id(make_rig, capsys):
    assert make_rig('--new', '255').run('scan') == 1
    assert 'a drive without a node id' in capsys.readouterr().out


def test_where_nothing_answers_it_says_what_to_look_at(make_rig, capsys):
    rig = make_rig()
    for drive in rig.drives:
        drive.is_silent = True
    assert rig.run('scan') == 1
    assert 'Nothing answers: power, plugs, termination' in capsys.readouterr().out
