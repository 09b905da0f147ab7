from dataclasses import replace
import struct

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.canopen.pdo import PDO_MAP, unused_pdos
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives.axis_settings import AxisSettings, check_axes, DEFAULT_AXES
from facade_manipulator.drives.configuration import (
    check_identity,
    Identity,
    object_writes,
    pdo_writes,
    quantities,
    verify_units,
    Write,
    write_objects,
)
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.errors import (
    DriveIdentityError,
    DriveObjectError,
    DriveTimeoutError,
    ParameterError,
)

SETTINGS = ControllerSettings()
ABSENT, READ_ONLY = 0x06020000, 0x06010002


class Objects:
    """An object dictionary of bytes that can reject, forget and fall silent."""

    name = 'q2'
    node_id = 2

    def __init__(self) -> None:
        self.values = {}
        self.rejected = {}
        self.constant = {}
        self.kept = {}
        self.silent = False
        self.written = []

    def read(self, index: int, subindex: int) -> bytes:
        self._require(index, subindex)
        return self.kept.get((index, subindex), self.values.get((index, subindex), bytes(4)))

    read_number = SdoChannel.read_number

    def write(self, index: int, subindex: int, data: bytes) -> None:
        self._require(index, subindex)
        if (index, subindex) in self.constant:
            raise SdoAbortError('it is read-only', self.constant[index, subindex])
        self.written.append((index, subindex))
        self.values[index, subindex] = data

    def size(self, index: int, subindex: int) -> int | None:
        return None if index == 0x2000 else 4

    def _require(self, index: int, subindex: int) -> None:
        if self.silent:
            raise DriveTimeoutError('q2 does not answer')
        if (index, subindex) in self.rejected:
            raise SdoAbortError(
                f'q2 rejects object {index:04X}h:{subindex:02X}', self.rejected[index, subindex])


@pytest.fixture
def drive():
    return Objects()


def test_objects_are_written_in_order_and_read_back(drive):
    drive.rejected[0x60C5, 0] = ABSENT
    assert write_objects(drive, [
        Write(0x6065, 0, 17280), Write(0x60C5, 0, 1, required=False), Write(0x607D, 1, -5),
        Write(0x6080, 0, 2**32 - 1)]) == ['q2 has no object 60C5h:00, which is optional']
    assert drive.written == [(0x6065, 0), (0x607D, 1), (0x6080, 0)]
    assert struct.unpack('<i', drive.values[0x607D, 1]) == (-5,)


@pytest.mark.parametrize(('write', 'state', 'error', 'message'), [
    (Write(0x6065, 0, 17280), {'kept': {(0x6065, 0): b'd\0\0\0'}}, DriveObjectError,
     'q2 .*6065h:00 reads back as 100 .*17280'),
    (Write(0x6065, 0, 1), {'rejected': {(0x6065, 0): ABSENT}}, DriveObjectError, '6065h:00'),
    (Write(0x60C5, 0, 1, required=False), {'rejected': {(0x60C5, 0): READ_ONLY}},
     DriveObjectError, '60C5h:00'),
    (Write(0x6065, 0, 1), {'silent': True}, DriveTimeoutError, 'does not answer'),
    (Write(0x6060, 0, 300, size=1), {}, DriveObjectError, '300 does not fit into the 1 bytes'),
])
def test_object_that_reads_back_otherwise_is_named(drive, write, state, error, message):
    vars(drive).update(state)
    with pytest.raises(error, match=message):
        write_objects(drive, [write])
    assert drive.written == [(0x6065, 0)] * ('kept' in state)


def test_read_only_object_with_right_value_is_accepted(drive):
    drive.constant[0x6065, 0] = READ_ONLY
    drive.values[0x6065, 0] = (17280).to_bytes(4, 'little')
    assert write_objects(drive, [Write(0x6065, 0, 17280)]) == []
    with pytest.raises(DriveObjectError, match=(
            r'6065h:00 reads back as 17280 .* instead of 7 \(7h\): it is read-only')):
        write_objects(drive, [Write(0x6065, 0, 7)])


def test_all_wrong_objects_are_named_at_once(drive):
    drive.rejected[0x60C5, 0] = ABSENT
    drive.constant[0x6065, 0] = READ_ONLY
    drive.kept[0x607F, 0] = (100).to_bytes(4, 'little')
    with pytest.raises(DriveObjectError) as rejection:
        write_objects(drive, [
            Write(0x60C5, 0, 1), Write(0x6065, 0, 2), Write(0x6060, 0, 300, size=1),
            Write(0x607F, 0, 4), Write(0x6080, 0, 5)])
    for problem in ('60C5h:00', '6065h:00 reads back as 0', '300 does not fit',
                    '607Fh:00 reads back as 100'):
        assert problem in str(rejection.value)
    assert '6080h' not in str(rejection.value)
    assert (0x6080, 0) in drive.values


