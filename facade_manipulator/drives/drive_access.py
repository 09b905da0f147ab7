"""
One drive by SDO: its identity, objects, power and errors.

The control thread receives the answers, so it must not wait for them: each method runs in the
worker thread of its drive. It raises a DriveError that names the drive and its failure, or a
BusError if the bus is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import NamedTuple

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import NmtState
from facade_manipulator.canopen.sdo import SdoAbortError, SdoChannel
from facade_manipulator.drives import configuration
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.monitor import AxisMonitor, REST_SPEED, STATUSWORD, VELOCITY
from facade_manipulator.drives.states import decode_state, POWERED_STATES, State
from facade_manipulator.errors import BusError, DriveError, DriveObjectError

ASKING_TIMEOUT = 0.5  # s, for one object of a drive that need not be there
ERRORS_TIMEOUT = 0.3  # s, of one drive: cutting the power by SDO waits for it
MOST_ERRORS = 4  # of the past ones, the newest
TURN_TIMEOUT = 25.0  # s, for all that is asked of one drive by SDO: 111 answers of 0.2 s
CONTROLWORD = 0x6040
ERROR_REGISTER, ERROR_CODE, PAST_ERRORS = 0x1001, 0x603F, 0x1003
DISABLE_VOLTAGE = bytes(2)


class Finding(NamedTuple):
    """One result of a self-test."""

    name: str
    passed: bool
    message: str


class Drive:
    """The objects of one drive, beside the monitor of its frames; `serials` as for the check."""

    def __init__(
        self, monitor: AxisMonitor, objects: SdoChannel, settings: ControllerSettings,
        serials: dict[int, str], clock: Clock,
    ) -> None:
        self.monitor, self._objects, self._settings = monitor, objects, settings
        self._serials, self._clock = serials, clock

    @property
    def _writes(self) -> list[pdo.Write]:
        return configuration.drive_writes(
            self.monitor.profile, self.monitor.axis, self._settings)

    def _limit_time(self, timeout: float) -> None:
        """Let a drive that answers late, or without an end, fail as a silent drive does."""
        self._objects.deadline = self._clock.monotonic() + timeout

    # --- configure

    def identify(self) -> configuration.Identity:
        """Check the identity and note the serial number."""
        self._limit_time(TURN_TIMEOUT)
        monitor, found = self.monitor, configuration.read_identity(self._objects)
        configuration.check_identity(monitor.name, found, monitor.axis, self._serials)
        monitor.serial_number = found.serial_number
        return found

    def configure(self) -> list[str]:
        """Write and prove all objects; return notes of skipped objects and a missing check."""
        self._limit_time(TURN_TIMEOUT)
        monitor = self.monitor
        notes = configuration.apply(self._objects, self._writes)
        self._require_units()
        monitor.stops_without_master = configuration.stops_without_master(
            self._objects, monitor.profile)
        if monitor.serial_number and not monitor.axis.serial_number:
            notes.append(
                f'{monitor.title} accepts any drive: set its serial_number, now '
                f'{monitor.serial_number}, so that swapped axes are found')
        return notes

    def prove(self) -> None:
        """Check identity and objects; a drive that differs has restarted and lost its position."""
        self.identify()
        try:
            self._require_objects()
        except DriveObjectError:
            self.monitor.encoder.distrust()
            raise

    def _require_units(self) -> None:
        read = partial(configuration.read_optional, self._objects)
        if problems := [f'{self.monitor.title}: {problem}' for problem in
                        configuration.unit_conflicts(read, self.monitor.axis)]:
            raise DriveObjectError('; '.join(problems))

    def _require_objects(self) -> None:
        if deviations := configuration.check(self._objects, self._writes)[0]:
            raise DriveObjectError('; '.join(one.message for one in deviations))

    # --- power and errors

    def use(self) -> str:
        """
        Return a use of the drive that this driver has not commanded, ``''`` for none.

        Another master may send seldom or never, but the state of the drive shows it. A drive that
        this driver has left behind watches its heartbeat (1016h), misses it, and has stopped.
        """
        monitor, state = self.monitor, self._state()
        if state is None:
            return ''  # the drive is absent, or its reset shows the problem
        velocity = self._ask(VELOCITY, signed=True) * monitor.axis.si_per_unit.velocity
        if abs(velocity) > REST_SPEED:
            return f'{monitor.title} moves at {velocity:.3g} m/s'
        node, timeout = divmod(self._ask(*monitor.profile.heartbeat_consumer), 1 << 16)
        misses_us = (node == pdo.MASTER_NODE_ID
                     and 0 < timeout <= 1e3 * self._settings.heartbeat_timeout)
        if state in POWERED_STATES and not (misses_us and state is State.QUICK_STOP_ACTIVE):
            return f'{monitor.title} has power ({state.value})'
        if monitor.nmt_state == NmtState.OPERATIONAL and not misses_us:
            return f'{monitor.title} is operational'
        return ''

    def switch_off(self) -> State | None:
        """Switch the drive off; return its state, None if it does not answer."""
        self._limit_time(ASKING_TIMEOUT)
        with suppress(DriveError, BusError):  # a drive that does not answer is asked once more
            self._objects.write(CONTROLWORD, 0, DISABLE_VOLTAGE)
        return self._state()

    def _state(self) -> State | None:
        """Return the state of the drive, None if it does not answer soon or states none."""
        try:
            return decode_state(self._ask(STATUSWORD))
        except (DriveError, BusError):
            return None

    def _ask(self, index: int, subindex: int = 0, signed: bool = False) -> int:
        """Return a number that the drive answers soon, 0 for an object that it does not have."""
        self._limit_time(ASKING_TIMEOUT)
        try:
            return self._objects.read_number(index, subindex, signed)
        except SdoAbortError:
            return 0

    def errors(self) -> str:
        """Return the error objects of the drive, hexadecimal; '' if it is silent."""
        self._limit_time(ERRORS_TIMEOUT)
        read, found = self._objects.read_number, list[str]()
        with suppress(DriveError, BusError):
            found += [f'{ERROR_REGISTER:04X}h {read(ERROR_REGISTER):02X}h']
            found += [f'{ERROR_CODE:04X}h {read(ERROR_CODE):04X}h']
            for number in range(1, 1 + min(read(PAST_ERRORS), MOST_ERRORS)):
                found += [f'{PAST_ERRORS:04X}h:{number:02X} {read(PAST_ERRORS, number):08X}h']
        return f'{self.monitor.name} after the stop: {", ".join(found)}' if found else ''

    # --- self-test

    def inspect(self, is_configured: bool) -> list[Finding]:
        """
        Check identity, objects and answer time, and change nothing.

        Before the drive is configured, only objects that it lacks are failures.
        """
        objects = self._inspect_objects if is_configured else self._inspect_new
        return [self._find('identity', self._inspect_identity), self._find('objects', objects)]

    def _find(self, part: str, look: Callable[[], str]) -> Finding:
        name = f'{self.monitor.name} {part}'
        self._limit_time(TURN_TIMEOUT)
        try:
            return Finding(name, True, look())
        except DriveError as error:
            return Finding(name, False, str(error))

    def _inspect_identity(self) -> str:
        begun = self._clock.monotonic()
        found = self.identify()
        elapsed = (self._clock.monotonic() - begun) / len(found)
        return (f'{self.monitor.title} is vendor {found.vendor_id}, product '
                f'{found.product_code}, serial number {found.serial_number}; it answers an SDO '
                f'within {1e3 * elapsed:.1f} ms')

    def _inspect_objects(self) -> str:
        self._require_objects()
        self._require_units()
        checked = sum(1 for write in self._writes if write.compared)
        return f'{self.monitor.title} has {checked} objects as configured'

    def _inspect_new(self) -> str:
        deviations, _ = configuration.check(self._objects, self._writes)
        self._require_units()
        if lacking := '; '.join(one.message for one in deviations if one.is_final):
            raise DriveObjectError(lacking)
        objects = ', '.join(str(one.write) for one in deviations)
        return (f'{self.monitor.title} has all objects; configure will change '
                f'{len(deviations)} of them: {objects or "none"}')
