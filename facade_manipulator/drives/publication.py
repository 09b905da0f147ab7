"""
Snapshots of a controller: their contents, and when they are due.

The shown state is the state of the group, of the running request, or of the bus.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import ceil
from typing import TYPE_CHECKING

from facade_manipulator.drives.controller_settings import (
    ControllerSettings,
    STATES_RATE,
)
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
    Remedy,
)

if TYPE_CHECKING:
    from facade_manipulator.drives.controller import DriveController


class Publication:
    """
    Newest snapshot of a controller, renewed up to 100 times a second.

    The controller asks in each turn whether a snapshot is due, and also renews it in each new
    state and when a request ends.
    """

    IDLE_PERIOD = 1.0  # s between two states without a bus

    def __init__(self, settings: ControllerSettings) -> None:
        self.newest: ControllerSnapshot
        self._renewed_at = 0.0
        # cycles from state to state
        self._every = ceil(settings.rate / STATES_RATE)
        self._rejected: tuple[str, ...] = ()  # real-time settings
        self._priority: int | None = None

    def take_scheduling(self, rejected: Sequence[str], priority: int | None) -> None:
        """Store the rejected real-time settings and the thread's priority."""
        self._rejected = tuple(rejected)
        self._priority = priority

    def is_due(self, controller: DriveController) -> bool:
        """Return whether a snapshot is due."""
        state = present_state(controller)
        return state is not self.newest.state or self._is_time(controller)

    def _is_time(self, controller: DriveController) -> bool:
        """Return whether enough cycles have passed, or enough time without cycles."""
        age = controller.now - self._renewed_at
        exchange = controller.bus.exchange
        if exchange is None:
            return age >= self.IDLE_PERIOD
        if not exchange.has_started:
            return age >= 1.0 / STATES_RATE
        return exchange.clock.statistics.cycles % self._every == 0

    def renew(self, controller: DriveController) -> ControllerSnapshot:
        """Replace the newest snapshot; return it."""
        bus = controller.bus
        state = present_state(controller)
        snapshot = ControllerSnapshot(
            state,
            None,
            _axes(controller),
            controller.group.causes,
            _next_step(controller, state),
            self._rejected + bus.notes,
            bus_error=bus.lost,
            realtime_priority=self._priority,
        )
        exchange = bus.exchange
        if exchange is not None:
            snapshot = snapshot._replace(
                stamp=exchange.clock.sync_stamp or None,
                cycle=replace(exchange.clock.statistics),
                bus=replace(exchange.bus.statistics),
            )
        self._renewed_at = controller.now
        self.newest = snapshot
        return snapshot


def _axes(controller: DriveController) -> tuple[AxisSnapshot, ...]:
    """Return the axis snapshots; after the loss of the bus, all values count as old."""
    targets = controller.targets.positions or (None,) * 3
    snapshots = []
    for axis, target in zip(controller.axes, targets, strict=True):
        snapshot = axis.snapshot(target, controller.now)
        if controller.bus.lost:
            snapshot = snapshot._replace(is_silent=True)
        snapshots.append(snapshot)
    return tuple(snapshots)


def present_state(controller: DriveController) -> ControllerState:
    """Return the state of the running request, of the group, or of the bus."""
    if controller.is_closed:
        return ControllerState.CLOSED
    bus = controller.bus
    group = controller.group
    is_stopped = bus.is_configured and group.is_stopped
    if controller.running is not None and not is_stopped:
        return controller.running.request.state
    if bus.lost:
        return ControllerState.BUS_LOST
    if not bus.is_configured:
        return ControllerState.UNCONFIGURED
    return ControllerState(group.state.value)


NEXT_STEPS = {
    ControllerState.UNCONFIGURED: 'configure, home, activate',
    ControllerState.INACTIVE: 'activate',
    ControllerState.HALTING: 'wait until the drives are halted, then clear_faults',
    ControllerState.HALTED: 'clear_faults',
    ControllerState.ACTIVE: '',
    ControllerState.CLOSED: Remedy.START_DRIVER,
}


def _next_step(controller: DriveController, state: ControllerState) -> str:
    """Return the requests before setpoints are followed, ``''`` if they already are."""
    forbidden = controller.forbidden
    cause = controller.group.severest_cause
    if cause is not None and controller.group.is_stopped:
        step = cause.next_step(not controller.unhomed)
        return f'{forbidden.remedy}, {step}' if forbidden.remedy else step

    requests = NEXT_STEPS.get(
        state, f'wait until the drives are no longer {state.value}'
    )
    if state is ControllerState.INACTIVE and controller.unhomed:
        requests = 'home, activate'
    is_off = state in (ControllerState.UNCONFIGURED, ControllerState.INACTIVE)
    if forbidden.cause and is_off:
        if forbidden.is_latched:
            requests = f'clear_faults, {requests}'
        if forbidden.remedy:
            return f'{forbidden.remedy}, then {requests}'
    return requests
