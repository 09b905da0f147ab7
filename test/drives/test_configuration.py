"""Values that configure writes to a drive, and their proof."""

from __future__ import annotations

from dataclasses import replace
import re

from canopen import SdoAbortedError
from hypothesis import given
from hypothesis import strategies as st
import pytest
from steps import answer, result_of

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives.axis_settings import (
    AxisSettings,
    check_axes,
    DEFAULT_AXES,
)
from facade_manipulator.drives.configuration import (
    check_identity,
    drive_writes,
    unit_conflicts,
)
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.guard import Unguarded
from facade_manipulator.drives.profile import load_profile, quantities
from facade_manipulator.errors import DriveError, ParameterError
from facade_manipulator.simulation.drives.drive import SimulatedDrive

SETTINGS = ControllerSettings()


# --- objects are written and read back


def absent(objects, key):
    objects.missing.append(key[0])
    del objects.values[key]


def read_only(objects, key):
    def abort(_):
        raise SdoAbortedError(0x06010002)

    objects.writers[key] = abort


def stuck(objects, key):
    objects.readers[key] = lambda: 7


@pytest.mark.parametrize(
    ('spoil', 'key', 'words'),
    [
        (
            absent,
            (0x6065, 0),
            'q2 (node 2) rejects object 6065h:00: object does not exist',
        ),
        (read_only, (0x6085, 0), 'attempt to write a read only object'),
        (stuck, (0x607F, 0), 'object 607Fh:00 reads back as 7 (7h) instead of 258000'),
        (stuck, (0x1A01, 1), 'object 1A01h:01 reads back as 7'),
    ],
)
def test_object_that_cannot_be_written_is_named(rig, spoil, key, words):
    spoil(rig.drives[1].objects, key)
    absent(rig.drives[1].objects, (0x6080, 0))
    message = rig.rejection('configure')
    assert words in message
    assert '6080h:00' in message
    assert 'q1' not in message


def test_read_only_objects_with_their_values_are_accepted(rig):
    objects = rig.drives[1].objects
    objects.stored[0x605A, 0] = 6
    objects.stored[0x1A01, 0] = 2
    objects.stored[0x1A01, 1] = 0x606C0020
    objects.stored[0x1A01, 2] = 0x60F40020
    for key in objects.stored:
        read_only(objects, key)
    rig.request('configure')


@pytest.mark.parametrize('index', [0x1029, 0x1402])  # the latter of an unused PDO
def test_missing_optional_object_is_reported(rig, index):
    absent(rig.drives[1].objects, (index, 1))
    rig.request('configure')
    assert f'q2 has no object {index:X}h:01, which is optional' in rig.snapshot.notes


def test_value_that_does_not_fit_its_object_is_named(make_rig, axes_with):
    entry = {'index': 0x605A, 'subindex': 0, 'value': 70_000, 'required': True}
    axes = axes_with(objects=[entry])
    rig = make_rig(axes=axes, drives=[*map(SimulatedDrive, DEFAULT_AXES)])
    message = rig.rejection('configure')
    assert '70000 does not fit into the 2 bytes of object 605Ah:00' in message


# --- the values


def test_written_values_equal_the_settings(rig):
    rig.request('configure')
    values = rig.drives[0].objects.values
    assert values[0x1016, 1] == 127 << 16 | 150
    assert values[0x1017, 0] == 50
    assert values[0x60C2, 1] == 10
    assert values[0x6065, 0] == round(0.015 * 430_000)


def test_configuration_disables_the_synchronous_window():
    """After the window of 1007h, a drive discards synchronous RPDOs (Novanta, Bonfiglioli)."""
    writes = drive_writes(load_profile('generic_cia402'), DEFAULT_AXES[0], SETTINGS)
    assert [one.value for one in writes if one.index == 0x1007] == [0]


@pytest.mark.parametrize(
    ('units', 'motor_unit', 'motor_speed', 'speed', 'deceleration'),
    [
        ({}, 'rpm', 0.5 / 0.02 * 4.3 * 60.0, 0.5 * 430_000, 6.0 * 430_000),
        (
            {'direction': -1},
            'tenth_micrometres_per_second',
            5e6,
            0.5 * 430_000,
            6.0 * 430_000,
        ),
        # Copley's drives: a stop was 100 times as hard
        (
            {
                'velocity_unit': 'tenths_of_counts_per_second',
                'acceleration_unit': 'tens_of_counts_per_second',
            },
            None,
            0.5 * 4_300_000,
            0.5 * 4_300_000,
            6.0 * 43_000,
        ),
    ],
)
def test_speed_and_acceleration_have_their_units(
    units, motor_unit, motor_speed, speed, deceleration
):
    values = quantities(
        AxisSettings(max_speed=0.5, stop_deceleration=6.0, **units),
        SETTINGS,
        motor_unit,
    )
    assert [
        values[name]
        for name in ('max_motor_speed', 'max_velocity', 'quick_stop_deceleration')
    ] == [motor_speed, speed, deceleration]


