"""Commands `profile`, `backup`, `compare` and `restore`."""

from __future__ import annotations

import _thread
import re
import signal
import time

from canopen import SdoAbortedError
import pytest
import yaml

from facade_manipulator import config_path
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.tools.commissioning import keep
from facade_manipulator.tools.commissioning.drive_profile import draft

EDS = config_path('drives/cia402.eds')
RAMP = (0x6084, 0)


@pytest.fixture
def rig(make_rig):
    return make_rig().configured()


def change(rig, number, key, value):
    with rig.simulator.access() as drives:
        drives[number].objects.write(key, value)


def test_a_negative_value_comes_back_from_the_file(rig):
    change(rig, 0, (0x607D, 1), -123456)
    rig.run('backup', 'q1')
    assert rig.run('compare', 'q1', str(rig.folder / 'machine.q1.dcf')) == 0


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


def aborted(*_):
    raise SdoAbortedError(0x06090030)


def ctrl_c(*_):
    raise KeyboardInterrupt


def interrupted(*_):
    _thread.interrupt_main()
    time.sleep(0.2)


@pytest.mark.parametrize(('key', 'act', 'reason'), [
    (RAMP, aborted, 'Written to q1: 6083h:00, 6084h:00. Nothing is stored: it has its old'),
    (RAMP, interrupted, 'Ctrl-C. Written to q1: 6083h:00, 6084h:00. Nothing is stored'),
    ((0x1010, 1), aborted, 'q1 has stored nothing'),
    ((0x1010, 1), interrupted, 'Ctrl-C. What q1 holds now is not known: switch its power off'),
    ((0x1010, 1), None, 'bit rate. What q1 holds now is not known'),
])
def test_what_ends_a_restore_says_what_is_written_and_what_to_do(rig, rejected, key, act, reason):
    change(rig, 0, (0x6083, 0), 5)
    rig.run('backup', 'q1')
    change(rig, 0, RAMP, 77)
    change(rig, 0, (0x6083, 0), 77)
    rig.drives[0].objects.writers[key] = act or (lambda _: rig.drives[0].reboot())
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a job of the background
    assert reason in rejected(rig.run, 'restore', 'q1', str(rig.folder / 'machine.q1.dcf'))


def test_ctrl_c_after_the_store_says_that_it_is_stored(rig, capsys, monkeypatch):
    rig.run('backup', 'q1')
    change(rig, 0, RAMP, 77)
    monkeypatch.setattr(keep, 'store', lambda *_: monkeypatch.setattr(keep, '_of_drive', ctrl_c))
    dcf = str(rig.folder / 'machine.q1.dcf')
    assert rig.run('restore', 'q1', dcf) == 1
    assert f'Ctrl-C. q1 has stored what was written: commission compare q1 {dcf}' in (
        capsys.readouterr().err)


def test_a_drive_that_stops_answering_says_so(rig, rejected):
    rig.run('backup', 'q1')
    answered = []
    read = rig.drives[0].objects.get_data

    def fall_silent(*arguments, **options):
        answered.append(1)
        rig.drives[0].is_silent = len(answered) > 40
        return read(*arguments, **options)

    rig.drives[0].objects.get_data = fall_silent
    assert 'does not answer' in rejected(rig.run, 'compare', 'q1', 'q2')


def test_a_file_of_another_drive_type_is_rejected(rig, rejected):
    rig.run('backup', 'q1')
    path = rig.folder / 'machine.q1.dcf'
    head, section, rest = path.read_text().partition('[1018sub2]')
    path.write_text(head + section + rest.replace('ParameterValue = 0', 'ParameterValue = 9', 1)
                    .replace('ParameterValue=0', 'ParameterValue=9', 1))
    change(rig, 0, RAMP, 77)
    assert 'another drive type' in rejected(rig.run, 'restore', 'q1', str(path))
    assert rig.drives[0].objects.values[RAMP] == 77


@pytest.mark.parametrize('text', ['', 'nonsense', EDS.read_text()[:20000]])
def test_a_file_that_is_no_dcf_is_one_message(rig, rejected, text):
    path = rig.folder / 'bad.dcf'
    path.write_text(text)
    assert 'bad.dcf' in rejected(rig.run, 'restore', 'q1', str(path))


def test_two_drives_with_one_id_are_not_written_to(make_rig, rejected):
    rig = make_rig('--new')
    assert '3 drives answer as q1' in rejected(rig.run, 'backup', 'q1')


def spoiled(tmp_path, *changes, source=EDS):
    """Return an EDS with some of its text changed."""
    text = source.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path / 'other.eds'
    path.write_bytes(text.encode('cp1252'))
    return path


def test_a_profile_drafted_from_our_own_eds_lacks_nothing(tmp_path):
    found = draft(EDS, DEFAULT_AXES)
    assert (found.verdict, found.deadly, found.reservations) == ('drivable.', [], [])
    (tmp_path / 'mine.yaml').write_text(found.text)
    (tmp_path / EDS.name).write_text(EDS.read_text())
    mine, generic = load_profile(str(tmp_path / 'mine.yaml')), load_profile('generic_cia402')
    assert mine.objects == generic.objects


def test_an_epos4_is_drivable_with_its_home_position_and_its_time_out():
    found = draft(config_path('drives/epos4.eds'), DEFAULT_AXES)
    assert not found.deadly and 'velocity_unit: rpm\n' in found.text
    assert 'index: 0x30B0, subindex: 0, value: home_position' in found.text
    assert 'index: 0x6066, subindex: 0, value: 0' in found.text
    assert any('1019h:00' in item for item in found.without)


SINGLE = 'DataType=0x0005\nAccessType=rw\nDefaultValue=0\n'


