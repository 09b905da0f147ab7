"""Drives of other types: maps, signs, quirks, maker's objects, and a type in two files."""

from __future__ import annotations

from dataclasses import replace

import pytest

from facade_manipulator.canopen import cob_ids
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.profile import load_profile, ProfileObject
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State, Status
from facade_manipulator.errors import DriveError, DriveObjectError
from facade_manipulator.package_files import config_path
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings

pytestmark = pytest.mark.long

SMALLEST = {'RPDO1': [0x6040, 0x6060, 0x607A], 'TPDO1': [0x6041, 0x6061, 0x6064]}
OF_CIA_402 = {
    'RPDO2': [0x6040, 0x6060],
    'RPDO3': [0x6040, 0x607A],
    'TPDO2': [0x6041, 0x6061],
    'TPDO3': [0x6041, 0x6064],
}
REORDERED = {
    'RPDO1': [0x607A, 0x6040, 0x6060],
    'TPDO1': [0x606C],
    'TPDO4': [0x6064, 0x6061, 0x6041],
}
NMT_RESETS = (0x81, 0x82)  # of the node, and only of its communication
UNMAPPED = SimulationSettings(missing_objects=(0x606C, 0x60F4, 0x603F, 0x6077))
# drives whose zero is home plus 607Ch, as CiA 402 is printed by Elmo
OTHER_SIGN = [one._asdict() for one in load_profile('simulated').objects]
for entry in OTHER_SIGN:
    if entry['value'] == 'home_position':
        entry['value'] = 'home_offset'
EPOS4 = tuple(replace(axis, profile='epos4') for axis in DEFAULT_AXES)


def move(rig):
    """Home, activate and move for a while; the drives end without power."""
    rig.request('configure', 'home')
    rig.stream()
    rig.request('activate')
    rig.until(lambda: rig.snapshot.axes[1].position > 0.12)
    speed = rig.drives[1].motor.velocity * rig.axes[1].to_metres(1.0)
    assert rig.snapshot.axes[1].velocity == pytest.approx(speed, abs=0.02)
    rig.request('deactivate')
    assert rig.state is ControllerState.INACTIVE


# --- departures from CiA 402


def hide_mode(drive):
    mode = drive.objects.readers[0x6061, 0]

    def mode_while_enabled():
        return mode() if drive.axis.state is State.OPERATION_ENABLED else 0

    drive.objects.readers[0x6061, 0] = mode_while_enabled


def never_set_bit_10(drive):
    status = drive.axis.homing.status
    drive.axis.homing.status = lambda: status() & ~Status.TARGET_REACHED


def pulse_bit_10(drive):
    status = drive.axis.homing.status
    seen = [0]

    def pulsed():
        word = status()
        seen[0] = seen[0] + 1 if word & Status.TARGET_REACHED else 0
        return word if seen[0] < 2 else word & ~Status.TARGET_REACHED

    drive.axis.homing.status = pulsed


@pytest.mark.parametrize(
    ('changes', 'depart', 'settings'),
    [
        ({'pdos': SMALLEST}, bool, UNMAPPED),
        ({'pdos': OF_CIA_402}, bool, SimulationSettings()),
        ({'pdos': REORDERED}, bool, SimulationSettings()),
        ({'objects': OTHER_SIGN}, bool, SimulationSettings()),
        ({'quirks': {'hides_mode': True}}, hide_mode, SimulationSettings()),
        (
            {'quirks': {'homes_without_bit_10': True}},
            never_set_bit_10,
            SimulationSettings(),
        ),
        (
            {'quirks': {'homes_without_bit_10': True}},
            pulse_bit_10,
            SimulationSettings(),
        ),
        ({'quirks': {'cyclic_bit_4': 'held'}}, bool, SimulationSettings()),
        ({'quirks': {'cyclic_bit_4': 'toggled'}}, bool, SimulationSettings()),
        ({'quirks': {'starts_itself': True}}, bool, SimulationSettings()),
    ],
)
def test_drives_of_another_type_home_and_move(
    make_rig, axes_with, changes, depart, settings
):
    axes = axes_with(**changes)
    rig = make_rig(axes=axes, drives=[SimulatedDrive(axis, settings) for axis in axes])
    for drive in rig.drives:
        depart(drive)
    move(rig)
    values = rig.snapshot.axes[0].force, rig.snapshot.axes[0].following_error
    assert ([*values] == [None, None]) is ('pdos' in changes)


def test_missing_bit_10_in_homing_names_the_quirk(make_rig):
    axes = tuple(replace(axis, homing_speed=1.0) for axis in DEFAULT_AXES)
    rig = make_rig(axes=axes)
    never_set_bit_10(rig.drives[1])
    rig.request('configure')
    message = rig.rejection('home')
    assert (
        'q2: homing took longer than 3 s, bit 12 is 1 (attained), but bit 10' in message
    )
    assert 'set quirks.homes_without_bit_10 in its profile' in message


