"""
Bring the drives from power-up to NMT Operational, and check them again after a fault.

Runs in a worker thread: it waits for SDO answers, boot-up messages and heartbeats, which the
control thread receives meanwhile. A drive's own heartbeat is the proof of its NMT state, never the
command that was sent.

References
----------
CiA 301: network management, boot-up protocol, heartbeat protocol.

"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import threading
from typing import Any, NamedTuple, TypeVar

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import NmtCommand, NmtState
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives import configuration
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.monitor import AxisMonitor, REST_SPEED, STATUSWORD, VELOCITY
from facade_manipulator.drives.states import decode_state, POWERED_STATES, State, UNPOWERED_STATES
from facade_manipulator.errors import (
    BusError,
    DriveError,
    DriveIdentityError,
    DriveObjectError,
    DriveStateError,
    DriveTimeoutError,
)

LOOK_PERIOD = 0.005  # s
ASKING_TIMEOUT = 0.5  # s, for one object of a drive that need not be there
ERRORS_TIMEOUT = 0.3  # s, of one drive, all at once: who cuts the power asks by SDO after them
MOST_ERRORS = 4  # of the past ones, the newest
CONTROLWORD = 0x6040
ERROR_REGISTER, ERROR_CODE, PAST_ERRORS = 0x1001, 0x603F, 0x1003
DISABLE_VOLTAGE = bytes(2)
TURN_TIMEOUT = 25.0  # s, for all that is asked of one drive by SDO: 111 answers of 0.2 s
Result = TypeVar('Result')


class Finding(NamedTuple):
    """One result of a self-test."""

    name: str
    passed: bool
    message: str


class Drive(NamedTuple):
    """One drive: what was received from it, its objects."""

    monitor: AxisMonitor
    objects: SdoChannel


class Commissioning:
    """
    Configure and check the drives of one bus.

    Once `is_closing` is set, whoever waits for a drive gives up. Each step raises a DriveError,
    which says which drive failed at what, or a BusError if the bus is gone.
    """

    def __init__(
        self, bus: CanBus, drives: tuple[Drive, ...], settings: ControllerSettings,
        is_closing: threading.Event, clock: Clock,
    ) -> None:
        self._bus = bus
        self._drives = drives
        self._settings = settings
        self._is_closing = is_closing
        self._clock = clock

    def configure(self) -> list[str]:
        """
        Reset, identify, write, prove and start all drives.

        Returns what was skipped or not checked.
        """
        for _ in range(2):  # one may be switched on just now: its first boot-up misled
            notes, error = [], None
            try:
                notes = self._configure_once()
            except DriveError as failure:
                error = failure
            doubled = self._unexpected_boot_ups()
            if not doubled:
                break
        for monitor in doubled:
            raise DriveIdentityError(
                f'{monitor.title} sent {monitor.boot_ups} boot-up messages after one reset: '
                'more than one drive has this node id (commission scan names them), or its power '
                'fails') from error
        if error is not None:
            raise error
        return notes

    def _configure_once(self) -> list[str]:
        self._reset()
        self._command(NmtCommand.ENTER_PRE_OPERATIONAL, self._drives)
        self._of_each(self._check_identity)
        notes = self._of_each(self._write)
        self._start()
        return [note for of_drive in notes for note in of_drive]

    def _of_each(
        self, look: Callable[[Drive], Result], drives: Sequence[Drive] | None = None
    ) -> list[Result]:
        """
        Return what is found at each drive, by default of all; they are asked at the same time.

        Raises a DriveError with what is wrong with all of them, rather than with the first.
        """
        drives = drives or self._drives
        for drive in drives:
            self._limit_time(drive, TURN_TIMEOUT)
        with self._clock.workers(len(drives), 'drive objects') as pool:
            asked = [pool.submit(look, drive) for drive in drives]
        results, errors = [], []
        for one in asked:
            try:
                results.append(one.result())
            except DriveError as error:
                errors.append(error)
        if len(errors) > 1:
            raise DriveError('; '.join(map(str, errors))) from errors[0]
        if errors:
            raise errors[0]
        return results

    def _limit_time(self, drive: Drive, timeout: float) -> None:
        """Let a drive that answers for ever, or late each time, end as a silent one does."""
        drive.objects.deadline = self._clock.monotonic() + timeout

    def _unexpected_boot_ups(self) -> list[AxisMonitor]:
        allowed = 1 if self._settings.reset_nodes else 0
        monitors = (drive.monitor for drive in self._drives)
        return [monitor for monitor in monitors if monitor.boot_ups > allowed]

    def unconfirmed(self, monitors: list[AxisMonitor]) -> list[AxisMonitor]:
        """Switch drives off by SDO, as PDOs may not reach them; return those that do not obey."""
        asked = [drive for drive in self._drives if drive.monitor in monitors]
        self._command(NmtCommand.ENTER_PRE_OPERATIONAL, asked)  # stopped ones have no SDO
        states = self._of_each(self._switch_off, asked)
        return [drive.monitor for drive, state in zip(asked, states, strict=True)
                if state not in UNPOWERED_STATES]

    def _switch_off(self, drive: Drive) -> State | None:
        self._limit_time(drive, ASKING_TIMEOUT)
        with suppress(DriveError):  # one that does not answer is asked once more
            drive.objects.write(CONTROLWORD, 0, DISABLE_VOLTAGE)
        return self._ask_state(drive)

    def _ask_state(self, drive: Drive) -> State | None:
        """Return a drive's state, None if it does not answer soon or names no state."""
        try:
            return decode_state(self._ask(drive, STATUSWORD))
        except DriveError:
            return None

    def _ask(self, drive: Drive, index: int, subindex: int = 0, signed: bool = False) -> int:
        """Return a number that a drive answers soon, 0 for an object that it does not have."""
        self._limit_time(drive, ASKING_TIMEOUT)
        try:
            return drive.objects.read_number(index, subindex, signed)
        except SdoAbortError:
            return 0

    def errors(self) -> list[str]:
        """Return what each drive that answers soon has in its error objects, hexadecimal."""
        return [text for text in self._of_each(self._errors) if text]

    def _errors(self, drive: Drive) -> str:
        self._limit_time(drive, ERRORS_TIMEOUT)
        found = []
        with suppress(DriveError, BusError):
            for index, width in ((ERROR_REGISTER, 2), (ERROR_CODE, 4)):
                found.append(f'{index:04X}h {drive.objects.read_number(index):0{width}X}h')
            count = min(drive.objects.read_number(PAST_ERRORS), MOST_ERRORS)
            found += [f'{PAST_ERRORS:04X}h:{number:02X} '
                      f'{drive.objects.read_number(PAST_ERRORS, number):08X}h'
                      for number in range(1, count + 1)]
        return f'{drive.monitor.name} after the stop: {", ".join(found)}' if found else ''

    def require_unused(self) -> None:
        """
        Check, before the first word to them, that nobody else uses the drives.

        A master may speak seldom or never: what the drives do shows it. Drives that this software
        has left behind watch its heartbeat (1016h) and miss it: they have stopped. Raises a
        DriveStateError with those that have power, move, or are operational.
        """
        uses = zip(self._drives, self._of_each(self._use), strict=True)
        used = [f'{drive.monitor.title} {use}' for drive, use in uses if use]
        if used:
            raise DriveStateError(
                f'{", ".join(used)}, though not by this driver: the drives are left as they are; '
                'end whoever commands them, or switch their supply off and on')

    def _use(self, drive: Drive) -> str:
        """Return what a drive does that nobody here has commanded, ``''`` for nothing."""
        state = self._ask_state(drive)
        if state is None:
            return ''  # it is not there, or its reset shows what is wrong
        unit = drive.monitor.axis.si_per_unit.velocity
        velocity = self._ask(drive, VELOCITY, signed=True) * unit
        if abs(velocity) > REST_SPEED:
            return f'moves at {velocity:.3g} m/s'
        watched = self._ask(drive, *drive.monitor.profile.heartbeat_consumer)
        node, timeout = divmod(watched, 1 << 16)
        misses_us = (node == pdo.MASTER_NODE_ID
                     and 0 < timeout <= 1e3 * self._settings.heartbeat_timeout)
        if state in POWERED_STATES and not (
                misses_us and state is State.QUICK_STOP_ACTIVE):
            return f'has power ({state.value})'
        if drive.monitor.nmt_state == NmtState.OPERATIONAL and not misses_us:
            return 'is operational'
        return ''

    def check_again(self) -> None:
        """
        Prove identities, objects and PDO map once more and start what is not operational.

        A drive that is not as it was configured has restarted.
        """
        self._leave_stopped()
        self._of_each(self._check_identity)
        self._of_each(self._verify)
        self._start()

    def _leave_stopped(self) -> None:
        """Make nodes that somebody has stopped pre-operational: stopped ones have no SDO."""
        self._command(NmtCommand.ENTER_PRE_OPERATIONAL, [
            one for one in self._drives if one.monitor.nmt_state == NmtState.STOPPED])
        self._wait(lambda m: m.nmt_state != NmtState.STOPPED, self._settings.step_timeout,
                   'stays in the NMT state stopped, as its heartbeat says')

    def inspect(self, is_configured: bool = True) -> list[Finding]:
        """
        Look at identity, objects and answer time of each drive, and change nothing.

        Before drives are configured, only what they lack counts.

        """
        looks = {'identity': self._inspect_identity,
                 'objects': self._inspect_objects if is_configured else self._inspect_new}
        return [self._find(drive, *look) for drive in self._drives for look in looks.items()]

    def _find(self, drive: Drive, what: str, look: Callable[[Drive], str]) -> Finding:
        name = f'{drive.monitor.name} {what}'
        self._limit_time(drive, TURN_TIMEOUT)
        try:
            return Finding(name, True, look(drive))
        except DriveError as error:
            return Finding(name, False, str(error))

    def _inspect_identity(self, drive: Drive) -> str:
        begun = self._clock.monotonic()
        found = self._identity(drive)
        elapsed = (self._clock.monotonic() - begun) / len(found)
        return (f'{drive.monitor.title} is vendor {found.vendor_id}, product '
                f'{found.product_code}, serial number {found.serial_number}; it answers an SDO '
                f'within {1e3 * elapsed:.1f} ms')

    def _inspect_objects(self, drive: Drive) -> str:
        writes = self._writes(drive)
        configuration.verify_objects(drive.objects, writes)
        configuration.verify_units(drive.objects, drive.monitor.axis)
        checked = sum(1 for write in writes if write.compared)
        return f'{drive.monitor.title} has {checked} objects as configured'

    def _inspect_new(self, drive: Drive) -> str:
        found = configuration.compare_objects(drive.objects, self._writes(drive))
        configuration.verify_units(drive.objects, drive.monitor.axis)
        if found.lacking:
            raise DriveObjectError('; '.join(found.lacking))
        objects = ', '.join(str(write) for write, _ in found.different)
        return (f'{drive.monitor.title} has all objects; configure will change '
                f'{len(found.different)} of them: {objects or "none"}')

    def _verify(self, drive: Drive) -> None:
        """Prove the objects: a drive that has lost them has restarted, and lost its position."""
        try:
            configuration.verify_objects(drive.objects, self._writes(drive))
        except DriveObjectError:
            drive.monitor.encoder.distrust()
            raise

    def _reset(self) -> None:
        for drive in self._drives:
            drive.monitor.boot_ups = 0
            drive.monitor.forget_errors()
        if not self._settings.reset_nodes:
            return
        self._command(NmtCommand.RESET_NODE, self._drives)
        self._wait(lambda m: m.boot_ups > 0, self._settings.boot_timeout,
                   'sent no boot-up message after its reset: check its power, its node id and '
                   'the bit rate of the bus')

    def _check_identity(self, drive: Drive) -> None:
        drive.monitor.serial_number = self._identity(drive).serial_number

    def _identity(self, drive: Drive) -> configuration.Identity:
        serials = {one.monitor.axis.serial_number: one.monitor.name for one in self._drives}
        found = configuration.read_identity(drive.objects)
        configuration.check_identity(drive.monitor.name, found, drive.monitor.axis, serials)
        return found

    def _write(self, drive: Drive) -> list[str]:
        notes, drive.monitor.stops_without_master = configuration.write_drive(
            drive.objects, drive.monitor.profile, drive.monitor.axis, self._settings)
        if drive.monitor.serial_number and not drive.monitor.axis.serial_number:
            notes.append(
                f'{drive.monitor.title} accepts any drive: set its serial_number, now '
                f'{drive.monitor.serial_number}, so that swapped axes are found')
        return notes

    def _writes(self, drive: Drive) -> list[Any]:
        return configuration.drive_writes(
            drive.monitor.profile, drive.monitor.axis, self._settings)

    def _start(self) -> None:
        self._command(NmtCommand.START, self._drives)
        since = self._clock.monotonic()
        self._wait(lambda m: (m.nmt_state == NmtState.OPERATIONAL
                              and (m.heartbeat_time or 0.0) >= since),
                   self._settings.step_timeout,
                   'did not confirm by its heartbeat that it is operational')

    def _command(self, command: NmtCommand, drives: Iterable[Drive]) -> None:
        for drive in drives:
            self._bus.command(command, drive.monitor.axis.node_id)

    def _wait(
        self, condition: Callable[[AxisMonitor], bool], timeout: float, failure: str
    ) -> None:
        """Wait until a condition holds for all drives; name those for which it does not."""
        monitors = [drive.monitor for drive in self._drives]
        end = self._clock.monotonic() + timeout
        while missing := [one for one in monitors if not condition(one)]:
            if self._clock.monotonic() > end:
                titles = ' and '.join(one.title for one in missing)
                raise DriveTimeoutError(f'{titles} {failure} (waited {timeout:g} s)')
            if self._clock.wait(self._is_closing, LOOK_PERIOD):
                raise DriveStateError('given up: the bus is being closed')
