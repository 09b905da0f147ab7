"""
Session of the drives and their bus, used only in the control thread.

The session never reopens a lost bus by itself. The drives stay stopped, and their positions are
invalid, until the operator requests cleanup, configure and home.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import partial
import gc
from typing import Any

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import expedited_download, SdoAbortError, SdoChannel
from facade_manipulator.drives import configuration, realtime
from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, check_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor, REST_SPEED
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import Cause, ControllerState, Finding, Remedy
from facade_manipulator.drives.states import decode_state, POWERED_STATES, State
from facade_manipulator.drives.targets import MechanismChecks, TargetSupervisor
from facade_manipulator.errors import BusError, DriveError, DriveObjectError

ASKING_TIMEOUT = 0.5  # s, for one object of a drive that may be absent
TURN_TIMEOUT = 25.0  # s, for all that is asked of one drive by SDO: 111 answers of 0.2 s
DISABLE_VOLTAGE = bytes(2)


class Drive:
    """
    Access to one drive by SDO: its identity, objects and power.

    The control thread receives the answers, so it must not wait for them: each method runs in the
    worker thread of its drive. It raises a DriveError that names the drive and its failure, or a
    BusError if the bus is lost. The total time of its SDO answers is limited, so that a slow drive
    fails like a silent one.
    """

    def __init__(self, monitor: AxisMonitor, objects: SdoChannel, session: Session) -> None:
        self.monitor, self._objects, self._session = monitor, objects, session
        self._writes = configuration.drive_writes(
            monitor.profile, monitor.axis, session.settings)

    # --- identity and objects

    def identify(self) -> str:
        """Check the identity and store the serial number; return it with the answer time."""
        begun, monitor = self._session.now, self.monitor
        self._objects.deadline = self._session.now + TURN_TIMEOUT
        numbers = configuration.check_identity(self._objects, monitor.axis, {
            one.axis.serial_number: one.name for one in self._session.monitors})
        monitor.serial_number = numbers['serial_number']
        words = ', '.join(f'{name.replace("_", " ")} {one}' for name, one in numbers.items())
        answer_time = (self._session.now - begun) / (1 + len(numbers))
        return (f'{monitor.title} has {words}; it answers an SDO within '
                f'{1e3 * answer_time:.1f} ms')

    def configure(self) -> list[str]:
        """Write and prove all objects; return notes of skipped objects and missing checks."""
        self._objects.deadline = self._session.now + TURN_TIMEOUT
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

    def prove(self, is_configured: bool = True) -> str:
        """
        Check identity, units and objects, and change nothing; return the result for the operator.

        Before the drive is configured, only objects that it lacks are failures.
        """
        message = self.identify()
        deviations, _ = configuration.check(self._objects, self._writes)
        if problems := self._unit_conflicts() + [
                one.message for one in deviations if is_configured or one.is_final]:
            raise DriveObjectError('; '.join(problems))
        changes = ', '.join(str(one.write) for one in deviations)
        return f'{message}; configure will change {len(deviations)} objects: {changes or "none"}'

    def inspect(self, is_configured: bool) -> Finding:
        """Return the result of `prove` as a finding."""
        try:
            return Finding(self.monitor.name, True, self.prove(is_configured))
        except DriveError as error:
            return Finding(self.monitor.name, False, str(error))

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
        velocity = self._ask(pdo.VELOCITY, signed=True) * monitor.axis.si_per_unit.velocity
        if abs(velocity) > REST_SPEED:
            return f'{monitor.title} moves at {velocity:.3g} m/s'
        node, timeout = divmod(self._ask(*monitor.profile.heartbeat_consumer), 1 << 16)
        misses_us = (node == pdo.MASTER_NODE_ID
                     and 0 < timeout <= 1e3 * self._session.settings.heartbeat_timeout)
        if state in POWERED_STATES and not (misses_us and state is State.QUICK_STOP_ACTIVE):
            return f'{monitor.title} has power ({state.value})'
        if monitor.nmt_state == 'OPERATIONAL' and not misses_us:
            return f'{monitor.title} is operational'
        return ''

    def switch_off(self) -> State | None:
        """Switch the drive off; return its state, None without an answer."""
        self._objects.deadline = self._session.now + ASKING_TIMEOUT
        with suppress(DriveError, BusError):  # a drive that does not answer is asked once more
            self._objects.write(pdo.CONTROLWORD, 0, DISABLE_VOLTAGE)
        return self._state()

    def _state(self) -> State | None:
        """Return the state of the drive, None without a timely answer or a valid state."""
        try:
            return decode_state(self._ask(pdo.STATUSWORD))
        except (DriveError, BusError):
            return None

    def _ask(self, index: int, subindex: int = 0, signed: bool = False) -> int:
        """Return a number in an object of the drive, 0 if the drive lacks the object."""
        self._objects.deadline = self._session.now + ASKING_TIMEOUT
        try:
            return self._objects.read_number(index, subindex, signed)
        except SdoAbortError:
            return 0


class Session:
    """
    Three drives, whose axes are q1, q2, q3, and their bus, which `open_bus` opens.

    Raises a ParameterError if settings contradict each other or a drive profile is missing.

    Attributes
    ----------
    exchange : CyclicExchange or None
        Present while the bus is open.
    drives : tuple of Drive
        The objects of the drives by SDO; empty while the bus is closed.
    group : Group
        The state machine of the drives.
    is_configured : bool
        Whether the drives are configured; they remain so when the bus is lost.
    lost : str
        The reason why the bus of configured drives is lost, ``''`` if it is not.
    forbidden : str
        The reason why no drive may have power, ``''`` if it may; set by any thread.

    """

    def __init__(
        self, settings: ControllerSettings, axes: tuple[AxisSettings, ...],
        open_bus: Callable[[], CanBus], mechanism: MechanismChecks, clock: Clock | None = None,
    ) -> None:
        check_axes(axes)
        self.settings = settings = replace(  # a step may be to stop
            settings, step_timeout=settings.step_timeout + max(axis.stop_time for axis in axes))
        self._profiles = tuple(load_profile(axis.profile) for axis in axes)
        self.axes = tuple(
            profile.applied(axis) for axis, profile in zip(axes, self._profiles, strict=True))
        for profile, axis in zip(self._profiles, self.axes, strict=True):
            configuration.drive_writes(profile, axis, settings)
        self.targets = TargetSupervisor(self.axes, settings, mechanism)
        self.clock = clock or Clock()
        # one thread for each drive: its transfers never overlap, and no drive waits for another
        self._workers = {name: self.clock.workers(1, f'objects of {name}') for name in AXIS_NAMES}
        self._open_bus = open_bus
        self.forbidden, self.is_closed = '', False
        self._forget()

    def _forget(self) -> None:
        self.exchange: CyclicExchange | None = None
        self.drives: tuple[Drive, ...] = ()
        self.group = Group(self.axes, self.settings, self.now)
        self.is_configured = False
        self.lost = ''
        self.notes: tuple[str, ...] = ()  #: from configure
        self.monitors = tuple(
            AxisMonitor(name, axis, self.settings, profile)
            for name, axis, profile in zip(AXIS_NAMES, self.axes, self._profiles, strict=True))

    @property
    def now(self) -> float:
        """Return the time on the monotonic clock [s]."""
        return self.clock.monotonic()

    @property
    def unhomed(self) -> list[str]:
        """Return the names of the axes that must be homed."""
        return [one.name for one in self.monitors if not one.encoder.homed]

    def has_done(self, *states: ControllerState) -> bool:
        """Return whether all drives have reached one of these states of the group."""
        return self.group.state in states and self.group.is_settled

    def submit(self, work: Callable[[Drive], Any], drive: Drive) -> Future[Any]:
        """Run work on a drive's objects in the worker thread of the drive."""
        return self._workers[drive.monitor.name].submit(work, drive)

    # --- the bus: opened, closed, lost

    def open(self) -> CyclicExchange:
        """Open the bus and listen without sending; raises a BusError."""
        bus = self._open_bus()
        realtime.freeze_objects()  # the first, full collection takes longer than a heartbeat
        exchange = CyclicExchange(bus, self.monitors, self.settings, self.targets, self.clock)
        self.drives = tuple(
            Drive(one, objects, self)
            for one, objects in zip(self.monitors, exchange.objects, strict=True))
        self.exchange = exchange
        return exchange

    def command(self, name: str, monitors: Iterable[AxisMonitor]) -> None:
        """Send a network management command to drives; raises a BusError."""
        if self.exchange is not None:
            for one in monitors:
                self.exchange.bus.command(name, one.axis.node_id)

    def close_bus(self) -> None:
        """Leave the drives in NMT pre-operational, close the bus, and forget all drives."""
        if self.exchange is not None:
            # drives of another master are left unchanged
            used = self.monitors if self.exchange.transmits else ()
            with suppress(BusError):  # the drives notice the missing heartbeat by themselves
                self.command('PRE-OPERATIONAL', used)
                for one in used:  # none reports a lost master; the answers are not awaited
                    self.exchange.bus.send(
                        pdo.SDO_REQUEST + one.axis.node_id,
                        expedited_download(*one.profile.heartbeat_consumer, bytes(4)))
            self.exchange.bus.close()
        gc.unfreeze()
        self._forget()

    def lose(self, error: BusError) -> None:
        """Stop sending, so that the drives stop by themselves; forget their positions."""
        if self.exchange is not None:
            self.exchange.bus.close()
        self.exchange, self.drives = None, ()
        for monitor in self.monitors:
            monitor.lose()
        if self.is_configured:
            self.lost = str(error)
            self.group.stop(Cause(self.lost, Remedy.BUS, configure_again=True), self.now)
