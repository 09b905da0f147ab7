"""Commands `profile`, `backup`, `compare` and `restore`."""

from __future__ import annotations

import re

import pytest
import yaml

from facade_manipulator import config_path
from facade_manipulator.drives.cia402.profile import load_profile
from facade_manipulator.tools.commissioning.drive_profile import draft

EDS = config_path('drives/cia402.eds')
RAMP = (0x6084, 0)


@pytest.fixture
def rig(make_rig):
    return make_rig().configured()


def change(rig, number, key, value):
    with rig.simulator.access() as drives:
        drives[number].objects.write(key, value)


def test_a_backup_and_its_drive_do_not_differ(rig, capsys):
    assert rig.run('backup', 'q1') == 0
    assert rig.run('compare', 'q1', str(rig.folder / 'machine.q1.dcf')) == 0
    assert '0 differences' in capsys.readouterr().out


def test_a_negative_value_comes_back_from_the_file(rig):
    change(rig, 0, (0x607D, 1), -123456)
    rig.run('backup', 'q1')
    assert rig.run('compare', 'q1', str(rig.folder / 'machine.q1.dcf')) == 0


def test_the_object_that_was_tampered_with_is_named(rig, capsys):
    change(rig, 1, RAMP, 77)
    assert rig.run('compare', 'q1', 'q2') == 1
    said = capsys.readouterr().out
    assert '6084h:00' in said and 'Profile deceleration' in said and '1 differences' in said


def test_a_restored_drive_keeps_it_through_a_power_cut(rig, capsys):
    rig.run('backup', 'q1')
    change(rig, 0, RAMP, 77)
    change(rig, 0, (0x1800, 2), 3)
    assert rig.run('restore', 'q1', str(rig.folder / 'machine.q1.dcf')) == 0, capsys.readouterr()
    rig.power_cut()
    assert rig.run('compare', 'q1', str(rig.folder / 'machine.q1.dcf')) == 0


def test_the_backup_of_one_drive_makes_another_like_it_but_for_the_node_id(rig):
    change(rig, 0, RAMP, 77)
    change(rig, 0, (0x1801, 2), 3)
    rig.run('backup', 'q1')
    assert rig.run('restore', 'q2', str(rig.folder / 'machine.q1.dcf')) == 0
    assert rig.run('compare', 'q1', 'q2') == 0
    assert rig.drives[1].objects.values[0x1801, 1] & 0x7F == 2
    assert rig.drives[1].objects.values[RAMP] == 77


def test_a_size_that_differs_from_the_description_is_kept_said_and_restored(rig, capsys):
    eds = rig.folder / 'wrong.eds'
    head, name, rest = EDS.read_text().partition('[6084]')
    eds.write_text(head + name + rest.replace('0x0007', '0x0006', 1))
    change(rig, 0, RAMP, 0x12345)
    assert rig.run('backup', 'q1', '--eds', str(eds)) == 0
    said = capsys.readouterr().out
    assert '6084h:00 (4 bytes)' in said and 'writable objects that wrong.eds names' in said
    change(rig, 0, RAMP, 77)
    dcf = str(rig.folder / 'machine.q1.dcf')
    assert rig.run('restore', 'q1', dcf, '--eds', str(eds)) == 0
    assert rig.drives[0].objects.values[RAMP] == 0x12345


def test_without_the_makers_eds_it_says_that_not_everything_is_kept(rig, capsys):
    rig.run('backup', 'q1')
    said = capsys.readouterr().out
    assert re.search(r'(\d+) of the \1 writable objects that cia402.eds names', said)
    assert 'not kept: give the maker' in said


def test_what_belongs_to_a_place_stays_in_its_drive(rig, capsys):
    data = yaml.safe_load(config_path('drives/simulated.yaml').read_text())
    data.update(eds=str(EDS), of_place=[[0x6084, 0]])
    profile = rig.folder / 'placed.yaml'
    profile.write_text(yaml.safe_dump(data))
    rig.configured(profile=str(profile))
    rig.run('backup', 'q1')
    change(rig, 1, RAMP, 77)
    change(rig, 1, (0x6083, 0), 77)
    assert rig.run('restore', 'q2', str(rig.folder / 'machine.q1.dcf')) == 0
    assert 'q2 keeps what belongs to its place: 6084h:00' in capsys.readouterr().out
    assert rig.drives[1].objects.values[RAMP] == 77 != rig.drives[1].objects.values[0x6083, 0]
    assert rig.run('compare', 'q1', 'q2') == 0


@pytest.mark.parametrize('command', ['backup', 'compare', 'restore'])
def test_a_powered_drive_is_left_alone(rig, capsys, command):
    rig.run('backup', 'q1')
    dcf = str(rig.folder / 'machine.q1.dcf')
    with rig.simulator.access() as drives:
        for word in (6, 7, 15):
            drives[0].objects.write((0x6040, 0), word)
    assert rig.run(command, 'q1', *([] if command == 'backup' else [dcf])) == 1
    assert 'q1 has power (operation enabled): nothing was done' in capsys.readouterr().err
    assert rig.is_enabled()


