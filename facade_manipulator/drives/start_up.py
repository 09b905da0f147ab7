"""Steps of configure: listen, reset and configure the drives, start them and the cycle."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facade_manipulator.canopen.sdo import Steps
from facade_manipulator.drives import realtime
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.sdo_access import IS_OPERATIONAL, SdoAccess
from facade_manipulator.drives.waiting import each, until_all
from facade_manipulator.errors import DriveError, DriveStateError
from facade_manipulator.timeouts import ASKING_TIMEOUT

if TYPE_CHECKING:
    from facade_manipulator.drives.controller import DriveController

LISTEN_PERIODS = 2  # of the heartbeats, before the first frame


def require_unused(
    controller: DriveController, exchange: CyclicExchange
) -> Steps[None]:
    """
    Listen to the bus without changing it; do not touch the drives of another master.

    Raises a BusError for a frame of another master, a DriveStateError for a drive in use.
    """
    axes = controller.axes
    heartbeat_period = controller.settings.heartbeat_period
    yield from _listen(exchange, LISTEN_PERIODS * heartbeat_period)
    uses = yield from each(controller, SdoAccess.use, ASKING_TIMEOUT)
    exchange.masters.expect_sync(any(axis.sdo.sync.is_found for axis in axes))
    used = ', '.join(filter(None, uses))
    if used:
        hint = ''
        if IS_OPERATIONAL in used:
            hint = (
                '; if a drive is operational again after that, it starts itself: set '
                'quirks.starts_itself in its profile'
            )
        raise DriveStateError(
            f'{used}, which this driver has not commanded: the drives are left unchanged; end '
            f'the other master, or switch their supply off and on{hint}'
        )
    guard_time = max(axis.sdo.guard_time for axis in axes)
    yield from _listen(exchange, LISTEN_PERIODS * guard_time)


LONGEST_LISTENING = 5.0  # s, for a guarding or a SYNC of a drive with a long period


def _listen(exchange: CyclicExchange, seconds: float) -> Steps[None]:
    """Receive frames for a time [s]; raise a BusError if a master sends one of them."""
    end = exchange.read_until + min(seconds, LONGEST_LISTENING)
    while exchange.read_until < end:
        yield


def require_end_of_sync(
    controller: DriveController, exchange: CyclicExchange
) -> Steps[None]:
    """Listen until no drive sends SYNC; raise a BusError for the SYNC of another master."""
    exchange.masters.forget_sync()
    exchange.masters.expect_sync(False)
    producers = [axis.sdo.sync for axis in controller.axes if axis.sdo.sync.is_found]
    if not producers:
        return
    periods = [one.period for one in producers]
    longest = max(controller.settings.heartbeat_period, *periods)
    yield from _listen(exchange, LISTEN_PERIODS * longest)


def prepare(controller: DriveController, exchange: CyclicExchange) -> Steps[list[str]]:
    """Reset, identify, configure, verify and start all drives; return notes for the operator."""
    failure = None
    notes: list[list[str]] = []
    for axis in controller.axes:
        axis.expect_boot_up()
    try:
        yield from _reset(controller, exchange)
        yield from each(controller, SdoAccess.identify)
        notes = yield from each(controller, SdoAccess.configure)
        yield from start_nodes(controller)
    except DriveError as error:
        failure = error
    for axis in controller.axes:
        boot_ups = axis.node.boot_ups
        if boot_ups > 1:
            raise DriveError(
                f'{axis.title} sent {boot_ups} boot-up messages after one reset: '
                'another drive has the same node id, or the supply of the drive fails; next: '
                'run commission scan, and check the supply'
            ) from failure
    if failure is not None:
        raise failure
    return sum(notes, [])


def _reset(controller: DriveController, exchange: CyclicExchange) -> Steps[None]:
    """Reset all drives, so that no earlier state remains, and wait for their boot-up messages."""
    controller.bus.command('RESET', controller.axes)
    boot_times = [axis.profile.quirks.boot_time for axis in controller.axes]
    yield from until_all(
        controller,
        lambda axis: axis.node.boot_ups > 0,
        max(controller.settings.boot_timeout, *boot_times),
        f'sent no boot-up message on {exchange.bus} after its reset',
        'check its power, its node id and the bit rate of the bus; if it needs longer to boot, '
        'set quirks.boot_time in its profile',
    )
    controller.bus.command('PRE-OPERATIONAL', controller.axes)


def start_nodes(controller: DriveController) -> Steps[None]:
    """Start all nodes; wait for the heartbeats, which prove that the drives are operational."""
    controller.bus.command('OPERATIONAL', controller.axes)
    since = controller.now

    def is_operational(axis: Axis) -> bool:
        is_new = (axis.node.heartbeat_time or 0.0) >= since
        return is_new and axis.node.state == 'OPERATIONAL'

    yield from until_all(
        controller,
        is_operational,
        controller.settings.step_timeout,
        'did not confirm with its heartbeat that it is operational',
        'switch the drive off and on',
    )


SLOWEST = 20  # cycles in which each TPDO is sent once at 200 Hz; step_timeout covers higher rates


def start_cycle(controller: DriveController, exchange: CyclicExchange) -> Steps[None]:
    """Start the cycle with all drives switched off; wait until every drive has answered."""
    realtime.freeze_objects()  # else the first collection would take a cycle
    settings = controller.settings
    group = controller.group
    exchange.start(controller.now)
    end = controller.now + settings.step_timeout + SLOWEST * settings.period
    while not group.is_stopped:
        silent = _silent_pdos(controller)
        if not silent and group.has_done(GroupState.INACTIVE):
            break
        if silent and controller.now > end:
            raise DriveError(
                f'{", ".join(silent)} did not arrive in answer to SYNC; next: '
                'correct pdos in the profile of the drive'
            )
        yield
    if any(cause.configure_again for cause in group.causes):
        raise DriveError(group.reason)


def _silent_pdos(controller: DriveController) -> list[str]:
    """Return the TPDOs that were never received, with the names of their drives."""
    silent = []
    for axis in controller.axes:
        for name in sorted(axis.answers.silent):
            silent.append(f'{name} of {axis.title}')
    return silent