def test_constant_mapping_is_accepted_where_right(drive):
    for pdo in PDO_MAP:
        for index, subindex, value, size, *_ in pdo.configure_writes(2):
            if index == pdo.mapping_index:
                drive.values[index, subindex] = value.to_bytes(size, 'little')
                drive.constant[index, subindex] = READ_ONLY
    write_objects(drive, pdo_writes(2, 100))
    drive.values[0x1A01, 1] = (0x60640020).to_bytes(4, 'little')
    with pytest.raises(DriveObjectError, match='1A01h:01 reads back as'):
        write_objects(drive, pdo_writes(2, 100))


# --- what is written


def test_synchronous_window_drops_no_late_commands():
    """After that of 1007h a drive discards synchronous RPDOs (Novanta, Bonfiglioli)."""
    writes = object_writes(load_profile('generic_cia402'), DEFAULT_AXES[0], SETTINGS)
    assert [one.value for one in writes if one.index == 0x1007] == [0]


def test_safety_objects_have_the_values_of_settings():
    values = quantities(AxisSettings(pulses_per_revolution=500), SETTINGS)
    assert values['master_heartbeat'] == 127 << 16 | 150
    assert values['heartbeat_time'] == 50
    assert values['interpolation_period'] == 10
    assert values['following_error_window'] == round(0.015 * 430_000)


@pytest.mark.parametrize('unit, value', [
    ('rpm', 0.5 / 0.02 * 4.3 * 60.0), ('micrometres_per_second', 0.5e6),
    ('tenth_micrometres_per_second', 5e6), (None, 0.5 * 430_000)])
@pytest.mark.parametrize('direction', [1, -1])
def test_motor_speed_has_the_unit_of_its_profile(unit, value, direction):
    values = quantities(AxisSettings(max_speed=0.5, direction=direction), SETTINGS, unit)
    assert values['max_motor_speed'] == round(value)
    assert values['max_velocity'] == round(0.5 * 430_000)


def test_acceleration_may_have_another_unit_than_speed():
    """Copley has 0.1 counts/s and 10 counts/s² (CML_Examples): a stop was 100 times as hard."""
    values = quantities(AxisSettings(
        max_speed=0.5, stop_deceleration=6.0, velocity_unit='tenths_of_counts_per_second',
        acceleration_unit='tens_of_counts_per_second'), SETTINGS)
    assert values['max_velocity'] == 0.5 * 4_300_000
    assert values['quick_stop_deceleration'] == 6.0 * 43_000
    assert values['homing_acceleration'] == 0.5 * 43_000


@given(st.sampled_from([1, -1]), st.floats(-1.0, 0.4), st.floats(0.01, 1.0))
def test_position_limits_are_in_order_and_enclose_the_stroke(direction, lower, length):
    axis = AxisSettings(
        direction=direction, lower_limit=lower, upper_limit=lower + length,
        home_position=lower)
    values = quantities(axis, SETTINGS)
    ends = sorted((axis.to_counts(lower), axis.to_counts(lower + length)))
    assert values['min_position'] <= ends[0] < ends[1] <= values['max_position']
    assert min(values[name] for name in (
        'max_velocity', 'max_acceleration', 'quick_stop_deceleration')) > 0


@pytest.mark.parametrize(('setting', 'value', 'message'), [
    ('homing_speed', 1e-4, '0.0001 m/s of node 1 is below 0.000388 m/s: the drive would .* 0 rpm'),
    ('homing_speed', 1.9e-4, 'below 0.000388 m/s'), ('homing_speed', 2e-4, None),
    ('stop_deceleration', 0.01, r'0.01 m/s\^2 .* below 0.0333 m/s\^2: .* get 0 rpm per second'),
    ('max_acceleration', 0.01, r'below 0.0333 m/s\^2'), ('max_speed', 0.01, 'below 0.0333 m/s:'),
    ('homing_acceleration', 0.01, r'below 0.0333 m/s\^2')])
def test_speed_or_acceleration_of_zero_is_rejected(setting, value, message):
    """At 1e-4 m/s homing left the switch with 6099h:02 = 0."""
    coarse = {'gear_ratio': 0.5, 'lead': 1.0, 'homing_speed': 0.1}
    axis = AxisSettings(velocity_unit='rpm', **{
        **({} if setting == 'homing_speed' else coarse), setting: value})
    if message is None:
        assert quantities(axis, SETTINGS)['homing_zero_speed'] == 1
        return
    with pytest.raises(ParameterError, match=f'{setting} = .*{message}'):
        quantities(axis, SETTINGS)


def test_each_pdo_is_off_while_its_mapping_is_written():
    off = {}
    for write in pdo_writes(3, 100):
        if write.index & 0xFF00 in (0x1400, 0x1800) and write.subindex == 1:
            off[write.index] = bool(write.value & 1 << 31)
        if write.index & 0xFF00 in (0x1600, 0x1A00):
            assert off[write.index - 0x200]
    assert {index for index, is_off in off.items() if is_off} == {
        pdo.communication_index for pdo in unused_pdos(PDO_MAP)}
    assert len(off) == 8