def test_power_lost_while_storing_says_what_is_known(rig, capsys):
    rig.run('backup', 'q1')
    change(rig, 0, RAMP, 77)
    rig.drives[0].objects.writers[0x1010, 1] = lambda _: rig.drives[0].reboot()
    assert rig.run('restore', 'q1', str(rig.folder / 'machine.q1.dcf')) == 1
    assert 'stopped answering while it stored' in capsys.readouterr().err


def test_a_rejected_write_says_that_nothing_is_stored(rig, capsys, monkeypatch):
    rig.run('backup', 'q1')
    change(rig, 0, RAMP, 77)

    def reject(value):
        from canopen import SdoAbortedError
        raise SdoAbortedError(0x06090030)

    rig.drives[0].objects.writers[RAMP] = reject
    assert rig.run('restore', 'q1', str(rig.folder / 'machine.q1.dcf')) == 1
    said = capsys.readouterr().err
    assert '6084h:00' in said and 'nothing is stored' in said


def test_a_drive_that_stops_answering_says_so(rig, capsys):
    rig.run('backup', 'q1')
    answered = []
    read = rig.drives[0].objects.get_data

    def fall_silent(*arguments, **options):
        answered.append(1)
        rig.drives[0].is_silent = len(answered) > 40
        return read(*arguments, **options)

    rig.drives[0].objects.get_data = fall_silent
    assert rig.run('compare', 'q1', 'q2') == 1
    assert 'does not answer' in capsys.readouterr().err


def test_a_file_of_another_drive_type_is_rejected(rig, capsys):
    rig.run('backup', 'q1')
    path = rig.folder / 'machine.q1.dcf'
    head, section, rest = path.read_text().partition('[1018sub2]')
    path.write_text(head + section + rest.replace('ParameterValue = 0', 'ParameterValue = 9', 1)
                    .replace('ParameterValue=0', 'ParameterValue=9', 1))
    change(rig, 0, RAMP, 77)
    assert rig.run('restore', 'q1', str(path)) == 1
    assert 'another drive type' in capsys.readouterr().err
    assert rig.drives[0].objects.values[RAMP] == 77


@pytest.mark.parametrize('text', ['', 'nonsense', EDS.read_text()[:20000]])
def test_a_file_that_is_no_dcf_is_one_message(rig, capsys, text):
    path = rig.folder / 'bad.dcf'
    path.write_text(text)
    assert rig.run('restore', 'q1', str(path)) == 1
    assert 'bad.dcf' in capsys.readouterr().err


def test_two_drives_with_one_id_are_not_written_to(make_rig, capsys):
    rig = make_rig('--new')
    assert rig.run('backup', 'q1') == 1
    assert '3 drives answer as q1' in capsys.readouterr().err


def test_a_profile_drafted_from_our_own_eds_lacks_nothing(tmp_path):
    text, missing = draft(EDS)
    assert missing == []
    (tmp_path / 'mine.yaml').write_text(text)
    (tmp_path / EDS.name).write_text(EDS.read_text())
    mine, generic = load_profile(str(tmp_path / 'mine.yaml')), load_profile('generic_cia402')
    assert mine.objects == generic.objects


def test_what_an_eds_lacks_is_named(tmp_path):
    text = EDS.read_text().replace('=0x6085\n', '=0x2085\n').replace('[6085]', '[2085]')
    (tmp_path / 'small.eds').write_text(text.replace('[60F4]', '[20F4]').replace(
        '=0x60F4\n', '=0x20F4\n'))
    _, missing = draft(tmp_path / 'small.eds')
    assert missing == ['object 6085h:00 for quick_stop_deceleration', 'object 60F4h in TPDO2']


def test_the_command_drafts_a_profile_that_its_machine_may_name(rig, capsys):
    output = rig.folder / 'mine.yaml'
    assert rig.run('profile', str(EDS), '--output', str(output)) == 0
    said = capsys.readouterr().out
    assert '# ? does it enter NMT Operational by itself' in said
    assert yaml.safe_load(output.read_text())['quirks']['never_follows'] is False
    rig.configured(profile=str(output))
    assert rig.run('profile', '--check') == 0, capsys.readouterr()


def test_a_drive_is_held_against_its_profile_and_every_difference_listed(make_rig, capsys):
    rig = make_rig('--missing-objects', '0x6085', '0x1A01').configured()
    assert rig.run('profile', '--check', 'q2') == 1
    said = capsys.readouterr().out
    assert '6085h:00 cannot be read' in said and '1A01h:00 cannot be read' in said
    assert said.count('!') == 2
