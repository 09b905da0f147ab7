"""
What is written to a drive at configure, and how it is proved: identity, objects, PDO map.

Every object is read back. What a drive rejects counts only where it then reads back another value:
an object may be constant, and right. A mismatch rejects the drive, and the message names them all;
an object that the drive's profile calls optional and the drive does not know is skipped.

References
----------
CiA 301: device type 1000h, identity 1018h, heartbeat 1016h/1017h, PDO parameters.
IEC 61800-7-201 (CiA 402-2): the objects 6xxxh.

"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.pdo import Pdo, Write
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.bus_load import transmission_type
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.units import COUNTS, VELOCITY_UNITS
from facade_manipulator.errors import DriveIdentityError, DriveObjectError, ParameterError

DEVICE_TYPE = 402
_SET = 'set it in the drive, or among the objects of its profile'

Read = Callable[[int, int], 'int | None']


class Identity(NamedTuple):
    """What a drive says it is: 1000h and 1018h:1, 2, 4; None for what it does not say."""

    device_type: int
    vendor_id: int
    product_code: int | None
    serial_number: int | None


def quantities(
    axis: AxisSettings, settings: ControllerSettings, motor_speed_unit: str | None = None
) -> dict[str, int]:
    """
    Return the values that a profile's objects may ask for, in the drive's units.

    The axis has the units of the drive's profile; that of 6080h is the velocity unit by default.
    Raises a ParameterError if a speed or acceleration would be 0 in them.
    """
    motor = replace(axis, velocity_unit=motor_speed_unit or axis.velocity_unit)
    ramp = replace(axis, velocity_unit=axis.acceleration_unit or axis.velocity_unit)
    ends = sorted(axis.to_counts(end) for end in (
        axis.lower_limit - axis.limit_margin, axis.upper_limit + axis.limit_margin))
    return {
        'quick_stop_deceleration': _units(ramp, 'stop_deceleration'),
        'max_velocity': _units(axis, 'max_speed'),
        'max_acceleration': _units(ramp, 'max_acceleration'),
        'homing_switch_speed': _units(axis, 'homing_speed'),
        'homing_zero_speed': _units(axis, 'homing_speed', axis.homing_zero_share),
        'homing_acceleration': _units(ramp, 'homing_acceleration'),
        'max_motor_speed': _units(motor, 'max_speed'),
        'master_heartbeat': pdo.MASTER_NODE_ID << 16 | _milliseconds(settings.heartbeat_timeout),
        'heartbeat_time': _milliseconds(settings.heartbeat_period),
        'following_error_window': abs(axis.to_counts(axis.following_error_window)),
        'following_error_time': _milliseconds(axis.following_error_time),
        'min_position': ends[0],
        'max_position': ends[1],
        'interpolation_period': _milliseconds(settings.period),
        'sync_period': round(1e6 * settings.period),
        'homing_method': axis.homing_method,
        'home_position': axis.to_counts(axis.home_position),
        'home_offset': axis.to_counts(-axis.home_position),
        'homing_current_threshold': round(1000.0 * axis.homing_current),
    }


def _units(axis: AxisSettings, name: str, share: float = 1.0) -> int:
    """Return a share of a speed or acceleration of an axis, in its velocity unit, at least 1."""
    value = getattr(axis, name)
    if units := axis.magnitude_to_units(share * value):
        return units
    least = abs(axis.si_per_unit.velocity) / share
    si, per_time = ('m/s', '') if name.endswith('speed') else ('m/s^2', ' per second')
    raise ParameterError(
        f'{name} = {value:g} {si} of node {axis.node_id} is below {least:.3g} {si}: the drive '
        f'would get 0 {axis.velocity_unit}{per_time}')


def drive_writes(
    profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings
) -> list[Write]:
    """Return all that is written to a drive: `object_writes`, then `pdo_writes`."""
    return (object_writes(profile, axis, settings)
            + pdo_writes(axis.node_id, settings.rate, profile.pdos))


def object_writes(
    profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings
) -> list[Write]:
    """
    Return the writes of a profile for an axis, in the profile's order.

    Raises a ParameterError if the drive type does not know the axis's homing method.
    """
    if axis.homing_method not in profile.homing_methods:
        known = ', '.join(map(str, profile.homing_methods))
        raise ParameterError(
            f'homing_method = {axis.homing_method} of node {axis.node_id} is not one that the '
            f'drive type {profile.name} supports: {known}')
    values = quantities(axis, settings, profile.motor_speed_unit)
    return [
        Write(item.index, item.subindex,
              values[item.value] if isinstance(item.value, str) else item.value,
              required=item.required)
        for item in profile.objects]


def pdo_writes(node_id: int, rate: int, pdos: tuple[Pdo, ...] = pdo.PDO_MAP) -> list[Write]:
    """Return the writes of a PDO map: the unused ones off, each used one set up in order."""
    used = [replace(one, transmission=transmission_type(one, rate)) for one in pdos]
    return ([one.disable_write(node_id) for one in pdo.unused_pdos(pdos)]
            + [write for one in used for write in one.configure_writes(node_id)])


def read_identity(drive: SdoChannel) -> Identity:
    """Read what a drive says it is; of the identity only the vendor must be there (CiA 301)."""
    return Identity(drive.read_number(0x1000), drive.read_number(0x1018, 1),
                    *(read_optional(drive, 0x1018, n) for n in (2, 4)))


def read_optional(drive: SdoChannel, index: int, subindex: int) -> int | None:
    """Return the number in an object, None where the drive has none."""
    try:
        return drive.read_number(index, subindex)
    except SdoAbortError as error:
        if not error.is_absent:
            raise
    return None


def check_identity(
    name: str, found: Identity, axis: AxisSettings, serials: dict[int, str]
) -> None:
    """
    Compare a drive's identity with the configured one; a configured 0 accepts any.

    `serials` has the axes by configured serial number, which distinguishes swapped axes from a
    replaced drive. Raises a DriveIdentityError that names what differs.
    """
    where = f'{name} (node {axis.node_id})'
    if found.device_type & 0xFFFF != DEVICE_TYPE:
        raise DriveIdentityError(
            f'{where}: device type {found.device_type & 0xFFFF} is not {DEVICE_TYPE}: '
            'this is no drive')
    for field in ('vendor_id', 'product_code', 'serial_number'):
        actual, configured = getattr(found, field), getattr(axis, field)
        if configured and actual is None:
            raise DriveIdentityError(
                f'{where}: the drive has no {field}: set the configured {configured} to 0')
        if configured and actual != configured:
            owner = serials.get(actual) if field == 'serial_number' else None
            raise DriveIdentityError(
                f'{where}: {field} = {actual} is not the configured {configured}: '
                f'{_whose(actual, owner)}')


def _whose(actual: int, owner: str | None) -> str:
    if not actual:  # a configured 0 is no drive's number
        return 'it has none: configure 0, or look at its maker and node id'
    if owner:
        return f'this is the drive of {owner}, the axes are swapped'
    return 'it is another drive: correct its node id or the configuration'


def write_objects(drive: SdoChannel, writes: list[Write]) -> list[str]:
    """
    Write objects and read each back; return what was skipped: the drive does not know it.

    Raises a DriveObjectError that names all objects that it rejects, or reads back with another
    value, a DriveTimeoutError if it does not answer.
    """
    rejections: dict[tuple[int, int], str] = {}
    for write in writes:
        try:
            drive.write(write.index, write.subindex, _encoded(drive, write))
        except DriveObjectError as error:
            rejections.setdefault((write.index, write.subindex), str(error))
    skipped = verify_objects(drive, writes, rejections)
    return [f'{drive.name} has no object {write}, which is optional' for write in skipped]


def write_drive(
    drive: SdoChannel, profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings
) -> tuple[list[str], bool]:
    """
    Write all objects of a drive, and verify its units.

    Returns what was skipped, and whether the drive stops when this computer falls silent; raises
    what `write_objects` and `verify_units` do.
    """
    notes = write_objects(drive, drive_writes(profile, axis, settings))
    verify_units(drive, axis)
    return notes, stops_without_master(drive, profile)


def verify_objects(
    drive: SdoChannel, writes: list[Write],
    rejections: Mapping[tuple[int, int], str] = MappingProxyType({}),
) -> list[Write]:
    """
    Compare objects with what was written; return the optional ones it lacks.

    `rejections` has what the drive said when it was written, by index and subindex. Raises what
    `write_objects` does.
    """
    found = compare_objects(drive, writes)
    problems = found.lacking + [
        f'{message}: {rejections[key]}' if (key := write[:2]) in rejections else message
        for write, message in found.different]
    if problems:
        raise DriveObjectError('; '.join(problems))
    return found.skipped


def verify_units(drive: SdoChannel, axis: AxisSettings) -> None:
    """
    Compare the units that a drive names with those of its profile; what it lacks says nothing.

    Raises a DriveObjectError that names each unit, gearing and polarity that differs, a
    DriveTimeoutError if it does not answer.
    """
    if problems := [f'{drive.name} (node {drive.node_id}): {problem}'
                    for problem in unit_conflicts(partial(read_optional, drive), axis)]:
        raise DriveObjectError('; '.join(problems))


def unit_conflicts(read: Read, axis: AxisSettings) -> Iterator[str]:
    """
    Yield what `verify_units` rejects: object, value, what is expected, and what to do.

    `read` returns the number in an object, None where there is none: of a drive, or of its EDS.
    """
    ramp_name = axis.acceleration_unit or axis.velocity_unit
    unit, ramp = VELOCITY_UNITS[axis.velocity_unit], VELOCITY_UNITS[ramp_name]
    if unit is ramp and (mixed := _mixed_units(read(0x60A9, 0), read(0x60AA, 0))):
        yield mixed
        return
    for index, expected, name, otherwise in (
            (0x60A8, COUNTS, 'counts', ''),
            (0x60A9, unit.velocity, axis.velocity_unit, ', or correct velocity_unit there'),
            (0x60AA, ramp.acceleration, f'{ramp_name} per second',
             ', or correct acceleration_unit there')):
        found = read(index, 0)
        if found and found != expected:  # 0 names no unit
            yield (f'unit {index:04X}h:00 = {found:08X}h, expected {expected:08X}h ({name}): '
                   f'{_SET}{otherwise}')
    if polarity := read(0x607E, 0):
        yield (f'polarity 607Eh:00 = {polarity:02X}h, expected 00h: {_SET}, the sign is '
               "that of the axis's direction")
    counts = _counts_per_revolution(read)
    if counts is not None and abs(counts - axis.counts_per_revolution) > 0.5:
        yield (f'the gearing 608Fh, 6091h, 6092h makes {counts:.10g} counts per revolution of the '
               f'motor, expected {axis.counts_per_revolution}: {_gearing_remedy(counts, axis)}')


def _mixed_units(velocity: int | None, acceleration: int | None) -> str:
    """Return that velocities are stated in another unit than accelerations, ``''`` if not."""
    for name, one in VELOCITY_UNITS.items():
        if acceleration == one.acceleration and velocity not in (None, 0, one.velocity):
            return (f'it states velocities (60A9h:00 = {velocity:08X}h) in another unit than '
                    f'accelerations (60AAh:00 = {acceleration:08X}h, {name} per second): set '
                    f'60A9h to {one.velocity:08X}h in the drive')
    return ''


def _gearing_remedy(counts: float, axis: AxisSettings) -> str:
    if counts == 1.0:  # 6092h as Nanotec's come; Novanta's make no use of it, but take it
        return (f'set 6092h:01 to {axis.counts_per_revolution} in the drive, or among the objects '
                'of its profile')
    return 'correct it, or counts_per_revolution in its profile'


def _counts_per_revolution(read: Read) -> float | None:
    """Return feed (or else encoder resolution) by gear ratio; None where it says neither."""
    feed, resolution = _ratio(read, 0x6092), _ratio(read, 0x608F)
    if resolution == 1.0 and feed in (None, 1.0):  # as Elmo's Gold comes: counts of the encoder
        return None
    feed = feed or resolution
    return feed and feed / (_ratio(read, 0x6091) or 1.0)


def _ratio(read: Read, index: int) -> float | None:
    over = read(index, 1)
    under = read(index, 2) if over else None
    return over / under if over and under else None


def stops_without_master(drive: SdoChannel, profile: DriveProfile) -> bool:
    """Return whether a drive, as it is now, stops when this master falls silent."""
    watched = read_optional(drive, *profile.heartbeat_consumer) or 0
    reaction = read_optional(drive, profile.lost_master_reaction, 0)
    return bool(watched >> 16 == pdo.MASTER_NODE_ID and watched & 0xFFFF and reaction)


class Deviations(NamedTuple):
    """What is not as it is to be written."""

    #: what writing does not help: no such object, or one too small for the value
    lacking: list[str]
    different: list[tuple[Write, str]]  #: objects of another value, with a message
    skipped: list[Write]  #: optional objects that the drive does not have


def compare_objects(drive: SdoChannel, writes: list[Write]) -> Deviations:
    """
    Read objects and compare them with what is to be written.

    Raises a DriveTimeoutError if the drive does not answer.
    """
    found = Deviations([], [], [])
    for write in writes:
        if not write.compared:
            continue
        try:
            if difference := _difference(drive, write):
                found.different.append((write, difference))
        except DriveObjectError as error:
            if isinstance(error, SdoAbortError) and error.is_absent and not write.required:
                found.skipped.append(write)
            else:
                found.lacking.append(str(error))
    return found


def _encoded(drive: SdoChannel, write: Write) -> bytes:
    # as the map or the EDS says, else as the drive answers
    size = (write.size or drive.size(write.index, write.subindex)
            or len(drive.read(write.index, write.subindex)))
    value = write.value % (1 << 8 * size)
    if value != write.value and value - (1 << 8 * size) != write.value:
        raise DriveObjectError(
            f'{drive.name} (node {drive.node_id}): {write.value} does not fit into the '
            f'{size} bytes of object {write}')
    return value.to_bytes(size, 'little')


def _difference(drive: SdoChannel, write: Write) -> str:
    """Return how an object differs from what is to be written, ``''`` if it does not."""
    data = _encoded(drive, write)
    mask = write.compared & ((1 << 8 * len(data)) - 1)
    expected = int.from_bytes(data, 'little')
    found = int.from_bytes(drive.read(write.index, write.subindex)[:len(data)], 'little')
    if not (found ^ expected) & mask:
        return ''
    return (f'{drive.name} (node {drive.node_id}): object {write} reads back as {found} '
            f'({found:X}h) instead of {expected} ({expected:X}h)')


def _milliseconds(time: float) -> int:
    return round(1000.0 * time)
