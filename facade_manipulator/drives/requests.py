"""
The requests of an operator: one table from a name to a generator function.

The controller runs a generator: it begins it between two cycles and resumes it in each cycle
(``now = yield``) with the time [s]. Its return value is the reply. A ManipulatorError is the
reply of a failure; before the first ``yield`` it rejects the request. A request that is
cancelled is closed, so that its ``finally`` tidies up.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, NamedTuple, TypeVar

from facade_manipulator.canopen.bus import Condition
from facade_manipulator.canopen.nmt import NmtCommand, NmtState
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.drive_access import Drive, Finding
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor, positions_of
from facade_manipulator.drives.session import Session
from facade_manipulator.drives.states import UNPOWERED_STATES
from facade_manipulator.drives.targets import require_inside
from facade_manipulator.errors import (
    BusError,
    DriveError,
    DriveIdentityError,
    DriveStateError,
    DriveTimeoutError,
    ManipulatorError,
)

CLOSING_TIMEOUT = 3.0  # s
SDO_TIMEOUT = 1.5  # s, for drives that are to be switched off by SDO
STOP_AND_CUT = 2  # steps: a drive that still moves is stopped before it loses its power
LISTEN_PERIODS = 2  # of the heartbeats, before the first frame
SLOWEST = 20  # cycles in which each TPDO comes once
MAX_BAD_CYCLES = 0.001  # of all
Result = TypeVar('Result')
Steps = Generator[None, float, Any]


def configure(session: Session, now: float) -> Steps:
    """Open the bus, check and configure the drives, start the cycle."""
    if session.exchange is not None or session.lost:
        reason = (f'the bus is lost: {session.lost}' if session.lost
                  else 'the drives are configured already')
        raise DriveStateError(f'configure is not possible, {reason}')
    exchange = session.open()
    try:
        return (yield from _configure(session, exchange))
    except BaseException:  # also when it is cancelled
        session.close()
        raise


def _configure(session: Session, exchange: CyclicExchange) -> Steps:
    """Listen before the first frame: drives of another master are left as they are."""
    settings = session.settings
    end = exchange.read_until + LISTEN_PERIODS * settings.heartbeat_period
    while exchange.read_until < end:
        yield
    exchange.require_sole_master()
    if used := ', '.join(filter(None, (yield from _each(session, Drive.use)))):
        raise DriveStateError(
            f'{used}, though not by this driver: the drives are left as they are; end the other '
            'master, or switch their supply off and on')
    exchange.require_sole_master()
    exchange.transmits = True
    try:
        notes = yield from _prepare_twice(session)
    except DriveTimeoutError as error:  # a drive that is silent may be on another bus
        raise DriveTimeoutError(f'{error}. The bus is {session.bus.name}') from error
    session.notes = tuple(filter(None, (exchange.bus.sync_note, *notes)))
    exchange.require_sole_master()
    now = session.clock.monotonic()
    group = session.start_cycle(exchange, now)
    end = now + settings.step_timeout + SLOWEST * settings.period
    while not session.is_stopped:
        silent = [f'{name} of {one.title}'
                  for one in session.monitors for name in sorted(one.answers.silent)]
        if silent and now > end:
            raise DriveTimeoutError(
                f'{", ".join(silent)} did not come in answer to SYNC: '
                'correct pdos in the profile of the drive')
        if not silent and session.is_off:
            return '; '.join(filter(None, (
                f'The drives on {session.bus.name} are configured', exchange.bus.sync_note)))
        now = yield
    if any(cause.configure_again for cause in group.causes):
        raise DriveTimeoutError(group.reason)
    return f'The drives are configured, but stopped: {group.reason}.'


def _prepare_twice(session: Session) -> Generator[None, float, list[str]]:
    """Prepare the drives, again if one was switched on just now and sent a second boot-up."""
    for _ in range(2):
        notes, error = list[str](), None
        try:
            notes = yield from _prepare(session)
        except DriveError as failure:
            error = failure
        doubled = [one for one in session.monitors if one.boot_ups > session.settings.reset_nodes]
        if error is not None and not doubled:
            raise error
        if not doubled:
            return notes
    raise DriveIdentityError(
        f'{doubled[0].title} sent {doubled[0].boot_ups} boot-up messages after one reset: more '
        'than one drive has this node id (commission scan names them), or its power fails'
    ) from error


def _prepare(session: Session) -> Generator[None, float, list[str]]:
    """Reset, identify, write, prove and start all drives; return notes for the operator."""
    for monitor in session.monitors:
        monitor.boot_ups = 0
        monitor.forget_errors()
    if session.settings.reset_nodes:
        session.command(NmtCommand.RESET_NODE, session.monitors)
        yield from _wait(
            session, lambda one: one.boot_ups > 0, session.settings.boot_timeout,
            'sent no boot-up message after its reset: check its power, its node id and the bit '
            'rate of the bus')
    session.command(NmtCommand.ENTER_PRE_OPERATIONAL, session.monitors)
    yield from _each(session, Drive.identify)
    notes = yield from _each(session, Drive.configure)
    yield from _start_nodes(session)
    return [note for of_drive in notes for note in of_drive]


def _start_nodes(session: Session) -> Steps:
    """Start all nodes; only the heartbeat of a drive proves that it is operational."""
    session.command(NmtCommand.START, session.monitors)
    since = session.clock.monotonic()
    yield from _wait(
        session, lambda one: (one.nmt_state == NmtState.OPERATIONAL
                              and (one.heartbeat_time or 0.0) >= since),
        session.settings.step_timeout, 'did not confirm by its heartbeat that it is operational')


def home(session: Session, now: float) -> Steps:
    """Power on in homing mode, home rank after rank, power off."""
    group = _configured_group(session, 'home')
    session.require_power_allowed('home')
    positions_of(session.monitors)
    group.home(now)
    for monitor in session.monitors:
        monitor.encoder.begin_homing()
    while not session.is_off:
        yield
        if session.is_stopped:
            raise DriveError(f'{group.reason}. {_end_homing(session, group)}')
    return _end_homing(session, group)


def _end_homing(session: Session, group: Group) -> str:
    """Note which axes are homed, not before their positions have settled; return the report."""
    for homed, monitor in zip(group.homed, session.monitors, strict=True):
        monitor.encoder.end_homing(homed)
    return 'Homing: ' + ', '.join(
        f'{monitor.name} is homed, at {monitor.measured.position:.4f} m'
        if monitor.encoder.homed else f'{monitor.name} is not homed'
        for monitor in session.monitors) + '.'


def activate(session: Session, now: float) -> Steps:
    """Power the drives where they may be powered, then follow targets."""
    group = _configured_group(session, 'activate')
    session.require_power_allowed('activate')
    if group.state is ControllerState.INACTIVE:
        _require_ready(session)
    group.enable(now)
    yield from _until(session, group, ControllerState.ACTIVE)
    return 'The drives are powered and follow setpoints.'


def _require_ready(session: Session) -> None:
    """Check that the carriages are homed, and where they may be."""
    if session.unhomed:
        raise DriveStateError(
            f'activate is not possible, {" and ".join(session.unhomed)} must be homed')
    positions = positions_of(session.monitors)
    try:
        require_inside(session.axes, positions)
        session.targets.mechanism.check_targets(positions)
    except ManipulatorError as error:
        raise DriveStateError(
            f'activate is not possible from here: {error}; move the carriages by hand'
        ) from error


def deactivate(session: Session, now: float) -> Steps:
    """Come to rest on the path, then power off."""
    group = _configured_group(session, 'deactivate')
    group.disable(now)
    yield from _until(session, group, ControllerState.INACTIVE)
    return 'The carriages stand still.'


def halt(session: Session, now: float) -> Steps:
    """Come to rest on the path and hold; a homing or an activation is given up."""
    group = _configured_group(session, 'halt')
    is_homing = group.state is ControllerState.HOMING
    if not group.halt(now):
        return 'Nothing moves on.'
    yield from _until(session, group, ControllerState.HALTED, ControllerState.INACTIVE)
    if session.is_off:
        return f'{"Homing" if is_homing else "The activation"} is given up.'
    return 'The carriages stand still and hold.'


def clear_faults(session: Session, now: float) -> Steps:
    """End a halt, or prove that the drives are as configured and reset their faults."""
    group = _configured_group(session, 'clear_faults')
    reason = group.reason
    if group.state is ControllerState.HALTED:
        group.enable(now)
        return 'The halt is ended; the drives follow setpoints.'
    if not reason:
        return 'There is no fault to clear.'
    group.require_resettable(now)
    try:
        yield from _prove(session)
    except DriveError as error:
        group.stop(Cause(str(error), Remedy.CONFIGURE, configure_again=True),
                   session.clock.monotonic())
        raise DriveError(f'The faults remain: {error}') from error
    while not group.has_stopped:
        yield
    now = session.clock.monotonic()
    group.reset(now)
    while not session.is_off:
        yield
        if session.is_stopped:
            raise DriveError(f'The faults remain: {group.causes[-1].message}')
    return f'The faults are cleared ({reason}).'


def _prove(session: Session) -> Steps:
    """Prove identities, objects and PDO map once more, then start the nodes."""
    session.command(NmtCommand.ENTER_PRE_OPERATIONAL, [  # stopped nodes have no SDO
        one for one in session.monitors if one.nmt_state == NmtState.STOPPED])
    yield from _wait(
        session, lambda one: one.nmt_state != NmtState.STOPPED, session.settings.step_timeout,
        'stays in the NMT state stopped, as its heartbeat states')
    yield from _each(session, Drive.prove)
    yield from _start_nodes(session)


def self_test(session: Session, now: float) -> Steps:
    """Look at the drives, the bus and the cycle; a closed bus is opened for the test only."""
    if session.is_powered:
        raise DriveStateError('self_test is not possible while powered: deactivate first')
    if session.lost:
        raise BusError(f'self_test is not possible, the bus is lost: {session.lost}')
    is_first = session.exchange is None
    exchange = session.exchange or session.open()
    try:
        found = yield from _each(session, lambda drive: drive.inspect(not is_first))
        bus, cycle = exchange.bus.statistics, exchange.clock.statistics
        bad = cycle.incomplete + cycle.late + cycle.skipped
        causes = session.group.causes if session.group is not None else ()
        return [
            *(finding for of_drive in found for finding in of_drive),
            Finding(
                'bus', bus.condition is Condition.ACTIVE and not bus.overflows,
                f'the controller is {bus.condition.name.lower()}, {bus.error_frames} error '
                f'frames, {bus.overflows} overflows, worst-case load '
                f'{100.0 * session.bus_load:.0f} %'),
            Finding(
                'cycle', bad <= MAX_BAD_CYCLES * cycle.cycles,
                f'{cycle.cycles} cycles, {cycle.incomplete} incomplete, {cycle.late} late, '
                f'{cycle.skipped} skipped; commands at most {1e3 * cycle.worst:.1f} ms after '
                'SYNC'),
            Finding('faults', not causes,
                    '; '.join(map(str, causes)) or 'nothing has stopped the drives')]
    finally:
        if is_first:
            session.let_go()


def cleanup(session: Session, now: float) -> Steps:
    """Cut the power and close the bus."""
    group = _configured_group(session, 'cleanup')
    if group.state.has_power:
        raise DriveStateError('cleanup is not possible while the drives have power')
    return (yield from _cut_power_and_close(session, group, now))


def close(session: Session, now: float) -> Steps:
    """Power off in order if that is possible, stop if it is not; then fall silent."""
    group = session.group
    if group is None:
        session.is_closed = True
        session.close()
        return 'The bus is closed; no drive was configured.'
    end = now + CLOSING_TIMEOUT
    if not session.lost and session.is_powered:
        try:
            group.disable(now)
        except DriveStateError:
            group.stop(Cause('the drive controller is being closed'), now)
    while not session.lost and now <= end and not (
            group.has_stopped or group.state is ControllerState.INACTIVE):
        now = yield
    try:
        return (yield from _cut_power_and_close(session, group, now))
    finally:
        session.is_closed = True


def _cut_power_and_close(session: Session, group: Group, now: float) -> Steps:
    """
    Take the power off and close the bus; return the message.

    Raises a DriveError with the drives that have not confirmed that they have no power; the bus
    is closed all the same.
    """
    since, end = now, now + STOP_AND_CUT * session.settings.step_timeout
    if not session.lost:
        group.cut_power(now)
    unsure = session.unconfirmed(since)
    while unsure and now < end and not session.lost:
        now = yield
        unsure = session.unconfirmed(since)
    if unsure and not session.lost:  # PDOs may not reach the drives, and stopped ones have no SDO
        session.command(NmtCommand.ENTER_PRE_OPERATIONAL, unsure)
        jobs = {drive.monitor: session.submit(Drive.switch_off, drive)
                for drive in session.drives if drive.monitor in unsure}
        while not all(job.done() for job in jobs.values()) and now < end + SDO_TIMEOUT:
            now = yield
        unsure = [one for one, job in jobs.items()
                  if not job.done() or job.result() not in UNPOWERED_STATES]
    reason = f'the bus is lost, {session.lost}' if session.lost else 'no answer shows it'
    session.close()
    if unsure:
        raise DriveError(
            f'The bus is closed, but the power of {" and ".join(one.title for one in unsure)} is '
            f'not confirmed off: {reason}; switch the supply off before anybody reaches in')
    return 'The drives have confirmed that their power is off; the bus is closed.'


def _configured_group(session: Session, request: str) -> Group:
    """Return the state machine of the drives; raises a DriveStateError without one."""
    if session.group is None:
        raise DriveStateError(f'{request} is not possible, the drives are not configured')
    return session.group


def _until(session: Session, group: Group, *states: ControllerState) -> Steps:
    """
    Wait until all drives have reached one of the states.

    Raises a DriveError with the cause if they are stopped before that.
    """
    while not any(map(session.has_done, states)):
        yield
        if session.is_stopped:
            raise DriveError(group.reason)


def _wait(
    session: Session, condition: Callable[[AxisMonitor], bool], timeout: float, failure: str
) -> Steps:
    """Wait until a condition holds for all drives; a DriveTimeoutError names the others."""
    now = yield
    end = now + timeout
    while missing := ' and '.join(one.title for one in session.monitors if not condition(one)):
        if now > end:
            raise DriveTimeoutError(f'{missing} {failure} (waited {timeout:g} s)')
        now = yield


def _each(
    session: Session, work: Callable[[Drive], Result]
) -> Generator[None, float, list[Result]]:
    """
    Let the worker threads do something at each drive, at the same time; return the results.

    Raises a DriveError that names the failures of all drives.
    """
    jobs = [session.submit(work, drive) for drive in session.drives]
    yield
    while not all(job.done() for job in jobs):
        yield
    errors = [error for job in jobs if (error := job.exception()) is not None]
    for error in errors:
        if not isinstance(error, DriveError):
            if isinstance(error, ManipulatorError):
                raise error
            raise DriveError(
                f'checking the drives failed: {type(error).__name__}: {error}') from error
    if len(errors) > 1:
        raise DriveError('; '.join(map(str, errors))) from errors[0]
    if errors:
        raise errors[0]
    return [job.result() for job in jobs]


class Request(NamedTuple):
    """A request: its generator function, and the state of the controller while it runs."""

    run: Callable[[Session, float], Steps]
    state: ControllerState
    interrupts: bool = False  #: whether it cancels another request


REQUESTS = {
    'configure': Request(configure, ControllerState.CONFIGURING),
    'home': Request(home, ControllerState.HOMING),
    'activate': Request(activate, ControllerState.ACTIVATING),
    'deactivate': Request(deactivate, ControllerState.DEACTIVATING),
    'halt': Request(halt, ControllerState.HALTING, interrupts=True),
    'clear_faults': Request(clear_faults, ControllerState.CLEARING),
    'self_test': Request(self_test, ControllerState.TESTING),
    'cleanup': Request(cleanup, ControllerState.CLEANING_UP),
    'close': Request(close, ControllerState.CLEANING_UP, interrupts=True),
}