@pytest.mark.parametrize(
    ('kind', 'other'), [('held', 'clear'), ('toggled', 'held'), ('toggled', 'clear')]
)
def test_drive_without_its_bit_4_is_stopped(make_rig, axes_with, kind, other):
    drives = [SimulatedDrive(axis) for axis in axes_with(quirks={'cyclic_bit_4': kind})]
    rig = make_rig(axes=axes_with(quirks={'cyclic_bit_4': other}), drives=drives)
    rig.request('configure', 'home', 'activate')
    rig.stream()
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    assert 'behind its targets' in rig.all_causes


# --- times and the start of a drive


def delay_boot(rig, drive, seconds):
    """Let a drive be silent for a time [s] before it obeys a reset."""
    receive = drive.receive

    def reset(*frame):
        drive.is_silent = False
        rig.deliver(receive(*frame, rig.clock.now))

    def receive_resets_late(cob_id, data, now):
        if cob_id != cob_ids.NMT or data[0] not in NMT_RESETS:
            return receive(cob_id, data, now)
        drive.is_silent = True
        rig.later(seconds, lambda: reset(cob_id, data))
        return []

    drive.receive = receive_resets_late


def test_drive_that_boots_slowly_is_awaited_with_its_quirk(make_rig, axes_with):
    rig = make_rig(axes=axes_with(quirks={'boot_time': 9}))
    delay_boot(rig, rig.drives[1], 8.5)
    rig.request('configure', 'home', 'activate')


def test_boot_longer_than_expected_names_time_and_quirk(rig):
    delay_boot(rig, rig.drives[1], 8.5)
    message = rig.rejection('configure')
    assert 'q2 (node 2) sent no boot-up message' in message
    problem, _, step = message.partition('; next: ')
    assert problem.endswith('(waited 0.5 s)')
    assert 'set quirks.boot_time in its profile' in step


@pytest.mark.parametrize('knows', [True, False])
def test_drive_that_starts_itself_needs_its_quirk(make_rig, axes_with, knows):
    quirks = {'starts_itself': True}
    drives = [SimulatedDrive(axis) for axis in axes_with(quirks=quirks)]
    axes = axes_with(quirks=quirks if knows else {})
    rig = make_rig(axes=axes, drives=drives)
    for drive in drives:
        drive.objects.stored[0x1017, 0] = 50
        drive.reboot()
    rig.run(0.3)
    message = rig.rejection('configure')
    if knows:
        assert message is None
    else:
        assert 'starts itself: set quirks.starts_itself in its profile' in message


@pytest.mark.parametrize(('startup', 'is_accepted'), [(0, True), (4, False)])
def test_object_1f80_shows_that_a_drive_starts_itself(rig, startup, is_accepted):
    drive = rig.drives[1]
    drive.objects.stored[0x1017, 0] = 50
    drive.reboot()
    rig.run(0.1)
    drive.objects.nmt.state = 'OPERATIONAL'
    receive = drive.receive
    reading = bytes.fromhex('40801f0000000000')
    answer = bytes.fromhex('43801f00') + startup.to_bytes(4, 'little')

    def answer_startup(cob_id, data, now):
        if cob_id == cob_ids.SDO_REQUEST + 2 and data == reading:
            return [(cob_ids.SDO_RESPONSE + 2, answer)]
        return receive(cob_id, data, now)

    drive.receive = answer_startup
    rig.run(0.1)
    message = rig.rejection('configure')
    assert (message is None) is is_accepted


def pad_process_data(frame):
    is_tpdo = 0x181 <= frame[0] < 0x580 and frame[0] & 0x80
    return (frame[0], frame[1].ljust(8, b'\xa5')) if is_tpdo else frame


def shorten_answers(frame):
    cob_id, data = frame
    if cob_id & ~0x7F != 0x580:
        return frame
    if data[0] & 0xE3 == 0x43:
        return cob_id, data[: 8 - (data[0] >> 2 & 3)]
    if data[0] == 0x60:
        return cob_id, data[:4]
    return frame


def shorten_emergencies(frame):
    cob_id, data = frame
    return (cob_id, data[:3]) if cob_id in (0x81, 0x82, 0x83) else frame


def test_short_emergency_message_stops_the_drives(rig):
    deliver = rig.deliver
    rig.deliver = lambda frames: deliver([shorten_emergencies(one) for one in frames])
    rig.request('configure', 'home', 'activate')
    rig.inject(1, lambda drive: drive.inject_fault(0x8611))
    rig.until(lambda: rig.state is ControllerState.STOPPED, 0.02)
    assert '8611h' in rig.snapshot.causes[0].message