@given(st.sampled_from([1, -1]), st.floats(-1.0, 0.4), st.floats(0.01, 1.0))
def test_position_limits_are_in_order_and_enclose_the_stroke(direction, lower, length):
    axis = AxisSettings(
        direction=direction,
        lower_limit=lower,
        upper_limit=lower + length,
        home_position=lower,
    )
    values = quantities(axis, SETTINGS)
    ends = sorted((axis.to_counts(lower), axis.to_counts(lower + length)))
    assert values['min_position'] <= ends[0] < ends[1] <= values['max_position']


@pytest.mark.parametrize(
    ('setting', 'value', 'message'),
    [
        ('homing_speed', 1.9e-4, '0.00019 rejected: a value below 0.000388'),
        ('stop_deceleration', 0.01, '0.01 rejected: a value below 0.0333'),
        ('max_speed', 0.01, '0.01 rejected: a value below 0.0333'),
    ],
)
def test_speed_or_acceleration_of_zero_is_rejected(setting, value, message):
    """At 1e-4 m/s homing left the switch with 6099h:02 = 0."""
    details = {setting: value}
    if setting != 'homing_speed':
        details |= {'gear_ratio': 0.5, 'lead': 1.0, 'homing_speed': 0.1}
    axis = AxisSettings(velocity_unit='rpm', **details)
    with pytest.raises(ParameterError, match=f'{setting} = {message}'):
        quantities(axis, SETTINGS)


@pytest.mark.parametrize('share_of_unit', [0.4, 0.6, 0.999])
@pytest.mark.parametrize('setting', ['homing_speed', 'stop_deceleration', 'max_speed'])
def test_rejection_of_speed_below_one_unit_names_the_minimum(setting, share_of_unit):
    settings = {
        'velocity_unit': 'rpm',
        'gear_ratio': 0.5,
        'lead': 1.0,
        'homing_speed': 1.0,
        'homing_zero_share': 0.5,
    }
    unit = abs(AxisSettings(**settings).si_per_unit.velocity)
    if setting == 'homing_speed':
        unit /= 0.5
    settings[setting] = share_of_unit * unit
    with pytest.raises(ParameterError, match='less than one unit') as error:
        quantities(AxisSettings(**settings), SETTINGS)

    _, _, minimum = str(error.value).partition('next: set at least ')
    settings[setting] = float(minimum)
    assert 1.0 <= settings[setting] / unit < 1.02
    values = quantities(AxisSettings(**settings), SETTINGS)
    for name in values:
        if re.search('speed|velocity|acceleration|deceleration', name):
            assert values[name] >= 1


def test_only_unused_pdos_remain_disabled():
    cob_ids = {}
    for write in drive_writes(
        load_profile('generic_cia402'), DEFAULT_AXES[2], SETTINGS
    ):
        if write.index & 0xFF00 in (0x1400, 0x1800) and write.subindex == 1:
            cob_ids[write.index] = write.value
    assert len(cob_ids) == 8
    disabled = {index for index, one in cob_ids.items() if one & 1 << 31}
    unused = {one.communication_index for one in pdo.unused_pdos(pdo.PDO_MAP)}
    assert disabled == unused


def controller(axes=DEFAULT_AXES) -> DriveController:
    return DriveController(ControllerSettings(), axes, None, None, Unguarded())


# --- units and identity


RATIOS = [(0x608F, 1), (0x608F, 2), (0x6091, 1), (0x6091, 2), (0x6092, 1), (0x6092, 2)]
ALL_RATIOS_ONE = dict.fromkeys(RATIOS, 1)


