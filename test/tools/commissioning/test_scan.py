"""Command `scan`, and the questions that every command asks."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from facade_manipulator.drives.canopen import BusSettings
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning import bitrate
from facade_manipulator.tools.commissioning.bitrate import find_bitrate
from facade_manipulator.tools.commissioning.operator import Operator


def test_a_scan_lists_the_drives_with_serial_firmware_and_profile(make_rig, capsys):
    rig = make_rig('--serial-numbers', '11', '12', '13', '--firmware-version', '7.3')
    assert rig.run('scan') == 0
    said = capsys.readouterr().out
    for word in ('11', '12', '13', '7.3', 'simulated'):
        assert word in said


def test_a_scan_names_duplicates_and_silent_nodes(make_rig, capsys):
    rig = make_rig('--new')
    assert rig.run('scan') == 1
    said = capsys.readouterr().out
    assert '3 drives have node id 1 (serial numbers 4711, 4712, 4713)' in said
    assert 'q2 (node 2 in the parameter file) is silent: commission assign' in said


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


@pytest.mark.parametrize('ending', [None, KeyboardInterrupt])
def test_whatever_ends_the_search_for_a_bit_rate_the_interface_is_as_before(monkeypatch, ending):
    def count(_):
        if ending:
            raise ending
        return 0, 0

    links = []
    monkeypatch.setattr(bitrate, 'set_link', lambda *link, **mode: links.append((link, mode)))
    monkeypatch.setattr(bitrate, 'count_frames', count)
    with pytest.raises(KeyboardInterrupt) if ending else nullcontext():
        bitrate.guess_bitrate(BusSettings(interface='socketcan', channel='can7'), Operator(True),
                              may_change=True)
    assert links[-1] == (('can7', 1_000_000), {'listen_only': False})


def test_a_scan_finds_drives_without_a_node_id(make_rig, capsys):
    assert make_rig('--new', '255').run('scan') == 1
    assert 'a drive without a node id' in capsys.readouterr().out


def test_the_bit_rate_is_where_frames_come_without_errors():
    tried = []
    answers = {1_000_000: (0, 5), 500_000: (3, 1), 250_000: (4, 0), 125_000: (0, 0)}
    assert find_bitrate('can0', lambda *settings: tried.append(settings),
                        lambda channel: answers[tried[-1][1]]) == 250_000
    assert all(settings[2] for settings in tried)


def test_no_bit_rate_is_found_in_silence():
    assert find_bitrate('can0', lambda *settings: None, lambda channel: (0, 0)) is None
