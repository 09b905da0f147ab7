"""
What is written to a drive at configure, and how it is proved: identity, objects, PDO map.

Every object is read back. A mismatch rejects the drive and names the object; an object that the
drive's profile calls optional and the drive does not know is skipped and reported.

References
----------
CiA 301: device type 1000h, identity 1018h, heartbeat 1016h/1017h, PDO parameters.
IEC 61800-7-201 (CiA 402-2): the objects 6xxxh.

"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from facade_manipulator.drives.canopen import (
    MASTER_NODE_ID,
    NO_REMOTE,
    Pdo,
    PDO_MAP,
    SdoAbortError,
    UNUSED_PDOS,
)
from facade_manipulator.drives.cia402 import AxisSettings, DriveProfile
from facade_manipulator.drives.controller.bus_load import transmission_type
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.errors import DriveIdentityError, DriveObjectError, ParameterError

DEVICE_TYPE = 402
_LARGEST_UNSIGNED = 0xFFFFFFFF


class Objects(Protocol):
    """The objects of one drive, as `facade_manipulator.drives.canopen.sdo.SdoChannel` has them."""

    name: str
    node_id: int

    def read(self, index: int, subindex: int) -> bytes:
        """Read an object and wait for the answer."""

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object and wait for the confirmation."""

    def size(self, index: int, subindex: int) -> int | None:
        """Return an object's bytes, None if the drive's EDS does not know it."""


class Write(NamedTuple):
    """
    One object to write.

    Attributes
    ----------
    index, subindex, value : int
    size : int or None
        Bytes; None for what the drive's object dictionary says.
    required : bool
        Whether a drive without the object is rejected.
    compared : int
        Mask of the bits that must be read back as written; 0 for an intermediate value.

    """

    index: int
    subindex: int
    value: int
    size: int | None = None
    required: bool = True
    compared: int = _LARGEST_UNSIGNED

    def __str__(self) -> str:
        return f'{self.index:04X}h:{self.subindex:02X}'


class Identity(NamedTuple):
    """What a drive says it is: 1000h and 1018h:1, 2, 4."""

    device_type: int
    vendor_id: int
    product_code: int
    serial_number: int


def quantities(axis: AxisSettings, settings: ControllerSettings) -> dict[str, int]:
    """
    Return the values that a profile's objects may ask for, in the drive's units.

    Parameters
    ----------
    axis : AxisSettings
        With the velocity unit of the drive's profile.
    settings : ControllerSettings

    """
    ends = sorted(axis.to_counts(end) for end in (
        axis.lower_limit - axis.limit_margin, axis.upper_limit + axis.limit_margin))
    speed = {
        name: axis.magnitude_to_units(value) for name, value in (
            ('quick_stop_deceleration', axis.stop_deceleration),
            ('max_velocity', axis.max_speed),
            ('max_motor_speed', axis.max_speed),
            ('max_acceleration', axis.max_acceleration),
            ('homing_switch_speed', axis.homing_speed),
            ('homing_zero_speed', axis.homing_zero_speed),
            ('homing_acceleration', axis.homing_acceleration))}
    return {
        **speed,
        'master_heartbeat': MASTER_NODE_ID << 16 | _milliseconds(settings.heartbeat_timeout),
        'heartbeat_time': _milliseconds(settings.heartbeat_period),
        'following_error_window': abs(axis.to_counts(axis.following_error_window)),
        'following_error_time': _milliseconds(axis.following_error_time),
        'min_position': ends[0],
        'max_position': ends[1],
        'interpolation_period': _milliseconds(settings.period),
        'homing_method': axis.homing_method,
        'home_position': axis.to_counts(axis.home_position),
        'homing_current_threshold': round(1000.0 * axis.homing_current),
    }


def object_writes(
    profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings
) -> list[Write]:
    """
    Return the writes of a profile for an axis, in the profile's order.

    Raises
    ------
    ParameterError
        The drive type does not know the axis's homing method.

    """
    if axis.homing_method not in profile.homing_methods:
        known = ', '.join(map(str, profile.homing_methods))
        raise ParameterError(
            f'homing_method = {axis.homing_method} of node {axis.node_id} is none that the drive '
            f'type {profile.name} supports: {known}')
    values = quantities(axis, settings)
    return [
        Write(item.index, item.subindex,
              values[item.value] if isinstance(item.value, str) else item.value,
              required=item.required)
        for item in profile.objects]


def pdo_writes(node_id: int, rate: int) -> list[Write]:
    """Return the writes of the PDO map: the unused ones off, each used one set up in order."""
    unused = [write for pdo in UNUSED_PDOS for write in _off(pdo, node_id)]
    return unused + [write for pdo in PDO_MAP for write in _set_up(pdo, node_id, rate)]


