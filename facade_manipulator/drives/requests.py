"""
Session of the drives and their bus, and the requests of an operator that change it.

One thread uses the session. It never reopens a lost bus by itself. The drives stay stopped, and
their positions are invalid, until the operator requests cleanup, configure and home.

`REQUESTS` is a table from a name to a generator function.

The controller begins a generator between two cycles and resumes it in each cycle. Its return value
is the reply. A ManipulatorError is the reply of a failure; before the first ``yield`` it rejects
the request. A request that is cancelled is closed. The controller closes a bus whose drives are
not configured when no request is left.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from dataclasses import replace
import gc
from itertools import chain
from typing import Any, NamedTuple

from facade_manipulator.canopen import cob_ids, emcy
from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.sdo import expedited_download, Result, Steps
from facade_manipulator.drives import realtime
from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, check_axes
from facade_manipulator.drives.configuration import Drive, drive_writes, IS_OPERATIONAL
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor, positions_of
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import Cause, ControllerState, Remedy
from facade_manipulator.drives.states import Power, UNPOWERED_STATES
from facade_manipulator.drives.targets import MechanismChecks, TargetSupervisor
from facade_manipulator.errors import (
    BusError,
    DriveError,
    DriveStateError,
    joined,
    ManipulatorError,
)
from facade_manipulator.timeouts import (
    ASKING_TIMEOUT,
    ORDERLY_STOP_TIMEOUT,
    STOP_AND_CUT,
)

TURN_TIMEOUT = (
    25.0  # s, for all that is asked of one drive by SDO: 111 answers of 0.2 s
)
LISTEN_PERIODS = 2  # of the heartbeats, before the first frame
LONGEST_LISTENING = 5.0  # s, for a guarding or a SYNC of a drive with a long period
SLOWEST = 20  # cycles in which each TPDO is sent once at 200 Hz; step_timeout covers faster rates


# --- the drives and their bus


class Session:
    """
    Three drives, whose axes are q1, q2, q3, and their bus, which `open_bus` opens.

    Raises a ParameterError if settings contradict each other or a drive profile is missing.

    Attributes
    ----------
    exchange : CyclicExchange or None
        Present while the bus is open.
    group : Group
        The state machine of the drives.
    is_configured : bool
        Whether the drives are configured; they remain so when the bus is lost.
    lost : str
        The reason why the bus of configured drives is lost, ``''`` if it is not.
    forbidden : str
        The reason why no drive may have power, ``''`` if it may.
    unconfirmed : str
        The drives whose power the last cleanup has not confirmed off, as a message; ``''`` for
        none, or after the next configure.

    """

    def __init__(
        self,
        settings: ControllerSettings,
        axes: tuple[AxisSettings, ...],
        open_bus: Callable[[], CanBus],
        mechanism: MechanismChecks,
        clock: Clock | None = None,
    ) -> None:
        check_axes(axes)
        self.settings = settings = replace(  # a step may be to stop
            settings,
            step_timeout=settings.step_timeout + max(axis.stop_time for axis in axes),
        )
        emcy.read_faults()  # a first fault must not wait for the table
        self._profiles = tuple(load_profile(axis.profile) for axis in axes)
        self.axes = tuple(
            profile.applied(axis)
            for axis, profile in zip(axes, self._profiles, strict=True)
        )
        for profile, axis in zip(self._profiles, self.axes, strict=True):
            drive_writes(profile, axis, settings)
        self.mechanism = mechanism
        self.clock = clock or Clock()
        self._open_bus = open_bus
        self.forbidden, self.is_closed = '', False
        self.unconfirmed = ''
        self._forget()

    def _forget(self) -> None:
        self.exchange: CyclicExchange | None = None
        self.is_configured = False
        self.lost = ''
        self.notes: tuple[str, ...] = ()  #: from configure
        self.monitors = tuple(
            AxisMonitor(name, axis, self.settings, profile)
            for name, axis, profile in zip(
                AXIS_NAMES, self.axes, self._profiles, strict=True
            )
        )
        self.group = Group(self.monitors, self.settings)
        self.targets = TargetSupervisor(self.group, self.settings, self.mechanism)

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

    # --- the bus: opened, closed, lost

    def open(self) -> CyclicExchange:
        """Open the bus and listen without sending; raises a BusError."""
        bus = self._open_bus()
        realtime.freeze_objects()  # the first, full collection takes longer than a heartbeat
        self.exchange = CyclicExchange(
            bus, self.group, self.targets, self.settings, self.clock
        )
        return self.exchange

    def command(self, name: str, monitors: Iterable[AxisMonitor]) -> None:
        """Send a network management command to drives; raises a BusError."""
        if self.exchange is not None:
            for one in monitors:
                one.expect(name)
                self.exchange.command(name, one.axis.node_id)

    def close_bus(self, without_power: Collection[AxisMonitor] = ()) -> None:
        """
        Leave the drives in NMT pre-operational, close the bus, and forget all drives.

        Drives without power no longer watch this master, so that none reports its loss. Any other
        drive stops by itself when it misses the heartbeat.
        """
        if self.exchange is not None:
            # drives of another master are left unchanged
            used = self.monitors if self.exchange.transmits else ()
            with suppress(
                BusError
            ):  # the drives notice the missing heartbeat by themselves
                self.command('PRE-OPERATIONAL', used)
                for one in without_power:  # the answers are not awaited
                    self.exchange.bus.send(
                        cob_ids.SDO_REQUEST + one.axis.node_id,
                        expedited_download(*one.profile.heartbeat_consumer, bytes(4)),
                    )
            self.exchange.bus.close()
        gc.unfreeze()
        self._forget()

    def without_power(self) -> list[AxisMonitor]:
        """Return the used drives that confirm that they have no power, or have just booted."""
        exchange = self.exchange
        if exchange is None or not exchange.transmits:
            return []
        if not exchange.has_started:  # nothing has switched them on since their reset
            return [one for one in self.monitors if one.boot_ups]
        return [
            one
            for one in self.monitors
            if one.snapshot(None, self.now).power is Power.CONFIRMED_OFF
        ]

    def lose(self, error: BusError) -> None:
        """Stop sending, so that the drives stop by themselves; forget their positions."""
        if self.exchange is not None:
            self.exchange.bus.close()
        self.exchange = None
        for (
            monitor
        ) in self.monitors:  # a drive may restart, and its carriage move, unnoticed
            monitor.encoder.distrust()
        if self.is_configured:
            self.lost = error.problem
            remedy = error.remedy or Remedy.BUS
            self.group.stop(Cause(self.lost, remedy, configure_again=True), self.now)


# --- requests


def configure(session: Session) -> Steps[str]:
    """
    Open the bus, check and configure the drives, and start the cycle.

    The request listens before its first frame, and leaves drives of another master unchanged. A
    frame of another master ends it with a BusError.
    """
    exchange, settings = session.open(), session.settings
    yield from _listen(exchange, LISTEN_PERIODS * settings.heartbeat_period)
    uses = yield from _each(session, Drive.use, ASKING_TIMEOUT)
    exchange.expect_sync(any(one.produces_sync for one in exchange.drives))
    if used := ', '.join(filter(None, uses)):
        hint = ''
        if IS_OPERATIONAL in used:
            hint = (
                '; a drive that is operational again after that starts itself: set '
                'quirks.starts_itself in its profile'
            )
        raise DriveStateError(
            f'{used}, which this driver has not commanded: the drives are left unchanged; end '
            f'the other master, or switch their supply off and on{hint}'
        )
    guard_time = max(one.guard_time for one in exchange.drives)
    yield from _listen(exchange, LISTEN_PERIODS * guard_time)
    exchange.transmits = True
    notes = yield from _prepare(session, exchange)
    session.notes = tuple(filter(None, (exchange.bus.sync_note, *notes)))
    yield from _require_end_of_sync(exchange, settings)
    yield from _start_cycle(session, exchange)
    if session.group.is_stopped:
        return f'The drives are configured, but stopped: {session.group.reason}.'
    return f'The drives on {exchange.bus} are configured.'


def _listen(exchange: CyclicExchange, seconds: float) -> Steps[None]:
    """Receive the frames of a time [s], which raise a BusError if a master sends them."""
    end = exchange.read_until + min(seconds, LONGEST_LISTENING)
    while exchange.read_until < end:
        yield


def _require_end_of_sync(
    exchange: CyclicExchange, settings: ControllerSettings
) -> Steps[None]:
    """Listen until no drive sends SYNC; a SYNC of another master raises a BusError."""
    exchange.has_received_sync = False
    exchange.expect_sync(False)
    periods = [one.sync_period for one in exchange.drives if one.produces_sync]
    if not periods:
        return
    longest = max(settings.heartbeat_period, *periods)
    yield from _listen(exchange, LISTEN_PERIODS * longest)


def _start_cycle(session: Session, exchange: CyclicExchange) -> Steps[None]:
    """Start the cycle with all drives switched off; wait until each drive has answered."""
    realtime.freeze_objects()  # those of configure would cost the first collection a cycle
    settings, group = session.settings, session.group
    exchange.start(session.now)
    end = session.now + settings.step_timeout + SLOWEST * settings.period
    while not group.is_stopped:
        silent = [
            f'{name} of {one.title}'
            for one in session.monitors
            for name in sorted(one.answers.silent)
        ]
        if not silent and session.has_done(ControllerState.INACTIVE):
            break
        if silent and session.now > end:
            raise DriveError(
                f'{", ".join(silent)} did not arrive in answer to SYNC: '
                'correct pdos in the profile of the drive'
            )
        yield
    if any(cause.configure_again for cause in group.causes):
        raise DriveError(group.reason)
    session.is_configured = True
    session.unconfirmed = ''


def _prepare(session: Session, exchange: CyclicExchange) -> Steps[list[str]]:
    """Reset, identify, write, prove and start all drives; return notes for the operator."""
    failure, notes = None, list[list[str]]()
    for monitor in session.monitors:
        monitor.boot_ups = 0
        monitor.forget_errors()
    try:
        session.command('RESET', session.monitors)  # so that no old state is left
        yield from _wait(
            session,
            lambda one: one.boot_ups > 0,
            max(
                session.settings.boot_timeout,
                *(one.profile.quirks.boot_time for one in session.monitors),
            ),
            f'sent no boot-up message on {exchange.bus} after its reset: check its power, its '
            'node id and the bit rate of the bus; if it boots longer, set quirks.boot_time in '
            'its profile',
        )
        session.command('PRE-OPERATIONAL', session.monitors)
        yield from _each(session, Drive.identify)
        notes = yield from _each(session, Drive.configure)
        yield from _start_nodes(session)
    except DriveError as error:
        failure = error
    for monitor in session.monitors:
        if monitor.boot_ups > 1:
            raise DriveError(
                f'{monitor.title} sent {monitor.boot_ups} boot-up messages after one reset: more '
                'than one drive has this node id (commission scan names them), or its power '
                'fails'
            ) from failure
    if failure is not None:
        raise failure
    return [*chain(*notes)]


def _start_nodes(session: Session) -> Steps[None]:
    """Start all nodes; only the heartbeat of a drive proves that it is operational."""
    session.command('OPERATIONAL', session.monitors)
    since = session.now
    yield from _wait(
        session,
        lambda one: (
            one.nmt_state == 'OPERATIONAL' and (one.heartbeat_time or 0.0) >= since
        ),
        session.settings.step_timeout,
        'did not confirm by its heartbeat that it is operational',
    )


def home(session: Session) -> Steps[str]:
    """Power on in homing mode, home rank after rank, and power off."""
    group = session.group
    _require_power_allowed(session, 'home')
    positions_of(session.monitors)
    group.home(session.now)
    for monitor in session.monitors:
        monitor.encoder.begin_homing()
    while not (group.is_stopped or session.has_done(ControllerState.INACTIVE)):
        for homing, monitor in zip(group.homing, session.monitors, strict=True):
            if homing.is_homed:  # while the others home, it may slip
                monitor.encoder.find_home()
        yield
    for homing, monitor in zip(group.homing, session.monitors, strict=True):
        monitor.encoder.end_homing(
            homing.is_homed
        )  # not before their positions have settled
    report = (
        'Homing: '
        + ', '.join(
            f'{monitor.name} is homed, at {monitor.position:.4f} m'
            if monitor.encoder.homed
            else f'{monitor.name} is not homed'
            for monitor in session.monitors
        )
        + '.'
    )
    if group.is_stopped:
        raise DriveError(f'{group.reason}. {report}')
    return report


def activate(session: Session) -> Steps[str]:
    """Power the drives if the carriages are homed and inside limits, then follow targets."""
    _require_power_allowed(session, 'activate')
    if session.group.state is ControllerState.INACTIVE:
        if session.unhomed:
            raise DriveStateError(
                f'activate is not possible, {" and ".join(session.unhomed)} must be homed'
            )
        positions = positions_of(session.monitors)
        try:
            session.mechanism.check_targets(positions)
        except ManipulatorError as error:
            raise DriveStateError(
                f'activate is not possible from here: {error.problem}; '
                'next: move the carriages by hand'
            ) from error
    session.group.enable(session.now)
    yield from _until(session, ControllerState.ACTIVE)
    return 'The drives are powered and follow setpoints.'


def _require_power_allowed(session: Session, request: str) -> None:
    """Raise a DriveStateError if power is forbidden, or would stay on without this master."""
    unstopped = [one.title for one in session.monitors if not one.stops_without_master]
    reason = (
        session.forbidden
        if not unstopped
        else (
            f'{" and ".join(unstopped)} would continue to move if this computer were silent '
            '(no 1016h, or no reaction such as 6007h): correct the profile'
        )
    )
    if reason:
        raise DriveStateError(f'{request} is not possible: {reason}')


def deactivate(session: Session) -> Steps[str]:
    """Come to rest on the path, then power off."""
    session.group.disable(session.now)
    yield from _until(session, ControllerState.INACTIVE)
    return 'The carriages are at rest.'


def halt(session: Session) -> Steps[str]:
    """Come to rest on the path and hold; a homing or an activation is cancelled."""
    group = session.group
    before = group.state
    if not group.halt(session.now):
        return 'No carriage moves.'
    yield from _until(session, ControllerState.HALTED, ControllerState.INACTIVE)
    if group.state is ControllerState.HALTED:
        return 'The carriages are at rest and hold their positions.'
    if before is ControllerState.HOMING:
        return 'Homing is cancelled.'
    if before is ControllerState.DEACTIVATING:  # by an earlier halt
        return 'The carriages are at rest.'
    return 'The activation is cancelled.'


def clear_faults(session: Session) -> Steps[str]:
    """End a halt, or prove that the drives are as configured and reset their faults."""
    group, reason = session.group, session.group.reason
    if group.state is ControllerState.HALTED:
        group.enable(session.now)
        return 'The halt is ended; the drives follow setpoints.'
    if not reason:
        return 'There is no fault to clear.'
    group.require_resettable()
    try:
        session.command(
            'PRE-OPERATIONAL',
            [  # stopped nodes have no SDO
                one for one in session.monitors if one.nmt_state == 'STOPPED'
            ],
        )
        yield from _each(session, Drive.prove)
        yield from _start_nodes(session)
    except DriveError as error:
        for monitor in session.monitors:  # a drive that differs may have restarted
            monitor.encoder.distrust()
        remedy = error.remedy or Remedy.CONFIGURE
        group.stop(Cause(error.problem, remedy, configure_again=True), session.now)
        raise DriveError(f'The faults remain: {error.problem}') from error
    while not group.has_stopped:
        yield
    group.reset(session.now)
    while not (group.is_stopped or session.has_done(ControllerState.INACTIVE)):
        yield
    if group.is_stopped:
        causes = '; '.join(cause.message for cause in group.causes)
        raise DriveError(f'The faults remain: {causes}')
    return f'The faults are cleared ({reason}).'


def self_test(session: Session) -> Steps[dict[str, str]]:
    """Prove identity, units and objects of the drives; return a problem, or ``''``, by axis."""
    if session.group.state.has_power:
        raise DriveStateError('self_test is not possible while the drives have power')

    def problem(drive: Drive) -> Steps[tuple[str, str]]:
        try:
            yield from drive.prove()
        except DriveError as error:
            return drive.monitor.name, str(error)
        return drive.monitor.name, ''

    return dict((yield from _each(session, problem)))


def cleanup(session: Session) -> Steps[str]:
    """Cut the power and close the bus."""
    if session.group.state.has_power:
        raise DriveStateError('cleanup is not possible while the drives have power')
    return (yield from _cut_power_and_close(session))


def close(session: Session) -> Steps[str]:
    """Power off in order, or stop the drives if that fails; then close the bus."""
    group, end = session.group, session.now + ORDERLY_STOP_TIMEOUT
    if group.state.has_power:
        try:
            group.disable(session.now)
        except DriveStateError:
            group.stop(Cause('the drive controller is being closed'), session.now)
    while (
        not session.lost
        and session.now <= end
        and not (group.has_stopped or group.state is ControllerState.INACTIVE)
    ):
        yield
    try:
        return (yield from _cut_power_and_close(session))
    finally:
        session.is_closed = True


def _cut_power_and_close(session: Session) -> Steps[str]:
    """
    Cut the power and close the bus; return the message.

    Raises a DriveError with the drives that have not confirmed that they have no power; the bus
    is closed in any case.
    """
    since = session.now
    end = since + STOP_AND_CUT * session.settings.step_timeout
    if not session.is_configured:
        return _close_unconfigured(session)
    if not session.lost:
        session.group.cut_power(since)
    while (
        (unsure := _unconfirmed(session, since))
        and session.now < end
        and not session.lost
    ):
        yield
    if (
        unsure and not session.lost
    ):  # PDOs may not reach the drives, and stopped ones have no SDO
        try:
            session.command('PRE-OPERATIONAL', unsure)
            states = yield from _each(session, Drive.switch_off, ASKING_TIMEOUT)
        except BusError as error:
            session.lose(error)
        else:
            unsure = [
                one
                for one, state in zip(session.monitors, states, strict=True)
                if one in unsure and state not in UNPOWERED_STATES
            ]
    reason = (
        f'the bus is lost, {session.lost}'
        if session.lost
        else 'the drives do not answer'
    )
    session.close_bus([one for one in session.monitors if one not in unsure])
    if unsure:
        session.unconfirmed = (
            f'The bus is closed, but the power of {" and ".join(one.title for one in unsure)} is '
            f'not confirmed off: {reason}; switch the supply off before a person reaches in'
        )
        raise DriveError(session.unconfirmed)
    return 'The drives have confirmed that their power is off; the bus is closed.'


def _close_unconfigured(session: Session) -> str:
    """Close the bus; raise the DriveError of an earlier cleanup that could not confirm."""
    session.close_bus(session.without_power())
    if session.unconfirmed:
        raise DriveError(session.unconfirmed)
    return 'The bus is closed; no drive was configured.'


def _unconfirmed(session: Session, since: float) -> list[AxisMonitor]:
    """Return the drives that have not confirmed since a time [s] that they have no power."""
    return [
        one
        for one in session.monitors
        if one.answers.newest <= since
        or one.snapshot(None, since).power is not Power.CONFIRMED_OFF
    ]


def _until(session: Session, *states: ControllerState) -> Steps[None]:
    """
    Wait until all drives have reached one of the states.

    Raises a DriveError with the cause if the drives are stopped before that.
    """
    while not session.has_done(*states):
        yield
        if session.group.is_stopped:
            raise DriveError(session.group.reason)


def _wait(
    session: Session,
    condition: Callable[[AxisMonitor], bool],
    timeout: float,
    failure: str,
) -> Steps[None]:
    """Wait until a condition holds for all drives; a DriveError names the others."""
    end = session.now + timeout
    while missing := ' and '.join(
        one.title for one in session.monitors if not condition(one)
    ):
        if session.now > end:
            raise DriveError(f'{missing} {failure} (waited {timeout:g} s)')
        yield


def _each(
    session: Session,
    work: Callable[[Drive], Steps[Result]],
    timeout: float | None = None,
) -> Steps[list[Result]]:
    """
    Do the steps of each drive, all drives at the same time; return the results.

    Raises a DriveError that names the failures of all drives.
    """
    drives = session.exchange.drives if session.exchange else ()
    deadline = session.now + (timeout or TURN_TIMEOUT)
    try:
        running = [drive.begin(work(drive), deadline) for drive in drives]
        while not all(one.is_done for one in running):
            yield
            for drive in drives:
                drive.resume()
    finally:  # a cancelled request sends nothing more
        for drive in drives:
            drive.end()
    errors = [one.error for one in running if isinstance(one.error, DriveError)]
    if len(errors) > 1:
        raise DriveError(joined(*map(str, errors))) from errors[0]
    return [one.result() for one in running]  # raises the only error


class Request(NamedTuple):
    """Request: its generator function, and the state of the controller while it runs."""

    run: Callable[[Session], Steps[Any]]
    state: ControllerState
    #: whether the drives must be configured, or must not; None if both are possible
    needs_drives: bool | None = True
    interrupts: bool = False  #: whether it cancels another request
    needs_bus: bool = True  #: whether it fails if the bus is lost meanwhile


REQUESTS = {
    'configure': Request(configure, ControllerState.CONFIGURING, needs_drives=False),
    'home': Request(home, ControllerState.HOMING),
    'activate': Request(activate, ControllerState.ACTIVATING),
    'deactivate': Request(deactivate, ControllerState.DEACTIVATING),
    'halt': Request(halt, ControllerState.HALTING, interrupts=True),
    'clear_faults': Request(clear_faults, ControllerState.CLEARING),
    'self_test': Request(self_test, ControllerState.TESTING),
    'cleanup': Request(cleanup, ControllerState.CLEANING_UP, needs_bus=False),
    'close': Request(
        close,
        ControllerState.CLEANING_UP,
        needs_drives=None,
        interrupts=True,
        needs_bus=False,
    ),
}
