"""Commands `scan` and `assign`."""

from __future__ import annotations

import os

import can
from commission_rig import SERIALS
import pytest
import yaml

from facade_manipulator.tools.commissioning.bitrate import find_bitrate
from facade_manipulator.tools.commissioning.machine import Machine

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
    assert 'q2 (node 2 in the parameter file) is silent' in said


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


def test_without_a_yes_nothing_is_done(make_rig, capsys, monkeypatch):
    rig = make_rig('--new')
    monkeypatch.setattr('builtins.input', lambda *_: 'n')
    assert rig.run(*ASSIGN, yes=False) == 1
    assert 'nothing is changed' in capsys.readouterr().err
    assert {drive.node_id for drive in rig.drives} == {1}


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