def _off(pdo: Pdo, node_id: int) -> list[Write]:
    """Only the bit that says off is compared: a drive may keep a COB-ID of its own in there."""
    return [
        Write(*write, required=False, compared=1 << 31) for write in pdo.disable_writes(node_id)]


def _set_up(pdo: Pdo, node_id: int, rate: int) -> Iterator[Write]:
    """Of an object that is written twice only the last value can be read back."""
    writes = pdo.configure_writes(node_id)
    last = {(write.index, write.subindex): number for number, write in enumerate(writes)}
    for number, (index, subindex, value, size) in enumerate(writes):
        is_communication = index == pdo.communication_index
        if is_communication and subindex == 2:
            value = transmission_type(pdo, rate)
        bits = _LARGEST_UNSIGNED & ~(NO_REMOTE if is_communication and subindex == 1 else 0)
        final = last[index, subindex] == number
        yield Write(index, subindex, value, size, compared=bits if final else 0)


def read_identity(drive: Objects) -> Identity:
    """Read what a drive says it is."""
    return Identity(*(
        int.from_bytes(drive.read(index, subindex), 'little')
        for index, subindex in ((0x1000, 0), (0x1018, 1), (0x1018, 2), (0x1018, 4))))


def check_identity(
    name: str, found: Identity, axis: AxisSettings, serials: dict[int, str]
) -> None:
    """
    Compare a drive's identity with the configured one; a configured 0 accepts any.

    Parameters
    ----------
    name : str
        What the operator calls the axis.
    found : Identity
    axis : AxisSettings
    serials : dict
        Axis by configured serial number, which distinguishes swapped axes from a replaced drive.

    Raises
    ------
    DriveIdentityError
        Naming what differs.

    """
    where = f'{name} (node {axis.node_id})'
    if found.device_type & 0xFFFF != DEVICE_TYPE:
        raise DriveIdentityError(
            f'{where}: device type {found.device_type & 0xFFFF} is not {DEVICE_TYPE}: '
            'this is no drive')
    for field in ('vendor_id', 'product_code', 'serial_number'):
        actual, configured = getattr(found, field), getattr(axis, field)
        if configured and actual != configured:
            owner = serials.get(actual) if field == 'serial_number' else None
            reason = (f'this is the drive of {owner}, the axes are swapped' if owner else
                      'it is another drive: correct its node id or the configuration')
            raise DriveIdentityError(
                f'{where}: {field} = {actual} is not the configured {configured}: {reason}')


def write_objects(drive: Objects, writes: list[Write]) -> list[str]:
    """
    Write objects and read each back.

    Returns
    -------
    list of str
        What was skipped because the drive does not know it.

    Raises
    ------
    DriveObjectError
        The drive rejects an object, or reads back another value.
    DriveTimeoutError
        It does not answer.

    """
    skipped = []
    for write in writes:
        try:
            _write(drive, write)
        except SdoAbortError as error:
            if write.required or not error.is_absent:
                raise
            skipped.append(f'{drive.name} has no object {write}, which is optional')
    verify_objects(drive, writes)
    return skipped


def verify_objects(drive: Objects, writes: list[Write]) -> None:
    """
    Read objects and compare them with what was written.

    Raises
    ------
    DriveObjectError
        A drive rejects an object, or reads back another value.
    DriveTimeoutError
        It does not answer.

    """
    for write in writes:
        if not write.compared:
            continue
        try:
            _verify(drive, write)
        except SdoAbortError as error:
            if write.required or not error.is_absent:
                raise


def _write(drive: Objects, write: Write) -> None:
    size = _size(drive, write)
    value = write.value % (1 << 8 * size)
    if value != write.value and value - (1 << 8 * size) != write.value:
        raise DriveObjectError(
            f'{drive.name} (node {drive.node_id}): {write.value} does not fit into the '
            f'{size} bytes of object {write}')
    drive.write(write.index, write.subindex, value.to_bytes(size, 'little'))


def _verify(drive: Objects, write: Write) -> None:
    size = _size(drive, write)
    mask = write.compared & ((1 << 8 * size) - 1)
    data = drive.read(write.index, write.subindex)[:size]
    expected = write.value % (1 << 8 * size)
    found = int.from_bytes(data, 'little')
    if (found ^ expected) & mask:
        raise DriveObjectError(
            f'{drive.name} (node {drive.node_id}): object {write} reads back as {found} '
            f'({found:X}h) instead of {expected} ({expected:X}h)')


def _size(drive: Objects, write: Write) -> int:
    """Bytes of an object: as the map or the EDS says, else as the drive answers."""
    known = write.size or drive.size(write.index, write.subindex)
    return known or len(drive.read(write.index, write.subindex))


def _milliseconds(time: float) -> int:
    return round(1000.0 * time)