RESERVED = {  # bits by index and subindex
    (0x1400, 1): 1 << 30 | 1 << 11,
    (0x1800, 1): 1 << 28,
    (0x1801, 1): 1 << 20,
    (0x1016, 1): 0xFF << 24,
}


def set_reserved_bits(frame):
    """Set reserved bits of COB-IDs and of the watched master in answers of SDO."""
    cob_id, data = frame
    is_answer = cob_id & ~0x7F == 0x580 and data[0] == 0x43
    if not is_answer:
        return frame
    key = int.from_bytes(data[1:3], 'little'), data[3]
    if key not in RESERVED:
        return frame
    value = int.from_bytes(data[4:], 'little') | RESERVED[key]
    return cob_id, data[:4] + value.to_bytes(4, 'little')


@pytest.mark.parametrize(
    'change', [pad_process_data, shorten_answers, set_reserved_bits]
)
def test_frames_of_any_legal_form_are_used(rig, change):
    deliver = rig.deliver
    rig.deliver = lambda frames: deliver([change(one) for one in frames])
    move(rig)


def test_drive_that_does_not_report_its_mode_is_stopped(rig):
    rig.request('configure')
    hide_mode(rig.drives[0])
    with pytest.raises(
        DriveError,
        match=('q1 did not select its mode of operation.*: .* in mode 0 instead'),
    ):
        rig.request('home')
    rig.until_stopped()


# --- the three drives of the published machine, enforced as their maker describes them


def test_epos4_drives_home_and_move(make_rig):
    rig = make_rig(axes=EPOS4)
    assert {drive.objects.values[0x1018, 1] for drive in rig.drives} == {0xFB}
    move(rig)
    deceleration = round(6.0 / 0.02 * 4.3 * 60.0)  # rpm/s
    assert rig.drives[0].objects.values[0x6085, 0] == deceleration


def test_epos4_with_other_unit_is_rejected(make_rig):
    rig = make_rig(axes=EPOS4)
    rig.drives[1].objects.stored[0x60A9, 0] = 0xFDB44700  # milli-rpm
    with pytest.raises(
        DriveObjectError,
        match=(r'^((?!q1).)*q2 \(node 2\): .*60A9h:00 = FDB44700h.* B44700h'),
    ):
        rig.request('configure')


# --- a drive of 24 bits whose inputs are inverted is two files, not code

TURN = 2**24
OBJECT = """
[{}]
ParameterName={}
ObjectType=0x7
DataType=0x0007
AccessType=rw
DefaultValue=0
"""


@pytest.fixture
def fine_axes(tmp_path, axes_with):
    """Return axes whose drive type is described by only a data sheet and a profile."""
    text = config_path('drives/cia402.eds').read_text()
    text += OBJECT.format('2310', 'Inversion of inputs')
    text += OBJECT.format('1016sub2', 'Master')
    (tmp_path / 'fine.eds').write_text(text)
    inverted = ProfileObject(0x2310, 0, 4 << 8, required=True)
    objects = [inverted._asdict()]
    for one in load_profile('generic_cia402').objects:
        entry = one._asdict()
        if one.value == 'master_heartbeat':
            entry['subindex'] = 2
        objects.append(entry)
    made = axes_with(
        'generic_cia402',
        eds='fine.eds',
        velocity_unit='rpm',
        homing_methods=[23],
        input_polarity={'index': 0x2310, 'subindex': 0, 'shift': 8},
        objects=objects,
    )
    axes = []
    for axis in made:
        homing = replace(axis, homing_method=23, homing_speed=0.1)
        axes.append(replace(homing, pulses_per_revolution=TURN // 4))
    return tuple(axes)


def test_drive_type_from_two_files_homes_and_moves(make_rig, fine_axes):
    opening = SimulationSettings(home_switch_opens=True)
    drives = [SimulatedDrive(axis, opening) for axis in fine_axes]
    rig = make_rig(axes=fine_axes, drives=drives)
    rig.request('configure', 'home')
    # of method 23, and the switch is there
    edge = -SimulationSettings().home_switch_width / 2.0
    assert rig.carriages == pytest.approx([edge] * 3, abs=0.01)
    rig.stream()
    rig.request('activate')
    motor = rig.drives[0].motor
    start = rig.carriages[0]
    counts = rig.drives[0].motor.counts
    rig.until(lambda: rig.carriages[0] > start + 0.02)
    rig.request('deactivate')
    way = rig.carriages[0] - start
    turns = way / fine_axes[0].lead * fine_axes[0].gear_ratio
    assert motor.counts - counts == pytest.approx(turns * TURN, rel=0.01)
    assert all(drive.objects.values[0x1016, 2] for drive in rig.drives)
