"""
Requests of the operator: nine generator functions and their table.

The controller begins a generator between two cycles and resumes it in each turn of the control
loop. Its return value is the reply. A ManipulatorError is the reply to a failed request. Raised
before the first ``yield``, the error rejects the request. A request that is cancelled is closed.
The controller closes a bus whose drives are not configured when no request is left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TYPE_CHECKING

from facade_manipulator.canopen.sdo import Steps
from facade_manipulator.drives.axis import positions_of
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.sdo_access import SdoAccess
from facade_manipulator.drives.shut_down import cut_power_and_close
from facade_manipulator.drives.snapshot import Cause, ControllerState, Remedy
from facade_manipulator.drives.start_up import (
    prepare,
    require_end_of_sync,
    require_unused,
    start_cycle,
    start_nodes,
)
from facade_manipulator.drives.waiting import each, until
from facade_manipulator.errors import DriveError, DriveStateError, ManipulatorError
from facade_manipulator.timeouts import ORDERLY_STOP_TIMEOUT

if TYPE_CHECKING:
    from facade_manipulator.drives.controller import DriveController


def configure(controller: DriveController) -> Steps[str]:
    """
    Open the bus, check and configure the drives, and start the cycle.

    The request listens before its first frame, and leaves drives of another master unchanged. A
    frame of another master ends it with a BusError.
    """
    bus = controller.bus
    exchange = bus.open(controller.group, controller.targets)
    yield from require_unused(controller, exchange)
    exchange.transmitter.begin_heartbeats()
    notes = yield from prepare(controller, exchange)
    bus.take_notes(filter(None, (exchange.bus.sync_note, *notes)))
    yield from require_end_of_sync(controller, exchange)
    yield from start_cycle(controller, exchange)
    bus.confirm_configuration()
    if controller.group.is_stopped:
        return f'The drives are configured, but stopped: {controller.group.reason}.'
    return f'The drives on {exchange.bus} are configured.'


def home(controller: DriveController) -> Steps[str]:
    """
    Power on in homing mode, home the axes in order of their ranks, and power off.

    After a failure, the axes that have found home are homed. After a cancellation, no axis is
    homed.
    """
    group = controller.group
    axes = controller.axes
    controller.require_power_allowed('home')
    positions_of(axes)
    group.home(controller.now)
    try:
        while not (group.is_stopped or group.has_done(GroupState.INACTIVE)):
            for axis in axes:
                axis.watch_home()
            yield
    except GeneratorExit:
        for axis in axes:
            axis.cancel_homing()
        raise

    results = []
    for axis in axes:
        axis.end_homing()
        result = 'is not homed'
        if axis.encoder.homed:
            result = f'is homed, at {axis.feedback.position:.4f} m'
        results.append(f'{axis.name} {result}')
    report = f'Homing: {", ".join(results)}.'
    if group.is_stopped:
        raise DriveError(f'{group.reason}. {report}')
    return report


def activate(controller: DriveController) -> Steps[str]:
    """Require homed carriages inside their limits, power the drives on, then follow targets."""
    group = controller.group
    controller.require_power_allowed('activate')
    if group.state is GroupState.INACTIVE:
        unhomed = controller.unhomed
        if unhomed:
            raise DriveStateError(
                f'activate is not possible: {" and ".join(unhomed)} must be homed'
            )
        positions = positions_of(controller.axes)
        try:
            controller.targets.guard.check_targets(positions)
        except ManipulatorError as error:
            raise DriveStateError(
                f'activate is not possible from these positions: {error.problem}; '
                'next: move the carriages by hand'
            ) from error
    group.enable(controller.now)
    yield from until(controller, GroupState.ACTIVE)
    return 'The drives are powered and follow setpoints.'


def deactivate(controller: DriveController) -> Steps[str]:
    """Brake to rest on the path, then power off."""
    controller.group.disable(controller.now)
    yield from until(controller, GroupState.INACTIVE)
    return 'The carriages are at rest.'


def halt(controller: DriveController) -> Steps[str]:
    """Brake to rest on the path and hold; cancel a running homing or activation."""
    group = controller.group
    before = group.state
    running = controller.running
    is_homing = running is not None and running.name == 'home'
    if not group.halt(controller.now):
        return 'There is nothing to halt.'
    yield from until(controller, GroupState.HALTED, GroupState.INACTIVE)
    if group.state is GroupState.HALTED:
        return 'The carriages are at rest and hold their positions.'
    if is_homing:  # also at its end, while the power goes off
        return 'Homing is cancelled.'
    if before is GroupState.DEACTIVATING:  # by an earlier halt
        return 'The carriages are at rest.'
    return 'The activation is cancelled.'


def clear_faults(controller: DriveController) -> Steps[str]:
    """End a halt, or verify the configuration of the drives and reset their faults."""
    group = controller.group
    causes = group.causes
    if group.state is GroupState.HALTED:
        group.enable(controller.now)
        return 'The halt is ended; the drives follow setpoints.'
    if not causes:
        return 'There is no fault to clear.'

    group.require_resettable()
    yield from _prove_configuration(controller)
    while not group.has_stopped:
        yield
    # The operator has not seen these causes, such as another stop by the operator.
    further = [cause for cause in group.causes if cause not in causes]
    if further:
        raise DriveError(
            f'The faults remain, because the drives were stopped again: {_messages(further)}'
        )
    group.reset(controller.now)
    while not (group.is_stopped or group.has_done(GroupState.INACTIVE)):
        yield
    if group.is_stopped:
        raise DriveError(f'The faults remain: {_messages(group.causes)}')
    return f'The faults are cleared ({_messages(causes)}).'


def _prove_configuration(controller: DriveController) -> Steps[None]:
    """Verify the configuration of stopped drives; raise a DriveError if a drive differs."""
    group = controller.group
    try:
        # stopped nodes have no SDO
        stopped = [axis for axis in controller.axes if axis.node.state == 'STOPPED']
        controller.bus.command('PRE-OPERATIONAL', stopped)
        yield from each(controller, SdoAccess.prove)
        yield from start_nodes(controller)
    except DriveError as error:
        for axis in controller.axes:  # a differing drive may have restarted
            axis.encoder.distrust()
        remedy = error.remedy or Remedy.CONFIGURE
        cause = Cause(error.problem, remedy, configure_again=True)
        group.stop(cause, controller.now)
        raise DriveError(f'The faults remain: {error.problem}') from error


def _messages(causes: Iterable[Cause]) -> str:
    """Return the messages of causes, separated by semicolons."""
    return '; '.join(cause.message for cause in causes)


def self_test(controller: DriveController) -> Steps[dict[str, str]]:
    """
    Check identity, units and objects of all drives without writing.

    Return the problem of each axis by its name, ``''`` for none.
    """
    _require_without_power(controller, 'self_test')

    def find_problem(drive: SdoAccess) -> Steps[str]:
        """Return the problem of a drive, ``''`` without a problem."""
        try:
            yield from drive.prove()
        except DriveError as error:
            return str(error)
        return ''

    problems = yield from each(controller, find_problem)
    names = [axis.name for axis in controller.axes]
    return dict(zip(names, problems, strict=True))


def cleanup(controller: DriveController) -> Steps[str]:
    """Cut the power and close the bus."""
    _require_without_power(controller, 'cleanup')
    return (yield from cut_power_and_close(controller))


def _require_without_power(controller: DriveController, request: str) -> None:
    """Raise a DriveStateError while the drives should have power."""
    if controller.group.state.has_power:
        raise DriveStateError(
            f'{request} is not possible while the drives have power; next: deactivate'
        )


def close(controller: DriveController) -> Steps[str]:
    """Ramp down and power off, or stop the drives if this fails; then close the bus."""
    group = controller.group
    end = controller.now + ORDERLY_STOP_TIMEOUT
    if group.state.has_power:
        try:
            group.disable(controller.now)
        except DriveStateError:
            cause = Cause('the drive controller is being closed')
            group.stop(cause, controller.now)
    while not controller.bus.lost and controller.now <= end:
        if group.has_stopped or group.state is GroupState.INACTIVE:
            break
        yield
    try:
        return (yield from cut_power_and_close(controller))
    finally:
        controller.refuse_requests()


class Request(NamedTuple):
    """Request: its generator function, and the controller state while the request runs."""

    run: Callable[[DriveController], Steps[Any]]
    state: ControllerState
    #: True: the drives must be configured; False: they must not be; None: both are permitted
    needs_configured: bool | None = True
    #: whether it may begin while another request runs; it cancels that request unless it ends at
    #: once
    interrupts: bool = False
    needs_bus: bool = True  #: whether it fails if the bus is lost in the meantime


REQUESTS = {
    'configure': Request(
        configure, ControllerState.CONFIGURING, needs_configured=False
    ),
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
        needs_configured=None,
        interrupts=True,
        needs_bus=False,
    ),
}
