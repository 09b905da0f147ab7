"""Steps of cleanup and close: cut the power, wait for confirmation, close the bus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from facade_manipulator.canopen.sdo import Steps
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.sdo_access import SdoAccess
from facade_manipulator.drives.states import UNPOWERED_STATES
from facade_manipulator.drives.waiting import each
from facade_manipulator.errors import BusError, DriveError
from facade_manipulator.timeouts import ASKING_TIMEOUT, STOP_AND_CUT

if TYPE_CHECKING:
    from facade_manipulator.drives.controller import DriveController


def cut_power_and_close(controller: DriveController) -> Steps[str]:
    """
    Cut the power and close the bus; return the message.

    Raises a DriveError with the drives that have not confirmed that they have no power; the bus
    is closed in any case.
    """
    bus = controller.bus
    if not bus.is_configured:
        return _close_unconfigured(controller)

    since = controller.now
    end = since + STOP_AND_CUT * controller.settings.step_timeout
    if not bus.lost:
        controller.group.cut_power(since)
    unsure = _unconfirmed(controller, since)
    while unsure and controller.now < end and not bus.lost:
        yield
        unsure = _unconfirmed(controller, since)
    if unsure and not bus.lost:
        unsure = yield from _switch_off(controller, unsure)

    reason = 'the drives do not answer'
    if bus.lost:
        reason = f'the bus is lost: {bus.lost}'
    controller.close_bus([axis for axis in controller.axes if axis not in unsure])
    if unsure:
        titles = ' and '.join(axis.title for axis in unsure)
        bus.leave_unconfirmed(
            f'The bus is closed, but the power of {titles} is not confirmed off: {reason}; '
            'switch the supply off before a person reaches in'
        )
        raise DriveError(bus.unconfirmed)
    return 'The drives have confirmed that their power is off; the bus is closed.'


def _close_unconfigured(controller: DriveController) -> str:
    """Close the bus; raise the DriveError if an earlier cleanup could not confirm power off."""
    controller.close_bus(controller.without_power())
    if controller.bus.unconfirmed:
        raise DriveError(controller.bus.unconfirmed)
    return 'The bus is closed; no drive was configured.'


def _unconfirmed(controller: DriveController, since: float) -> list[Axis]:
    """Return the axes whose drives have not confirmed power off since a time [s]."""
    unsure = []
    for axis in controller.axes:
        has_answered = axis.answers.newest > since
        if not has_answered or not axis.has_confirmed_off(since):
            unsure.append(axis)
    return unsure


def _switch_off(controller: DriveController, unsure: list[Axis]) -> Steps[list[Axis]]:
    """
    Switch drives off through SDO; return the axes that still do not confirm power off.

    PDOs may not reach the drives, and stopped drives have no SDO.
    """
    try:
        controller.bus.command('PRE-OPERATIONAL', unsure)
        states = yield from each(controller, SdoAccess.switch_off, ASKING_TIMEOUT)
    except BusError as error:
        controller.lose(error)
        return unsure
    still = []
    for axis, state in zip(controller.axes, states, strict=True):
        if axis in unsure and state not in UNPOWERED_STATES:
            still.append(axis)
    return still