@pytest.mark.parametrize(('changes', 'reason'), [
    ([('[1016', '[2016')], 'a dead master does not stop it: there is no 1016h'),  # EVE-NET-C
    ([('[6007]', '[2007]')], 'there is no 6007h (where the maker has another'),  # ZeroErr, Eyou
    ([('[6502]', '[2502]'), ('[2502]', '[6502]\nParameterValue=0x1F')],
     'no cyclic synchronous position (6502h = 1Fh'),
    ([(f'[60C2sub1]\nParameterName=Interpolation time period value\nObjectType=0x7\n{SINGLE}',
       f'[60C2sub1]\nParameterName=x\nObjectType=0x7\nLowLimit=1\nHighLimit=1\n{SINGLE}')],
     '60C2h:01 takes 1 to 1, not 10 (interpolation_period)'),
    ([('[6085]', '[6085]\nHighLimit=1000')], '6085h:00 takes 0 to 1000, not 2580000'),
    ([('[6041]', '[2041]')], 'TPDO1 cannot carry object 6041h'),
])
def test_a_drive_that_cannot_be_used_is_said_to_be_so_and_nothing_is_written(
        rig, tmp_path, capsys, changes, reason):
    path = spoiled(tmp_path, *changes)
    assert rig.run('profile', str(path), '--output', str(tmp_path / 'new.yaml')) == 1
    said = ' '.join(capsys.readouterr().out.split())
    assert 'other.eds: not drivable, because:' in said and reason in said
    assert not (tmp_path / 'new.yaml').exists()


def test_what_a_drive_lacks_is_a_doubt_or_optional(tmp_path):
    path = spoiled(tmp_path, ('[6065]', '[2065]'), ('[60F4]', '[20F4]'), ('[60C5]', '[20C5]'))
    found = draft(path, DEFAULT_AXES)
    assert (found.verdict, found.deadly) == ('drivable, but:', [])
    assert found.reservations == ['object 6065h:00 for following_error_window is missing',
                            'TPDO2 cannot carry object 60F4h']
    assert found.without == ['object 60C5h:00 for max_acceleration is missing']


def test_a_unit_that_configure_would_reject_is_a_doubt(tmp_path):
    """Nanotec's CL4-E comes with tenths of degrees; its EDS was called drivable."""
    found = draft(spoiled(tmp_path, ('[6041]', '[60A8]\nParameterName=u\nObjectType=0x7\n'
        'DataType=0x0007\nAccessType=rw\nDefaultValue=0xFF410000\nPDOMapping=0\n\n[6041]')),
        DEFAULT_AXES)
    assert found.verdict == 'drivable, but:' and len(found.reservations) == 1
    assert 'as it comes, unit 60A8h:00 = FF410000h, expected 00B50000h' in found.reservations[0]


def test_a_file_of_one_drive_says_what_it_homes_by(tmp_path):
    path = spoiled(tmp_path, ('[6098]', """[60E3]
ParameterName=Homing methods
ObjectType=0x8
SubNumber=3
[60E3sub0]
ParameterName=n
ObjectType=0x7
DataType=0x0005
AccessType=ro
DefaultValue=2
[60E3sub1]
ParameterName=first
ObjectType=0x7
DataType=0x0002
AccessType=ro
DefaultValue=0
ParameterValue=-3
[60E3sub2]
ParameterName=second
ObjectType=0x7
DataType=0x0002
AccessType=ro
ParameterValue=37
[6098]"""))
    assert 'homing_methods: [-3, 37]\n' in draft(path, DEFAULT_AXES).text


def test_a_careless_file_is_read(tmp_path):
    path = spoiled(
        tmp_path, ('ProductName=CiA 402 drive', 'ProductName=Antrieb für Türen: neu'),
        ('VendorNumber=0', 'VendorNumber=1FB'), ('ProductNumber=0', 'ProductNumber='),
        ('PDOMapping=0\n\n[6085]', 'PDOMapping=\n\n[6085]'))
    found = draft(path, DEFAULT_AXES)
    assert found.verdict == 'drivable.' and 'vendor_id: 507' in found.text
    assert 'Antrieb für Türen: neu' in yaml.safe_load(found.text)['description']


def test_answers_that_were_given_are_kept(tmp_path):
    first = draft(EDS, DEFAULT_AXES).text
    lines = [line.split('  # ?')[0].replace('false', 'true').removeprefix('# ')
             if re.search('never_follows|acceleration_unit|errors', line) else line
             for line in first.splitlines()]
    again = draft(EDS, DEFAULT_AXES, '\n'.join(lines)).text
    for answer in ('  never_follows: true', 'acceleration_unit: rpm', 'errors: {}'):
        assert f'\n{answer}\n' in again
    assert again.count('# ?') == first.count('# ?') - 3


def test_the_command_drafts_a_profile_that_its_machine_may_name(rig, capsys):
    output = rig.folder / 'mine.yaml'
    assert rig.run('profile', str(EDS), '--output', str(output)) == 0
    said = capsys.readouterr().out
    assert '# ? does it enter NMT Operational by itself' in said
    assert yaml.safe_load(output.read_text())['quirks'] == {
        'boots_operational': False, 'never_follows': False}
    rig.configured(profile=str(output))
    assert rig.run('profile', '--check') == 0, capsys.readouterr()


def test_a_drive_is_held_against_its_profile_and_every_difference_listed(make_rig, capsys):
    rig = make_rig('--missing-objects', '0x6085', '0x1A01').configured()
    assert rig.run('profile', '--check', 'q2') == 1
    said = capsys.readouterr().out
    for label in ('6085h:00', '1A01h:00'):
        assert said.count(f'! q2: q2 (node 2) rejects object {label}: object does not exist') == 1
