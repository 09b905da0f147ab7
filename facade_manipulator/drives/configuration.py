"""
Configuration of a drive: objects are written, read back, and its identity is checked.

A rejected write counts only if the value read back differs, because the object may be constant
and correct. A mismatch rejects the drive, and the message names all objects that differ.
An optional object that the drive does not have is skipped. The functions that use objects are
generators, which yield while they wait for the drive.

References
----------
CiA 301: device type 1000h, identity 1018h, heartbeat 1016h/1017h, PDO parameters.
IEC 61800-7-201 (CiA 402-2): the objects 6xxxh.

"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

from facade_manipulator.canopen import cob_ids, indices, nmt, pdo, sync
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import SupervisedHeartbeat
from facade_manipulator.canopen.pdo import Write
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel, Steps
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.monitor import AxisMonitor, REST_SPEED
from facade_manipulator.drives.profile import DriveProfile, quantities
from facade_manipulator.drives.states import decode_state, POWERED_STATES, State
from facade_manipulator.drives.units import COUNTS, VELOCITY_UNITS
from facade_manipulator.errors import (
    BusError,
    DriveError,
    DriveObjectError,
    ParameterError,
)

DEVICE_TYPE = 402
IS_OPERATIONAL = 'is operational'  # use of a drive by another master, or by itself
Read = Callable[[int, int], Steps['int | None']]


# masks of the bits that are not reserved, by index; a drive may set the others
_USED_BITS = {
    indices.COB_ID_SYNC: sync.PRODUCER | cob_ids.EXTENDED_FRAME | cob_ids.COB_ID_BITS,
    indices.COB_ID_EMERGENCY: cob_ids.NOT_VALID
    | cob_ids.EXTENDED_FRAME
    | cob_ids.COB_ID_BITS,
    indices.CONSUMER_HEARTBEAT_TIME: nmt.SUPERVISED_HEARTBEAT_BITS,
}
_UNIT_BITS = 0xFFFFFF00  # prefix, numerator and denominator of a unit

# --- the writes of a drive


def drive_writes(
    profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings
) -> list[Write]:
    """
    Return the writes to a drive: the objects of its profile in order, then the PDO map.

    Unused PDOs are disabled. Raises a ParameterError if the drive type does not know the axis's
    homing method.
    """
    if axis.homing_method not in profile.homing_methods:
        known = ', '.join(map(str, profile.homing_methods))
        raise ParameterError(
            f'homing_method = {axis.homing_method} of node {axis.node_id} is not supported by the '
            f'drive type {profile.name}; next: set one of {known}'
        )
    values = quantities(axis, settings, profile.motor_speed_unit)
    return [
        *(
            Write(
                item.index,
                item.subindex,
                values[item.value] if isinstance(item.value, str) else item.value,
                required=item.required,
                compared=_USED_BITS.get(item.index, pdo.ALL_BITS),
            )
            for item in profile.objects
        ),
        *(one.disable_write(axis.node_id) for one in pdo.unused_pdos(profile.pdos)),
        *(
            write
            for one in profile.pdos
            for write in one.configure_writes(axis.node_id, settings.rate)
        ),
    ]


# --- objects, written and read back


def apply(drive: SdoChannel, writes: list[Write]) -> Steps[list[str]]:
    """
    Write objects and read each back; return notes of missing optional objects.

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
        raise DriveObjectError(
            '; '.join(
                text
                if (rejection := rejections.get(name, text)) == text
                else f'{text}: {rejection}'
                for name, text in found.problems.items()
            )
        )
    return found.notes


class Comparison(NamedTuple):
    """Comparison of the objects of a drive with their configured values."""

    problems: dict[str, str]  #: messages by object that differs or cannot be read
    notes: list[str]  #: missing optional objects
    unreadable: set[
        str
    ]  #: the objects among `problems` that the drive lacks or rejects

    @property
    def changed(self) -> list[str]:
        """Return the objects that have another value."""
        return [name for name in self.problems if name not in self.unreadable]


def check(drive: SdoChannel, writes: list[Write]) -> Steps[Comparison]:
    """
    Compare the objects of a drive with their configured values.

    Raises a DriveTimeoutError if the drive does not answer.
    """
    found = Comparison({}, [], set())
    for write in writes:
        if not write.compared:
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
    # the size is that of the map or the EDS, else that of the answer of the drive
    size = write.size or drive.size(write.index, write.subindex)
    if not size:
        size = len((yield from drive.read(write.index, write.subindex)))
    value = write.value % (1 << 8 * size)
    if value != write.value and value - (1 << 8 * size) != write.value:
        raise DriveObjectError(
            f'{drive.name} (node {drive.node_id}): {write.value} does not fit into the '
            f'{size} bytes of object {write}'
        )
    return value.to_bytes(size, 'little')


