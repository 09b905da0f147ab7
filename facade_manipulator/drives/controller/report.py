"""
What the control thread leaves of each cycle, and the snapshot that is made of it when asked for.

The rest of the program asks less often than the cycle turns, and never at the cycle's expense.
"""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.drives.canopen import BusStatistics, CanBus, describe
from facade_manipulator.drives.cia402 import Cause, decode_state, State, Triple
from facade_manipulator.drives.controller.cycle import CycleClock, CycleStatistics
from facade_manipulator.drives.controller.monitor import AxisMonitor, Told
from facade_manipulator.drives.controller.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.errors import DriveStateError

NO_TARGETS = (None, None, None)


class Joints(NamedTuple):
    """
    The three carriages at one SYNC.

    Parameters
    ----------
    stamp : float
        Time of the SYNC on the system clock [s].
    positions, velocities, forces : tuple of float, shape (3,)
        [m, m/s, N]; a velocity or force that was never told is 0.

    """

    stamp: float
    positions: Triple
    velocities: Triple
    forces: Triple


class Record(NamedTuple):
    """
    The controller and its drives at one cycle, unconverted.

    Attributes
    ----------
    state : ControllerState
    now : float
        Time of the record on the monotonic clock [s].
    stamp : float
        Time of the last SYNC on the system clock [s], 0 before the first.
    monitors : tuple of AxisMonitor
        Where names and units are; what the drives told is in `told`.
    told : tuple of Told
    targets : tuple of float or None
        Commanded positions [m] while the drives follow.
    causes : tuple of Cause
    next_step : str
    notes : tuple of str
    clock : CycleClock or None
        Where the cycle is counted while the bus is open.
    bus : CanBus or None
    bus_error : str
    bus_load : float

    """

    state: ControllerState
    now: float
    stamp: float
    monitors: tuple[AxisMonitor, ...]
    told: tuple[Told, ...]
    targets: Triple | None
    causes: tuple[Cause, ...]
    next_step: str
    notes: tuple[str, ...]
    clock: CycleClock | None
    bus: CanBus | None
    bus_error: str
    bus_load: float

    def joints(self) -> Joints | None:
        """
        Return where the carriages are, None until all are homed.

        An encoder that was not homed counts from anywhere: that is no carriage position.
        """
        drives = [(monitor.axis, told) for monitor, told in zip(
            self.monitors, self.told, strict=True)]
        if not self.stamp or not all(told.homed and told.status for _, told in drives):
            return None
        return Joints(
            self.stamp,
            tuple([axis.to_metres(told.status.position_counts) for axis, told in drives]),
            tuple([axis.speed_to_metres(told.motion.velocity) if told.motion else 0.0
                   for axis, told in drives]),
            tuple([axis.to_force(told.condition.torque) if told.condition else 0.0
                   for axis, told in drives]))

    def outcome(self) -> tuple:
        """Return what the controller's levels and messages depend on."""
        return (
            self.state, self.causes[:1], self.next_step, self.bus_error, tuple([
                (told.status and _state(told.status.statusword), told.homed, told.error_code)
                for told in self.told]))

    def snapshot(self) -> ControllerSnapshot:
        """Put together what the rest of the program sees."""
        return ControllerSnapshot(
            state=self.state,
            stamp=self.stamp or None,
            axes=tuple(
                axis_snapshot(monitor, told, target, self.now) for monitor, told, target in zip(
                    self.monitors, self.told, self.targets or NO_TARGETS, strict=True)),
            cause=self.causes[0].message if self.causes else '',
            next_step=self.next_step,
            further_causes=tuple(cause.message for cause in self.causes[1:]),
            notes=self.notes,
            cycle=self.clock.statistics if self.clock else CycleStatistics(),
            bus=self.bus.statistics if self.bus else BusStatistics(),
            bus_error=self.bus_error,
            bus_load=self.bus_load,
        )


def axis_snapshot(
    monitor: AxisMonitor, told: Told, target: float | None, now: float
) -> AxisSnapshot:
    """Return what a drive had told at a time of the monotonic clock, in SI units."""
    status, motion, condition = told.status, told.motion, told.condition
    axis = monitor.axis
    return AxisSnapshot(
        name=monitor.name,
        node_id=axis.node_id,
        serial_number=told.serial_number,
        position=axis.to_metres(status.position_counts) if status else None,
        velocity=axis.speed_to_metres(motion.velocity) if motion else None,
        force=axis.to_force(condition.torque) if condition else None,
        following_error=axis.to_metres(motion.following_error_counts) if motion else None,
        target=target,
        statusword=status.statusword if status else None,
        state=_state(status.statusword) if status else None,
        mode=status.mode if status else None,
        digital_inputs=condition.digital_inputs if condition else None,
        homed=told.homed,
        error_code=told.error_code,
        error=describe(told.error_code) if told.error_code else '',
        nmt_state=told.nmt_state,
        heartbeat_age=now - told.heartbeat_time if told.heartbeat_time else None,
        missed=told.missed,
    )


def _state(statusword: int) -> State | None:
    try:
        return decode_state(statusword)
    except DriveStateError:
        return None
