"""Commands `profile`, `backup` and `restore`."""

from canopen import SdoAbortedError
import pytest
from tools.commissioning.rig import own_profile, raising

from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import config_path

pytestmark = pytest.mark.long

EDS = config_path('drives/cia402.eds')
RAMP = (0x6084, 0)
SPEED = (0x6083, 0)
BACKUP = 'machine.q1.dcf'


# --- profile


def test_drives_that_match_their_profile_are_recorded(rig, capsys):
    assert rig.run('profile', '--check') == 0
    assert 'q2: configure will change ' in (said := capsys.readouterr().out)
    assert '6065h:00' in said
    assert rig.overlay.steps().keys() >= {
        f'profile --check {axis}' for axis in AXIS_NAMES
    }
    assert rig.drives[0].objects.values[0x6065, 0] == 0xFFFFFFFF  # as before the check


@pytest.mark.parametrize(
    ('code', 'reason'),
    [
        (0x06010002, 'attempt to write a read only object'),
        (0x06070010, 'data type and length code do not match'),
    ],
)
def test_each_object_that_differs_is_named(make_rig, capsys, code, reason):
    rig = make_rig('--profile', 'epos4', '--missing-objects', '0x6085').configured(
        'epos4'
    )
    objects = rig.drives[1].objects
    objects.writers[0x607F, 0] = raising(SdoAbortedError(code))
    objects.defaults[0x60A9, 0] = 0xFDB44700
    rig.power_cut()
    assert rig.run('profile', '--check') == 1
    said = capsys.readouterr().err
    for words in (
        '! q1: q1 (node 1)',
        '! q3: q3 (node 3)',
        f'object 607Fh:00: {reason}',
        'object 6085h:00: object does not exist',
        '60A9h:00 = FDB44700h',
    ):
        assert words in said


@pytest.mark.parametrize('code', [0x06020000, 0x06010001, 0x08000022])
def test_unreadable_objects_are_not_listed_as_changes(rig, capsys, code):
    for drive in rig.drives:
        drive.objects.readers[0x6065, 0] = raising(SdoAbortedError(code))
    assert rig.run('profile', '--check') == 1
    said = capsys.readouterr().out
    (changes,) = [line for line in said.splitlines() if 'q2: configure will' in line]
    assert '6065h:00' not in changes
    assert 'q2: the drive lacks or rejects 6065h:00' in said


def test_profile_without_a_dead_master_stop_is_rejected(rig, tmp_path, capsys):
    rig.configured(own_profile(tmp_path, without=0x1016))
    assert rig.run('profile', 'q1', '--check') == 1
    assert 'does not stop when this computer is silent' in capsys.readouterr().err


def test_drive_without_cyclic_position_is_rejected(rig, capsys):
    rig.drives[1].objects.readers[0x6502, 0] = lambda: 0x20  # bit 5: homing only
    assert rig.run('profile', 'q2', '--check') == 1
    assert 'not support cyclic synchronous position' in capsys.readouterr().err


def test_interrupted_profile_check_states_the_written_values(rig, rejected):
    rig.drives[0].objects.writers[0x6065, 0] = raising(KeyboardInterrupt)
    said = rejected('profile', 'q1', '--check')
    assert (
        'interrupted\nq1 may have new values, which are not stored; next: switch'
        in said
    )


# --- backup and restore


def test_backup_is_restored_to_another_drive_after_power_cuts(rig, capsys):
    rig.drives[0].objects.write(RAMP, 77)
    rig.drives[0].objects.write((0x607D, 1), -123456)
    assert rig.run('backup', 'q1') == 0
    assert 'backup q1' in rig.overlay.steps()
    assert rig.run('restore', 'q2', BACKUP) == 0
    assert '77         100000  Profile deceleration' in capsys.readouterr().out
    rig.power_cut()
    restored = rig.drives[1].objects.values
    assert restored[RAMP] == 77
    assert restored[0x607D, 1] == -123456
    assert rig.run('restore', 'q2', BACKUP) == 0
    assert 'nothing is written' in capsys.readouterr().out