def _difference(drive: SdoChannel, write: Write) -> Steps[str]:
    """Return how an object differs from its configured value, ``''`` if equal."""
    data = yield from _encoded(drive, write)
    mask = write.compared & ((1 << 8 * len(data)) - 1)
    expected = int.from_bytes(data, 'little')
    answer = yield from drive.read(write.index, write.subindex)
    found = int.from_bytes(answer[: len(data)], 'little')
    if not (found ^ expected) & mask:
        return ''
    return (
        f'{drive.name} (node {drive.node_id}): object {write} reads back as {found} '
        f'({found:X}h) instead of {expected} ({expected:X}h)'
    )


def read_optional(
    drive: SdoChannel, index: int, subindex: int, **sign: bool
) -> Steps[int | None]:
    """Return the number in an object, None if the drive lacks the object."""
    try:
        return (yield from drive.read_number(index, subindex, **sign))
    except SdoAbortError as error:
        if not error.is_absent:
            raise
    return None


def stops_without_master(drive: SdoChannel, profile: DriveProfile) -> Steps[bool]:
    """Return whether a drive with its present objects stops when this master is silent."""
    watched = (yield from read_optional(drive, *profile.heartbeat_consumer)) or 0
    reaction = yield from read_optional(drive, profile.lost_master_reaction, 0)
    node, timeout = SupervisedHeartbeat.decode(watched)
    return bool(node == cob_ids.MASTER_NODE_ID and timeout and reaction)


# --- units and identity


