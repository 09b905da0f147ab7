"""
Configuration of a drive: check its identity, write its objects and read them back.

A rejected write is an error only if the value read back differs, because the object may be
constant and correct. A mismatch rejects the drive, and the message names all objects that differ.
An optional object that the drive does not have is skipped. The functions that use objects are
generators, which yield while they wait for the drive.

References
----------
CiA 301: device type 1000h, identity 1018h, heartbeat 1016h/1017h, PDO parameters.
IEC 61800-7-201 (CiA 402-2): the objects 6xxxh.

"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from facade_manipulator.canopen import cob_ids, indices, nmt, pdo, sync
from facade_manipulator.canopen.nmt import SupervisedHeartbeat
from facade_manipulator.canopen.sdo import (
    ALL_BITS,
    SdoAbortError,
    SdoChannel,
    Steps,
    Write,
)
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import DriveProfile, quantities
from facade_manipulator.drives.units import COUNTS, VELOCITY_UNITS
from facade_manipulator.errors import DriveObjectError, NEXT, ParameterError

DEVICE_PROFILE = 402
Read = Callable[[int, int], Steps['int | None']]


# --- the writes of a drive


# masks of the bits that are not reserved, by index; a drive may set all other bits
_USED_VALUE_BITS = {
    indices.COB_ID_SYNC: sync.PRODUCER | cob_ids.EXTENDED_FRAME | cob_ids.COB_ID_BITS,
    indices.COB_ID_EMERGENCY: cob_ids.NOT_VALID
    | cob_ids.EXTENDED_FRAME
    | cob_ids.COB_ID_BITS,
    indices.CONSUMER_HEARTBEAT_TIME: nmt.SUPERVISED_HEARTBEAT_BITS,
}


def drive_writes(
    profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings
) -> list[Write]:
    """
    Return the writes that configure a drive: the objects of its profile, then the PDO map.

    Unused PDOs are disabled. Raises a ParameterError if the drive type does not support the axis's
    homing method.
    """
    if axis.homing_method not in profile.homing_methods:
        known = ', '.join(map(str, profile.homing_methods))
        raise ParameterError(
            f'homing_method = {axis.homing_method} of node {axis.node_id} is not supported by the '
            f'drive type {profile.name}; next: set one of {known}'
        )
    values = quantities(axis, settings, profile.motor_speed_unit)
    writes = []
    for item in profile.objects:
        value = item.value
        if isinstance(value, str):
            value = values[value]
        read_back = _USED_VALUE_BITS.get(item.index, ALL_BITS)
        write = Write(item.index, item.subindex, value)
        writes.append(write._replace(required=item.required, read_back=read_back))

    for unused in pdo.unused_pdos(profile.pdos):
        writes.append(unused.disable_write(axis.node_id))
    for used in profile.pdos:
        writes += used.configure_writes(axis.node_id, settings.rate)
    return writes


# --- objects, written and read back


def apply(drive: SdoChannel, writes: list[Write]) -> Steps[list[str]]:
    """
    Write objects and read each object back; return notes about missing optional objects.

    Raises a DriveObjectError that names all objects that the drive rejects or that read back with
    another value. Raises a DriveTimeoutError if the drive does not answer.
    """
    rejections: dict[str, str] = {}
    for write in writes:
        try:
            data = yield from _encoded(drive, write)
            yield from drive.write(write.index, write.subindex, data)
        except DriveObjectError as error:
            rejections.setdefault(str(write), str(error))
    found = yield from check(drive, writes)
    if found.problems:
        findings = []
        for name, text in found.problems.items():
            rejection = rejections.get(name, text)
            findings.append(text if rejection == text else f'{text}: {rejection}')
        raise DriveObjectError(*findings)
    return found.notes


class Comparison(NamedTuple):
    """Result of comparing the objects of a drive with their configured values."""

    problems: dict[str, str]  #: messages by object that differs or cannot be read
    notes: list[str]  #: missing optional objects
    unreadable: set[
        str
    ]  #: the objects among `problems` that the drive lacks or rejects

    @property
    def changed(self) -> list[str]:
        """Return the objects whose values differ from the configuration."""
        return [name for name in self.problems if name not in self.unreadable]


def check(drive: SdoChannel, writes: list[Write]) -> Steps[Comparison]:
    """
    Compare the objects of a drive with their configured values.

    Raises a DriveTimeoutError if the drive does not answer.
    """
    found = Comparison({}, [], set())
    for write in writes:
        if not write.read_back:
            continue
        name = str(write)
        try:
            difference = yield from _difference(drive, write)
            if difference:
                found.problems[name] = difference
        except DriveObjectError as error:
            is_absent = isinstance(error, SdoAbortError) and error.is_absent
            if is_absent and not write.required:
                note = f'{drive.name} has no object {write}, which is optional'
                found.notes.append(note)
            else:
                found.problems[name] = str(error)
                found.unreadable.add(name)
    return found


def _encoded(drive: SdoChannel, write: Write) -> Steps[bytes]:
    """Return the data bytes of a write; raise a DriveObjectError if the value does not fit."""
    # the PDO map or the EDS defines the size, or else the answer of the drive
    size = write.size or drive.size(write.index, write.subindex)
    if not size:
        size = len((yield from drive.read(write.index, write.subindex)))
    value = write.value % (1 << 8 * size)
    if value != write.value and value - (1 << 8 * size) != write.value:
        raise DriveObjectError(
            f'{drive.title}: {write.value} does not fit into the '
            f'{size} bytes of object {write}'
        )
    return value.to_bytes(size, 'little')


def _difference(drive: SdoChannel, write: Write) -> Steps[str]:
    """Describe how an object differs from its configured value; ``''`` if they are equal."""
    data = yield from _encoded(drive, write)
    mask = write.read_back & ((1 << 8 * len(data)) - 1)
    expected = int.from_bytes(data, 'little')
    answer = yield from drive.read(write.index, write.subindex)
    found = int.from_bytes(answer[: len(data)], 'little')
    if not (found ^ expected) & mask:
        return ''
    return (
        f'{drive.title}: object {write} reads back as {found} '
        f'({found:X}h) instead of {expected} ({expected:X}h)'
    )


def stops_without_master(drive: SdoChannel, profile: DriveProfile) -> Steps[bool]:
    """Return whether a drive, with its present objects, stops when this master is silent."""
    watched = (yield from drive.read_optional(*profile.heartbeat_consumer)) or 0
    reaction = yield from drive.read_optional(profile.lost_master_reaction, 0)
    node, timeout = SupervisedHeartbeat.decode(watched)
    return bool(node == cob_ids.MASTER_NODE_ID and timeout and reaction)


# --- units and identity


_UNIT_BITS = 0xFFFFFF00  # prefix, numerator and denominator of a unit


def unit_conflicts(read: Read, axis: AxisSettings) -> Steps[list[str]]:
    """
    Describe each unit, gear ratio and polarity that differs from the profile, with a remedy.

    `read` returns the number in an object of the drive, None if the drive lacks the object. An
    object that is absent or 0 states no unit.
    """
    conflicts = []
    ramp = axis.acceleration_unit or axis.velocity_unit
    for index, expected, used, name in (
        (indices.POSITION_UNIT, COUNTS, _UNIT_BITS, 'positions in counts'),
        (
            indices.VELOCITY_UNIT,
            VELOCITY_UNITS[axis.velocity_unit].velocity,
            _UNIT_BITS,
            axis.velocity_unit,
        ),
        (
            indices.ACCELERATION_UNIT,
            VELOCITY_UNITS[ramp].acceleration,
            _UNIT_BITS,
            f'{ramp} per second',
        ),
        (indices.POLARITY, 0, 0xFF, "no polarity: the axis's direction sets the sign"),
    ):
        found = yield from read(index, 0)
        if found and (found ^ expected) & used:
            conflicts.append(
                f'object {index:04X}h:00 = {found:X}h, expected {expected:X}h ({name})'
                f'{NEXT}write the expected value in the drive, or correct value or unit in the '
                'profile'
            )
    counts = yield from _counts_per_revolution(read)
    if counts is not None and abs(counts - axis.counts_per_revolution) > 0.5:
        # Nanotec's drives have a feed of 1; Novanta's accept 6092h without using it
        conflicts.append(
            f'the gearing in 608Fh, 6091h and 6092h makes {counts:.10g} counts per revolution of '
            f'the motor, expected {axis.counts_per_revolution}{NEXT}correct the gearing in the '
            f'drive (6092h:01 = {axis.counts_per_revolution} for a gear ratio of 1), or correct '
            'axes.pulses_per_revolution'
        )
    return conflicts


def _counts_per_revolution(read: Read) -> Steps[float | None]:
    """Return feed (or else encoder resolution) divided by gear ratio; None if both are missing."""
    feed = yield from _ratio(read, indices.FEED_CONSTANT)
    resolution = yield from _ratio(read, indices.ENCODER_RESOLUTION)
    # Elmo's Gold drives have counts of the encoder
    if resolution == 1.0 and feed in (None, 1.0):
        return None
    feed = feed or resolution
    if not feed:
        return None
    gear = yield from _ratio(read, indices.GEAR_RATIO)
    return feed / (gear or 1.0)


def _ratio(read: Read, index: int) -> Steps[float | None]:
    """Return the ratio of subindex 1 to subindex 2; None if either is absent or 0."""
    over = yield from read(index, 1)
    if not over:
        return None
    under = yield from read(index, 2)
    return over / under if under else None


def check_identity(
    drive: SdoChannel, axis: AxisSettings, serials: dict[int, str]
) -> Steps[int | None]:
    """
    Check the identity of a drive; return its serial number, None if the drive has none.

    A configured 0 accepts any number. `serials` maps configured serial numbers to axes, to
    distinguish swapped axes from a replaced drive. Raises a DriveObjectError that names the
    difference.
    """
    where = drive.title
    device_type = yield from drive.read_number(indices.DEVICE_TYPE)
    kind = device_type & 0xFFFF
    if kind != DEVICE_PROFILE:
        raise DriveObjectError(
            f'{where}: device type {kind} is not {DEVICE_PROFILE}: this is not a drive'
        )
    numbers: dict[str, int | None] = {}
    for subindex, name in (
        (1, 'vendor_id'),
        (2, 'product_code'),
        (4, 'serial_number'),
    ):
        numbers[name] = yield from drive.read_informative(indices.IDENTITY, subindex)
    for name, actual in numbers.items():
        configured = getattr(axis, name)
        if not configured or actual == configured:
            continue
        reason = 'this is another drive'
        remedy = 'correct its node id or the configuration'
        if not actual:
            reason = 'this drive has no such number'
            remedy = f'set {name} to 0, or check maker and node id of the drive'
        elif name == 'serial_number' and actual in serials:
            reason = f'this is the drive of {serials[actual]}: the axes are swapped'
            remedy = 'swap the node ids of both drives, or the node_id of both axes'
        raise DriveObjectError(
            f'{where}: {name} = {actual} is not the configured {configured}: {reason}'
            f'{NEXT}{remedy}'
        )
    return numbers['serial_number']