def test_object_of_another_size_than_its_eds_is_restored(rig, tmp_path):
    eds = tmp_path / 'wrong.eds'
    head, name, rest = EDS.read_text().partition('[6084]')
    eds.write_text(head + name + rest.replace('0x0007', '0x0006', 1))
    rig.drives[0].objects.write(RAMP, 0x12345)
    rig.run('backup', 'q1', '--eds', str(eds))
    rig.drives[0].objects.write(RAMP, 77)
    assert rig.run('restore', 'q1', BACKUP) == 0
    assert rig.drives[0].objects.values[RAMP] == 0x12345


def test_restore_skips_objects_of_the_bus_position(rig, tmp_path):
    rig.configured(own_profile(tmp_path, of_place=[[0x6084, 0]]))
    rig.run('backup', 'q1')
    for key in (RAMP, SPEED, (0x1801, 2)):
        rig.drives[1].objects.write(key, 77)
    assert rig.run('restore', 'q2', BACKUP) == 0
    values = rig.drives[1].objects.values
    assert values[RAMP] == 77 != values[SPEED]
    assert values[0x1801, 1] & 0x7F == 2


@pytest.mark.parametrize(
    'words',
    [
        ['backup', 'q1'],
        ['restore', 'q1', BACKUP],
        ['profile', 'q1', '--check'],
        ['direction', 'q1'],
        ['jog', 'q1', '40'],
    ],
)
def test_powered_drive_is_rejected_and_keeps_its_power(rig, rejected, words):
    rig.run('backup', 'q1')
    for word in (6, 7, 15):
        rig.drives[0].objects.write((0x6040, 0), word)
    assert 'has power' in rejected(*words)
    assert rig.is_powered


ABORTED = raising(SdoAbortedError(0x06090030))
INTERRUPTED = raising(KeyboardInterrupt)


@pytest.mark.parametrize(
    ('key', 'act', 'message'),
    [
        (RAMP, ABORTED, 'q1 may have new values, which are not stored'),
        (
            RAMP,
            INTERRUPTED,
            'interrupted\nq1 may have new values, which are not stored',
        ),
        ((0x1010, 1), ABORTED, 'The values stored in q1 are unknown'),
        ((0x1010, 1), INTERRUPTED, 'interrupted\nThe values stored in q1 are unknown'),
    ],
)
def test_interrupted_restore_states_the_written_values(
    rig, rejected, key, act, message
):
    rig.run('backup', 'q1')
    for changed in (SPEED, RAMP):
        rig.drives[0].objects.write(changed, 77)
    rig.drives[0].objects.writers[key] = act
    assert message in rejected('restore', 'q1', BACKUP)


def test_object_that_a_drive_does_not_store_is_named(rig, rejected):
    rig.run('backup', 'q1')
    rig.drives[0].objects.write(RAMP, 77)
    rig.drives[0].objects.stored[RAMP] = 77
    rig.drives[0].objects.writers[0x1010, 1] = bool
    assert 'q1 has not stored these values: q1 (node 1): object 6084h:00' in rejected(
        'restore', 'q1', BACKUP
    )


@pytest.mark.parametrize(
    'text',
    [
        '',
        'nonsense',
        EDS.read_text().replace(
            'ParameterName=Vendor-ID', 'ParameterName=Vendor-ID\nParameterValue=9'
        ),
    ],
)
def test_file_without_a_matching_backup_is_rejected(rig, rejected, tmp_path, text):
    (tmp_path / 'other.dcf').write_text(text)
    assert 'other.dcf' in rejected('restore', 'q1', 'other.dcf')


def test_backup_with_duplicate_node_ids_is_rejected(make_rig, rejected):
    make_rig('--new').configured(**{'q2.node_id': 2, 'q3.node_id': 3})
    assert 'q1 rejected: 3 drives answer as node 1' in rejected('backup', 'q1')
