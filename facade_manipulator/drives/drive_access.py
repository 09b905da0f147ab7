"""
One drive by SDO: its identity, objects and power.

The control thread receives the answers, so it must not wait for them: each method runs in the
worker thread of its drive. It raises a DriveError that names the drive and its failure, or a
BusError if the bus is lost.
"""

from __future__ import annotations

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
TURN_TIMEOUT = 25.0  # s, for all that is asked of one drive by SDO: 111 answers of 0.2 s
CONTROLWORD = 0x6040
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
        self._writes = configuration.drive_writes(monitor.profile, monitor.axis, settings)

    def _limit_time(self, timeout: float) -> None:
        """Let a drive that answers late, or without an end, fail as a silent drive does."""
        self._objects.deadline = self._clock.monotonic() + timeout

    # --- identity and objects

    def identify(self) -> str:
        """Check the identity and note the serial number; return it with the answer time."""
        begun = self._clock.monotonic()
        self._limit_time(TURN_TIMEOUT)
        monitor, found = self.monitor, configuration.read_identity(self._objects)
        configuration.check_identity(monitor.name, found, monitor.axis, self._serials)
        monitor.serial_number = found.serial_number
        answer_time = (self._clock.monotonic() - begun) / len(found)
        return (f'{monitor.title} is vendor {found.vendor_id}, product {found.product_code}, '
                f'serial number {found.serial_number}; it answers an SDO within '
                f'{1e3 * answer_time:.1f} ms')

    def configure(self) -> list[str]:
        """Write and prove all objects; return notes of skipped objects and a missing check."""
        self._limit_time(TURN_TIMEOUT)
        monitor = self.monitor
        notes = configuration.apply(self._objects, self._writes)
        if problems := self._unit_conflicts():
            raise DriveObjectError('; '.join(problems))
        monitor.stops_without_master = configuration.stops_without_master(
            self._objects, monitor.profile)
        if monitor.serial_number and not monitor.axis.serial_number:
            notes.append(
                f'{monitor.title} accepts any drive: set its serial_number, now '
                f'{monitor.serial_number}, so that swapped axes are found')
        return notes

    def _unit_conflicts(self) -> list[str]:
        read = partial(configuration.read_optional, self._objects)
        return [f'{self.monitor.title}: {problem}'
                for problem in configuration.unit_conflicts(read, self.monitor.axis)]

    def prove(self) -> None:
        """Check identity and objects; a drive that differs has restarted and lost its position."""
        self.identify()
        deviations, _ = configuration.check(self._objects, self._writes)
        if deviations:
            self.monitor.encoder.distrust()
            raise DriveObjectError('; '.join(one.message for one in deviations))

    def inspect(self, is_configured: bool) -> Finding:
        """
        Check identity, objects and answer time, and change nothing.

        Before the drive is configured, only objects that it lacks are failures.
        """
        try:
            message = self.identify()
            deviations, _ = configuration.check(self._objects, self._writes)
            if problems := self._unit_conflicts() + [
                    one.message for one in deviations if is_configured or one.is_final]:
                raise DriveObjectError('; '.join(problems))
        except DriveError as error:
            return Finding(self.monitor.name, False, str(error))
        changes = ', '.join(str(one.write) for one in deviations)
        return Finding(self.monitor.name, True, (
            f'{message}; configure will change {len(deviations)} objects: {changes or "none"}'))

    # --- power

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