@pytest.mark.parametrize(
    ('objects', 'words'),
    [
        ({}, ''),
        (
            {(0x60A8, 0): 0x00B50000, (0x60A9, 0): 0x00B44700, (0x60AA, 0): 0x00C00300},
            '',
        ),
        ({(0x60A8, 0): 0x00B50012, (0x60A9, 0): 0x00B44701}, ''),  # reserved bits
        ({(0x60A8, 0): 0xFA010000}, 'object 60A8h:00 = FA010000h, expected B50000h'),
        ({(0x60A9, 0): 0xFDB44700}, '60A9h:00 = FDB44700h, expected B44700h (rpm)'),
        ({(0x60AA, 0): 0xFDC00300}, '60AAh:00 = FDC00300h, expected C00300h'),
        ({(0x607E, 0): 0x80}, '607Eh:00 = 80h, expected 0h (no polarity'),
        (
            {(0x607E, 0): 0x01},
            '607Eh:00 = 1h, expected 0h',
        ),  # position, to Nanotec's PD4-C
        ({(0x608F, 1): 4000, (0x608F, 2): 2}, ''),
        (
            {
                (0x608F, 1): 2**20,
                (0x608F, 2): 1,
                (0x6091, 1): 2,
                (0x6091, 2): 1,
                (0x6092, 1): 4000,
                (0x6092, 2): 1,
            },
            '',
        ),  # 4000 counts of feed by 2 turns of the motor
        (
            {(0x6091, 1): 5, (0x6091, 2): 1, (0x6092, 1): 4000, (0x6092, 2): 1},
            'makes 800 counts per revolution of the motor, expected 2000',
        ),
        ({(0x608F, 1): 4096, (0x608F, 2): 1}, 'makes 4096 counts'),
        # as Elmo's Gold comes, whose position then is in counts of the encoder (DCF of a Whistle)
        (ALL_RATIOS_ONE, ''),
        # as Nanotec's CL4-E comes (EDS)
        (
            {(0x608F, 1): 4000, (0x608F, 2): 1, (0x6092, 1): 1, (0x6092, 2): 1},
            'makes 1 counts per',
        ),
    ],
)
def test_units_gearing_and_polarity_match_the_profile(objects, words):
    axis = AxisSettings(pulses_per_revolution=500, velocity_unit='rpm')
    found = unit_conflicts(lambda *key: answer(objects.get(key)), axis)
    problems = result_of(found)
    assert len(problems) == bool(words)
    assert words in ''.join(problems)
    assert all('; next: ' in one for one in problems)


AXIS = AxisSettings(node_id=2, vendor_id=0xFB, product_code=7, serial_number=222)
GENUINE = {
    'device_type': 0x00020192,
    'vendor_id': 0xFB,
    'product_code': 7,
    'serial_number': 222,
}


class Objects(SdoChannel):
    """Identity objects of a drive, in the order of `GENUINE`."""

    name = 'q2'
    node_id = 2

    def __init__(self, **changes):
        numbers = (GENUINE | changes).values()
        keys = ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4))
        self._numbers = dict(zip(keys, numbers, strict=True))

    def read_number(self, index, subindex=0, signed=False):
        if (number := self._numbers[index, subindex]) is None:
            raise SdoAbortError('object does not exist', 0x06020000)
        return answer(number)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        *(
            ({field: 999}, rf'q2 \(node 2\): {field} = 999 .*another drive')
            for field in [*GENUINE][1:]
        ),
        ({'serial_number': 333}, 'the drive of q3: the axes are swapped'),
        # an axis whose configured number is 0, which accepts any, has no twin
        ({'serial_number': 0}, 'serial_number = 0 .* 222: this drive has no'),
        (
            {'serial_number': None},
            'serial_number = None .* 222: this drive has no',
        ),
        ({'device_type': 401}, 'device type 401 is not 402'),
    ],
)
def test_other_identity_is_rejected_with_the_difference(change, message):
    result_of(check_identity(Objects(), AXIS, {}))
    serials = {0: 'q1', 222: 'q2', 333: 'q3'}
    with pytest.raises(DriveError, match=message):
        result_of(check_identity(Objects(**change), AXIS, serials))


# --- settings


@pytest.mark.parametrize(
    'make',
    [
        lambda: check_axes((AxisSettings(), *DEFAULT_AXES[:2])),
        lambda: check_axes(
            tuple(replace(axis, serial_number=5) for axis in DEFAULT_AXES)
        ),
        lambda: controller(
            axes=(replace(DEFAULT_AXES[0], homing_method=-5), *DEFAULT_AXES[1:])
        ),
        *(
            lambda details=details: AxisSettings(**details)
            for details in (
                {'node_id': 127},
                {'lead': 0.0},
                {'direction': 0},
                {'efficiency': 1.1},
                {'home_position': -0.51},
                {'home_position': 0.51},
            )
        ),
        *(
            lambda details=details: ControllerSettings(**details)
            for details in ({'rate': 300}, {'rate': 1000}, {'heartbeat_timeout': 0.09})
        ),
    ],
)
def test_contradictory_settings_are_rejected(make):
    with pytest.raises(ParameterError):
        make()
