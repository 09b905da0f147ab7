"""Commands `object`, `identify` and `replace`, and `commission` without a command."""

from __future__ import annotations

import pytest
import yaml

from facade_manipulator import config_path
from facade_manipulator.simulation.drives.drive import SimulatedIdentity
from facade_manipulator.tools.commissioning.machine import Machine

RAMP, EDS = (0x6084, 0), config_path('drives/cia402.eds')
FAST = ('--lss-timeout', '0.15')


@pytest.fixture
def rig(make_rig):
    return make_rig('--serial-numbers', '11', '12', '13').configured(
        **{name: {'serial_number': 11 + number} for number, name in enumerate(('q1', 'q2', 'q3'))})


@pytest.mark.parametrize('name', ['6084h', '0x6084', '6084:00', 'profile deceleration'])
def test_an_object_is_shown_by_index_or_name_and_written_as_it_reads_back(rig, capsys, name):
    assert rig.run('object', 'q2', name) == 0
    assert 'q2: 6084h:00 Profile deceleration = 100000 (186A0h)' in capsys.readouterr().out
    assert rig.run('object', 'q2', name, '4Dh') == 0
    assert 'becomes 4Dh until the power is off' in capsys.readouterr().out
    assert [drive.objects.values[RAMP] for drive in rig.drives] == [100000, 77, 100000]


@pytest.mark.parametrize('words, reason', [
    (('6040h', '15'), 'Controlword is not a setting'), (('6084h', 'much'), 'has 4 bytes, which'),
    (('6084h', '4294967296'), 'has 4 bytes'), (('profile',), 'objects of the EDS, '),
    (('5FFFh',), 'names 0 objects of the EDS: give'),
])
def test_what_is_not_a_setting_or_not_one_object_is_not_written(rig, rejected, words, reason):
    assert reason in rejected(rig.run, 'object', 'q1', *words)
    assert rig.drives[0].objects.values[RAMP] == 100000 and not rig.is_enabled()


def test_a_drive_blinks_until_somebody_has_seen_it(rig, rejected, monkeypatch):
    assert 'look for the serial number 12' in rejected(rig.run, 'identify', 'q2')
    profile = rig.folder / 'lamp.yaml'
    data = yaml.safe_load(config_path('drives/simulated.yaml').read_text())
    profile.write_text(yaml.safe_dump(data | {'eds': str(EDS), 'blinks': [[0x6098, 0]]}))
    rig.configured(profile=str(profile))
    seen = []

    def look(*_):
        seen.append([drive.objects.values[0x6098, 0] for drive in rig.drives])
        raise KeyboardInterrupt

    before = rig.drives[0].objects.values[0x6098, 0]
    monkeypatch.setattr('builtins.input', look)
    assert rig.run('identify', 'q2', yes=False) == 130
    assert seen == [[before, 1, before]] and rig.drives[1].objects.values[0x6098, 0] == 0


def test_a_new_drive_gets_id_objects_and_checks_of_the_one_before(rig, capsys):
    with rig.simulator.access() as drives:
        drives[1].objects.write(RAMP, 77)
    assert rig.run('replace', 'q2', *FAST) == 1 and 'machine.q2.dcf' in capsys.readouterr().err
    rig.run('backup', 'q2')
    with rig.simulator.access() as drives:  # from the box, as all new drives are
        drives[1].set_identity(SimulatedIdentity(serial_number=99))
        drives[1].lss.stored = 1
        drives[1].reboot()
    assert rig.run('replace', 'q2', *FAST) == 0, capsys.readouterr()
    assert 'next: commission direction q2, then commission jog q2' in capsys.readouterr().out
    rig.power_cut()
    assert [drive.node_id for drive in rig.drives] == [1, 2, 3]
    assert rig.drives[1].objects.values[RAMP] == 77
    machine = Machine(rig.parameters)
    assert [axis.serial_number for axis in machine.axes.values()] == [11, 99, 13]


@pytest.mark.parametrize('words', [
    ('profile', '--check', 'q1'), ('backup', 'q1'), ('compare', 'q1', 'q2'), ('direction', 'q1'),
    ('restore', 'q1', 'kept.dcf'), ('object', 'q1', '6084h', '5'), ('replace', 'q1', *FAST),
    ('assign', '--only', 'q1', *FAST), ('jog', 'q1', '--links', 'uncoupled'),
    ('lead', 'q1', '--links', 'uncoupled'), ('home-switch', 'q1', '--links', 'uncoupled'),
    ('lag', 'q1', '--links', 'uncoupled')])
def test_with_the_drive_unplugged_each_step_is_one_message_and_writes_nothing(
        rig, capsys, monkeypatch, words):
    monkeypatch.chdir(rig.folder)
    for name in ('kept.dcf', 'machine.q1.dcf'):
        rig.run('backup', 'q1', name)
    before = rig.parameters.read_text()
    rig.drives[0].is_silent = True
    capsys.readouterr()
    assert rig.run(*words) == 1
    said = capsys.readouterr().err
    assert 'q1' in said or 'node 1' in said or '--only wants one drive' in said
    assert said.count('\n') == 1 and 'Traceback' not in said
    assert rig.parameters.read_text() == before