# --- units

@pytest.mark.parametrize(('objects', 'words'), [
    ({}, None),
    ({(0x60A8, 0): 0x00B50000, (0x60A9, 0): 0x00B44700, (0x60AA, 0): 0x00C00300}, None),
    ({(0x60A8, 0): 0xFA010000}, 'unit 60A8h:00 = FA010000h, expected 00B50000h'),
    ({(0x60A9, 0): 0xFDB44700}, r'60A9h:00 = FDB44700h, expected 00B44700h \(rpm\)'),
    ({(0x60A9, 0): 0xFDB44700, (0x60AA, 0): 0x00C00300},
     r'60AAh:00 = 00C00300h, rpm per second\): set 60A9h to 00B44700h in the drive'),
    ({(0x60AA, 0): 0xFDC00300}, '60AAh:00 = FDC00300h, expected 00C00300h'),
    ({(0x607E, 0): 0x80}, 'polarity 607Eh:00 = 80h, expected 00h'),
    ({(0x607E, 0): 0x01}, '607Eh:00 = 01h, expected 00h'),  # position, to Nanotec's PD4-C
    ({(0x608F, 1): 4000, (0x608F, 2): 2}, None),
    ({(0x608F, 1): 2**20, (0x608F, 2): 1, (0x6091, 1): 2, (0x6091, 2): 1, (0x6092, 1): 4000,
      (0x6092, 2): 1}, None),  # 4000 counts of feed by 2 turns of the motor
    ({(0x6091, 1): 5, (0x6091, 2): 1, (0x6092, 1): 4000, (0x6092, 2): 1},
     'makes 800 counts per revolution of the motor, expected 2000'),
    ({(0x608F, 1): 4096, (0x608F, 2): 1}, 'makes 4096 counts'),
    # as Elmo's Gold comes, whose position then is in counts of the encoder (DCF of a Whistle)
    (dict.fromkeys(((index, n) for index in (0x608F, 0x6091, 0x6092) for n in (1, 2)), 1), None),
    # as Nanotec's CL4-E comes (EDS)
    ({(0x608F, 1): 4000, (0x608F, 2): 1, (0x6092, 1): 1, (0x6092, 2): 1},
     'makes 1 counts per .*: set 6092h:01 to 2000 in the drive, or among the objects'),
])
def test_units_gearing_and_polarity_match_the_profile(
        drive, objects, words):
    drive.values = {key: value.to_bytes(4, 'little') for key, value in objects.items()}
    axis = AxisSettings(pulses_per_revolution=500, velocity_unit='rpm')
    if words is None:
        verify_units(drive, axis)
        return
    with pytest.raises(DriveObjectError, match=rf'q2 \(node 2\): .*{words}'):
        verify_units(drive, axis)


# --- identity

AXIS = AxisSettings(node_id=2, vendor_id=0xFB, product_code=7, serial_number=222)
GENUINE = Identity(0x00020192, 0xFB, 7, 222)
SERIALS = {111: 'q1', 222: 'q2', 333: 'q3'}


@pytest.mark.parametrize(('change', 'message'), [
    *(({field: 999}, rf'q2 \(node 2\): {field} = 999 .*another drive')
      for field in ('vendor_id', 'product_code', 'serial_number')),
    ({'serial_number': 333}, 'the drive of q3, the axes are swapped'),
    # an axis whose number is configured 0, which accepts any, is nobody's twin
    ({'serial_number': 0}, 'serial_number = 0 .* 222: it has none'),
    ({'device_type': 401}, 'device type 401 is not 402'),
])
def test_other_identity_is_named_with_the_difference(change, message):
    with pytest.raises(DriveIdentityError, match=message):
        check_identity('q2', GENUINE._replace(**change), AXIS, {**SERIALS, 0: 'q1'})


# --- settings


def test_axes_with_equal_node_or_serial_are_rejected():
    with pytest.raises(ParameterError, match='same node_id'):
        check_axes((AxisSettings(), *DEFAULT_AXES[:2]))
    with pytest.raises(ParameterError, match='same serial_number'):
        check_axes(tuple(replace(axis, serial_number=5) for axis in DEFAULT_AXES))
    with pytest.raises(ParameterError, match='2 axes'):
        check_axes(DEFAULT_AXES[:2])


@pytest.mark.parametrize('details', [
    {'node_id': 127}, {'lead': 0.0}, {'max_speed': float('nan')}, {'direction': 0}])
def test_contradictory_axis_is_rejected(details):
    with pytest.raises(ParameterError):
        AxisSettings(**details)


@pytest.mark.parametrize('details', [
    {'rate': 300}, {'rate': 1000}, {'heartbeat_timeout': 0.09}, {'heartbeat_period': 0.08}])
def test_controller_settings_out_of_bounds_are_rejected(details):
    with pytest.raises(ParameterError):
        ControllerSettings(**details)