def unit_conflicts(read: Read, axis: AxisSettings) -> Steps[list[str]]:
    """
    Return units, gearing and polarity of a drive that differ from its profile, with a remedy.

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
        (indices.POLARITY, 0, 0xFF, "no polarity: the axis's direction has the sign"),
    ):
        found = yield from read(index, 0)
        if found and (found ^ expected) & used:
            conflicts.append(
                f'object {index:04X}h:00 = {found:X}h, expected {expected:X}h ({name}): set it '
                'in the drive or among the objects of its profile, or correct the unit there'
            )
    counts = yield from _counts_per_revolution(read)
    if counts is not None and abs(counts - axis.counts_per_revolution) > 0.5:
        # Nanotec's drives have a feed of 1; Novanta's accept 6092h without using it
        conflicts.append(
            f'the gearing 608Fh, 6091h, 6092h makes {counts:.10g} counts per revolution of the '
            f'motor, expected {axis.counts_per_revolution}: correct it in the drive (6092h:01 '
            f'= {axis.counts_per_revolution}, for a gear of 1), or correct '
            'axes.pulses_per_revolution'
        )
    return conflicts


def _counts_per_revolution(read: Read) -> Steps[float | None]:
    """Return feed, or else encoder resolution, divided by gear ratio; None if both are missing."""
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
    """Return the ratio of the subindices 1 and 2, None if one is absent or 0."""
    over = yield from read(index, 1)
    if not over:
        return None
    under = yield from read(index, 2)
    return over / under if under else None


def check_identity(
    drive: SdoChannel, axis: AxisSettings, serials: dict[int, str]
) -> Steps[int | None]:
    """
    Require the configured identity of a drive; return its serial number, None if it has none.

    A configured 0 accepts any number. `serials` has the axes by configured serial number, which
    distinguishes swapped axes from a replaced drive. Raises a DriveObjectError that names the
    difference.
    """
    where = f'{drive.name} (node {drive.node_id})'
    device_type = yield from drive.read_number(indices.DEVICE_TYPE)
    kind = device_type & 0xFFFF
    if kind != DEVICE_TYPE:
        raise DriveObjectError(
            f'{where}: device type {kind} is not {DEVICE_TYPE}: this is not a drive'
        )
    numbers: dict[str, int | None] = {}
    for subindex, name in (
        (1, 'vendor_id'),
        (2, 'product_code'),
        (4, 'serial_number'),
    ):
        numbers[name] = yield from read_optional(drive, indices.IDENTITY, subindex)
    for name, actual in numbers.items():
        configured = getattr(axis, name)
        if not configured or actual == configured:
            continue
        remedy = 'it is another drive: correct its node id or the configuration'
        if not actual:
            remedy = (
                'the drive has no number: configure 0, or check its maker and node id'
            )
        elif name == 'serial_number' and actual in serials:
            remedy = f'this is the drive of {serials[actual]}, the axes are swapped'
        raise DriveObjectError(
            f'{where}: {name} = {actual} is not the configured {configured}: {remedy}'
        )
    return numbers['serial_number']


# --- one drive in use


class DriveSteps:
    """Steps of one drive, with their result or error after the end."""

    def __init__(self, steps: Steps[Any]) -> None:
        self.is_done = False
        self.error: Exception | None = None
        self._steps = steps
        self._result: Any = None

    def resume(self) -> None:
        """Resume the steps until they wait again or end; never raise."""
        try:
            next(self._steps)
        except StopIteration as end:
            self._result = end.value
            self.is_done = True
        except (
            Exception
        ) as error:  # the request raises it, with those of the other drives
            self.error = error
            self.is_done = True

    def result(self) -> Any:
        """Return the result of the steps, or raise their error."""
        if self.error is not None:
            raise self.error
        return self._result

    def close(self) -> None:
        """End the steps where they wait."""
        self._steps.close()


class Drive:
    """
    Identity, configuration and power of one drive, by SDO.

    `identify`, `configure`, `prove`, `use` and `switch_off` are generators. They raise a
    DriveError that names the drive and its failure, or a BusError if the bus is lost. `begin`
    starts one of them. Each answer of the drive resumes it at once, because a drive has more
    than a hundred objects. The request resumes it in each cycle, for its time-outs. The total
    time of its SDO answers is limited, so that a slow drive fails like a silent one.
    """

    def __init__(
        self,
        bus: CanBus,
        monitor: AxisMonitor,
        settings: ControllerSettings,
        clock: Clock,
        serials: dict[int, str],
    ) -> None:
        axis = monitor.axis
        profile = monitor.profile
        self.monitor = monitor
        self.objects = SdoChannel(bus, axis.node_id, monitor.name, profile.eds, clock)
        self.produces_sync = False  #: whether the drive was found to send SYNC itself
        self.sync_period = 0.0  #: period of the SYNC that the drive sends [s]
        self.guard_time = 0.0  #: period in which a master may guard the drive [s]
        self._settings = settings
        self._serials = serials
        self._writes = drive_writes(profile, axis, settings)
        self._steps: DriveSteps | None = None

    # --- steps in progress

    def begin(self, steps: Steps[Any], deadline: float) -> DriveSteps:
        """Begin steps that send no request after a time [s]; return them."""
        self.objects.deadline = deadline
        self._steps = DriveSteps(steps)
        self._steps.resume()
        return self._steps

    def receive(self, frame: Frame) -> None:
        """Receive an answer of the drive, and resume the steps that wait for it."""
        self.objects.receive(frame)
        self.resume()

    def resume(self) -> None:
        """Resume the steps in progress, if any."""
        if self._steps is not None and not self._steps.is_done:
            self._steps.resume()

    def end(self) -> None:
        """End the steps in progress, if any."""
        if self._steps is not None:
            self._steps.close()
        self._steps = None

    # --- identity, configuration, power

    def identify(self) -> Steps[None]:
        """Check the identity, and store the serial number."""
        self.monitor.serial_number = yield from check_identity(
            self.objects, self.monitor.axis, self._serials
        )

    def configure(self) -> Steps[list[str]]:
        """Write and prove all objects; return notes of skipped objects and missing checks."""
        monitor = self.monitor
        notes = yield from self._end_sync()
        notes += yield from apply(self.objects, self._writes)
        problems = yield from self._unit_conflicts()
        if problems:
            raise DriveObjectError('; '.join(problems))
        monitor.stops_without_master = yield from stops_without_master(
            self.objects, monitor.profile
        )
        if monitor.serial_number and not monitor.axis.serial_number:
            notes.append(
                f'{monitor.title} accepts any drive: set its serial_number, now '
                f'{monitor.serial_number}, so that swapped axes are found'
            )
        return notes

    def _read_optional(self, index: int, subindex: int) -> Steps[int | None]:
        return read_optional(self.objects, index, subindex)

    def _find_sync(self) -> Steps[int]:
        """Return the COB-ID of SYNC (1005h), and record whether the drive sends SYNC."""
        cob_id = (yield from self._read_optional(indices.COB_ID_SYNC, 0)) or 0
        if cob_id & sync.PRODUCER:
            self.produces_sync = True
            period = yield from self._read_optional(indices.SYNC_PERIOD, 0)
            self.sync_period = 1e-6 * (period or 0)
        return cob_id

    def _end_sync(self) -> Steps[list[str]]:
        """End the SYNC that the drive sends; return notes for the operator."""
        cob_id = yield from self._find_sync()
        if not cob_id & sync.PRODUCER:
            return []
        silenced = cob_id & ~sync.PRODUCER
        found = f'{self.monitor.title} sends SYNC itself (1005h = {cob_id:X}h)'
        remedy = f'store 1005h = {silenced:X}h in the drive'
        try:
            yield from self.objects.write(
                indices.COB_ID_SYNC, 0, silenced.to_bytes(4, 'little')
            )
        except DriveObjectError as error:
            raise DriveObjectError(f'{found}: {error}; next: {remedy}') from error
        present = yield from self._read_optional(indices.COB_ID_SYNC, 0)
        if (present or 0) & sync.PRODUCER:
            raise DriveObjectError(f'{found} and keeps this setting; next: {remedy}')
        return [f'{found} until configure ends it, after each reset; next: {remedy}']

    def _unit_conflicts(self) -> Steps[list[str]]:
        conflicts = yield from unit_conflicts(self._read_optional, self.monitor.axis)
        return [f'{self.monitor.title}: {problem}' for problem in conflicts]

    def prove(self) -> Steps[None]:
        """Check identity, units and objects, and change nothing."""
        yield from self.identify()
        compared = yield from check(self.objects, self._writes)
        problems = yield from self._unit_conflicts()
        problems += compared.problems.values()
        if problems:
            raise DriveObjectError('; '.join(problems))

    def use(self) -> Steps[str]:
        """
        Return a use of the drive that this driver has not commanded, ``''`` for none.

        Another master may send seldom or never, but the state of the drive shows it. A drive that
        this driver has left behind watches its heartbeat (1016h), misses it, and has stopped.
        """
        monitor = self.monitor
        state = yield from self._state()
        if state is None:
            return ''  # the drive is absent, or its reset shows the problem
        yield from self._find_sync()
        guard_time = yield from self._read_optional(indices.GUARD_TIME, 0)
        self.guard_time = 1e-3 * (guard_time or 0)

        speed = yield from read_optional(
            self.objects, indices.ACTUAL_VELOCITY, 0, signed=True
        )
        velocity = monitor.axis.si_per_unit.velocity * (speed or 0)
        if abs(velocity) > REST_SPEED:
            return f'{monitor.title} moves at {velocity:.3g} m/s'

        watched = yield from self._read_optional(*monitor.profile.heartbeat_consumer)
        node, timeout = SupervisedHeartbeat.decode(watched or 0)
        misses_us = (
            node == cob_ids.MASTER_NODE_ID
            and 0 < timeout <= 1e3 * self._settings.heartbeat_timeout
        )
        has_stopped = misses_us and state is State.QUICK_STOP_ACTIVE
        if state in POWERED_STATES and not has_stopped:
            return f'{monitor.title} has power ({state.value})'
        if monitor.nmt_state == 'OPERATIONAL' and not misses_us:
            starts_itself = yield from self._starts_itself()
            if not starts_itself:
                return f'{monitor.title} {IS_OPERATIONAL}'
        return ''

    def _starts_itself(self) -> Steps[bool]:
        """Return whether the drive becomes operational without a command after its boot-up."""
        startup = yield from self._read_optional(indices.NMT_STARTUP, 0)
        is_stored = startup is not None and not startup & nmt.WAITS_FOR_START
        return self.monitor.profile.quirks.starts_itself or is_stored

    def switch_off(self) -> Steps[State | None]:
        """Switch the drive off; return its state, None without an answer."""
        with suppress(
            DriveError, BusError
        ):  # a drive that does not answer is asked once more
            # disable voltage
            yield from self.objects.write(indices.CONTROLWORD, 0, bytes(2))
        return (yield from self._state())

    def _state(self) -> Steps[State | None]:
        """Return the state of the drive, None without a timely answer or a valid state."""
        try:
            word = yield from self.objects.read_number(indices.STATUSWORD)
        except (DriveError, BusError):
            return None
        return decode_state(word)
