"""Commands `scan` and `assign`."""

from __future__ import annotations

from contextlib import nullcontext
import os

import can
from commission_rig import SERIALS
import pytest
import yaml

from facade_manipulator.drives.canopen import BusSettings
from facade_manipulator.errors import CommissioningError
from facade_manipulator.tools.commissioning import bitrate
from facade_manipulator.tools.commissioning.bitrate import find_bitrate
from facade_manipulator.tools.commissioning.machine import Machine
from facade_manipulator.tools.commissioning.operator import Operator

FAST = ('--lss-timeout', '0.15')
ASSIGN = ('assign', *FAST, '--serials', *map(str, SERIALS))


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


@pytest.mark.parametrize('frame', [
    (0x77F, b'\x05'), (0x80, b''), (0x000, b'\x80\x09'), (0x202, bytes(7)), (0x602, bytes(8))])
def test_no_command_works_beside_a_driver(make_rig, capsys, frame):
    rig = make_rig('--new')
    with can.Bus(interface='virtual', channel=rig.channel) as driver:
        task = driver.send_periodic(
            can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False), 0.05)
        assert rig.run(*ASSIGN) == 1
        task.stop()
    assert 'a driver runs on this bus' in capsys.readouterr().err
    assert not rig.parameters.exists()
    assert {drive.lss.stored for drive in rig.drives} == {1}


@pytest.mark.parametrize('new', ['1', '255'])
def test_new_drives_get_the_node_ids_of_their_carriages(make_rig, capsys, new):
    rig = make_rig('--new', new)
    shuffled = (SERIALS[2], SERIALS[0], SERIALS[1])
    assert rig.run('assign', *FAST, '--serials', *map(str, shuffled)) == 0, capsys.readouterr().err
    rig.power_cut()
    assert [drive.node_id for drive in rig.drives] == [2, 3, 1]
    axes = Machine(rig.parameters).axes
    assert [(axis.node_id, axis.serial_number) for axis in axes.values()] == list(
        zip((1, 2, 3), shuffled, strict=True))
    assert '# CANopen; every new drive is 1' in rig.parameters.read_text()
    assert rig.run('scan') == 0


def test_one_drive_alone_needs_no_fastscan(make_rig):
    rig = make_rig('--new', '--node-ids', '1', '--serial-numbers', '99', '--start-positions', '0')
    assert rig.run('assign', *FAST, '--only', 'q3') == 0
    assert rig.drives[0].lss.stored == 3
    assert Machine(rig.parameters).axis('q3').serial_number == 99


def test_only_wants_one_drive_alone(make_rig, capsys):
    rig = make_rig('--new')
    assert rig.run('assign', *FAST, '--only', 'q3') == 1
    assert 'found 3' in capsys.readouterr().err
    assert {drive.lss.stored for drive in rig.drives} == {1}


def test_drives_without_lss_are_left_to_the_makers_tool(make_rig, capsys):
    rig = make_rig('--new')
    for drive in rig.drives:
        drive.lss.receive = lambda data, active: None
    assert rig.run(*ASSIGN) == 1
    assert "in the maker's tool" in capsys.readouterr().err


def test_a_drive_that_stops_answering_in_the_middle_is_one_message(make_rig, capsys):
    rig = make_rig('--new')
    last = rig.drives[2]
    receive = last.lss.receive
    last.lss.receive = lambda data, active: None if data[0] == 0x17 else receive(data, active)
    assert rig.run(*ASSIGN) == 1
    said = capsys.readouterr().err
    assert 'did not store it' in said and 'serial number 4711' in said
    assert last.lss.stored == 1


def test_a_serial_number_that_is_not_there_names_the_axis(make_rig, capsys):
    rig = make_rig('--new')
    assert rig.run('assign', *FAST, '--serials', '4711', '4712', '1') == 1
    assert 'no drive was found for q3' in capsys.readouterr().err


@pytest.mark.parametrize('text', ['[', 'just words', '/**/driver: {ros__parameters: 3}',
                                  '/**/driver: {ros__parameters: {q1: {node_id: 900}}}',
                                  '/**/driver: {ros__parameters: {q1: {nodeid: 1}}}'])
def test_a_parameter_file_that_is_none_stops_before_anything_is_done(make_rig, capsys, text):
    rig = make_rig('--new')
    rig.parameters.write_text(text)
    assert rig.run(*ASSIGN) == 1
    assert str(rig.parameters) in capsys.readouterr().err
    assert rig.parameters.read_text() == text
    assert {drive.lss.stored for drive in rig.drives} == {1}


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_a_protected_folder_stops_before_anything_is_done(make_rig, capsys):
    rig = make_rig('--new')
    rig.folder.chmod(0o500)
    try:
        assert rig.run(*ASSIGN) == 1
    finally:
        rig.folder.chmod(0o700)
    assert 'cannot be written' in capsys.readouterr().err


def test_a_file_that_cannot_be_written_in_the_end_leaves_the_lines_to_write(
        make_rig, capsys, monkeypatch):
    rig = make_rig('--new')
    rig.parameters.mkdir()
    assert rig.run(*ASSIGN) == 1
    assert str(rig.parameters) in capsys.readouterr().err


@pytest.mark.parametrize('at', [0, 1, 2, 3])
def test_ctrl_c_at_any_prompt_of_assign_leaves_the_stored_ids_and_says_so(
        make_rig, capsys, monkeypatch, at):
    rig, asked = make_rig('--new'), []

    def answer(*_):
        asked.append('')
        if len(asked) > at:
            raise KeyboardInterrupt
        return ('y', 'q1', 'q2')[len(asked) - 1]

    monkeypatch.setattr('builtins.input', answer)
    assert rig.run('assign', *FAST, yes=False) == 1
    assert ('nothing is changed', 'stopped by Ctrl-C. No drive has stored a new',
            'Ctrl-C. q1 is node 1 (serial', 'q2 is node 2 (serial')[at] in capsys.readouterr().err
    assert sorted(drive.lss.stored for drive in rig.drives) == [[1, 1, 1], [1, 1, 1], [1, 1, 1],
                                                                [1, 1, 2]][at]
    assert not rig.parameters.exists()


def test_the_journal_keeps_what_was_done(make_rig):
    rig = make_rig('--new')
    rig.run('scan')
    rig.run(*ASSIGN)
    entries = yaml.safe_load((rig.folder / 'machine.journal.yaml').read_text())
    assert [entry['check'] for entry in entries] == ['scan', 'written', *['assign'] * 3]


def test_the_bit_rate_is_where_frames_come_without_errors():
    tried = []
    answers = {1_000_000: (0, 5), 500_000: (3, 1), 250_000: (4, 0), 125_000: (0, 0)}
    assert find_bitrate('can0', lambda *settings: tried.append(settings),
                        lambda channel: answers[tried[-1][1]]) == 250_000
    assert all(settings[2] for settings in tried)


def test_no_bit_rate_is_found_in_silence():
    assert find_bitrate('can0', lambda *settings: None, lambda channel: (0, 0)) is None
