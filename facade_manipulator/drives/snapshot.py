"""
Immutable snapshot of the controller and its drives in one cycle.

`ControllerState` is between the lifecycle (ROS) and the statusword (CiA 402).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

from facade_manipulator.canopen.link import BusStatistics
from facade_manipulator.drives.states import (
    decode_state,
    Power,
    State,
    UNPOWERED_STATES,
)


class ControllerState(Enum):
    """
    State shown to the operator: of the group, of a request or of the bus.

    The controller holds these three states separately, and publishes one of them (`publication`).
    """

    # of the group: the values of `GroupState`
    INACTIVE = 'inactive'
    HOMING = 'homing'
    ACTIVATING = 'activating'
    ACTIVE = 'active'
    HALTED = 'halted'
    DEACTIVATING = 'deactivating'
    STOPPED = 'stopped'
    CLEARING = 'clearing faults'
    # of a request in progress, or one of the group
    CONFIGURING = 'configuring'
    HALTING = 'halting'
    TESTING = 'testing itself'
    CLEANING_UP = 'cleaning up'
    # of the bus and the control loop
    UNCONFIGURED = 'unconfigured'
    BUS_LOST = 'bus lost'
    CLOSED = 'closed'
    SILENT = 'control loop silent'
    LOST = 'control loop lost'

    __hash__ = object.__hash__

    @property
    def is_active(self) -> bool:
        """Return whether the drives follow setpoints, or begin or stop following them."""
        return self in _ACTIVE

    @property
    def has_power(self) -> bool:
        """Return whether the drives should have power in this state."""
        return self in _ACTIVE or self is ControllerState.HOMING


_ACTIVE = frozenset(
    {
        ControllerState.ACTIVATING,
        ControllerState.ACTIVE,
        ControllerState.HALTING,
        ControllerState.HALTED,
        ControllerState.DEACTIVATING,
    }
)


class Remedy:
    """Actions shared by several causes; the operator performs them before any request."""

    BUS = 'check the CAN bus, wait until it is back'
    TRACKING = 'check load, drive and controller.drive_lag of the carriage that lags'
    COMPUTER = 'end other programs on this computer'
    CONFIGURE = 'check power and cable of the drive'
    START_DRIVER = 'start the driver again'
    OTHER_MASTER = (
        'find the other master (a second driver, a configuration tool) and end it'
    )


@dataclass(frozen=True)
class Cause:
    """Cause that stops the group."""

    message: str  #: what happened
    remedy: str = 'remove the cause'  #: may be one of `Remedy`
    axis: str = ''  #: name of the axis with the fault; ``''`` for none
    cut_power: bool = False  #: whether the drives lose power once they are at rest
    #: whether clear_faults is insufficient: the drives must be configured again
    configure_again: bool = False
    #: whether a further cause of the same axis may explain why the drive is silent or in fault
    is_vague: bool = False
    is_requested: bool = False  #: whether a supervisor has requested the stop

    def next_step(self, is_homed: bool) -> str:
        """Return the operator's action, followed by the requests in order."""
        requests = f'clear_faults, {"" if is_homed else "home, "}activate'
        if self.configure_again:
            requests = 'cleanup, configure, home, activate'
        return f'{self.remedy}, then {requests}'


@dataclass
class CycleStatistics:
    """Counters of the cycle."""

    cycles: int = 0  #: SYNCs answered by a step of the control loop
    incomplete: int = (
        0  #: cycles in which a drive's answer had not arrived before the step
    )
    #: cycles whose commands came later than `cycle.COMMANDS_DUE`; if the kernel sends SYNC, their
    #: targets were not sent, and the drives held the previous targets
    late: int = 0
    skipped: int = 0  #: periods that passed without a SYNC
    worst: float = 0.0  #: longest time from SYNC to the step [s]
    late_share: float = 0.0  #: of the last `cycle.LATE_WINDOW` cycles that are complete


class JointStates(NamedTuple):
    """Measured state of the three carriages at one SYNC."""

    stamp: float  #: time of the SYNC on the system clock [s]
    positions: Sequence[float]  #: [m]
    velocities: Sequence[float]  #: [m/s]; 0 where none was ever received
    forces: Sequence[float]  #: [N]; 0 where none was ever received


class AxisSnapshot(NamedTuple):
    """State of one axis in SI units; None marks a value that was never received."""

    name: str
    node_id: int
    statusword: int | None = None  #: 6041h
    position: float | None = None  #: of the carriage along the rail [m]
    velocity: float | None = None  #: [m/s]
    force: float | None = None  #: on the carriage, that of the motor's torque [N]
    following_error: float | None = None  #: demand minus actual position [m]
    digital_inputs: int | None = None  #: 60FDh
    homed: bool = False
    error_code: int = 0  #: last error code, 0 for none
    heartbeat_age: float | None = None  #: [s]
    missed: int = 0  #: SYNCs that the drive did not answer
    serial_number: int | None = None  #: as read at configure
    target: float | None = None  #: commanded position [m] while the drives follow
    is_silent: bool = False  #: whether the drive no longer answers: its values are old
    error: str = ''  #: the last error as a message, ``''`` for none
    warning: str = ''  #: warning of the drive and its remedy; ``''`` for nothing

    @property
    def state(self) -> State | None:
        """Return the CiA 402 state, None if the statusword encodes no valid state."""
        return None if self.statusword is None else decode_state(self.statusword)

    @property
    def power(self) -> Power:
        """Return the power state of the motor: off only while the drive confirms it."""
        if self.is_silent or self.state is None:
            return Power.UNKNOWN
        is_off = self.state in UNPOWERED_STATES
        return Power.CONFIRMED_OFF if is_off else Power.ON


class ControllerSnapshot(NamedTuple):
    """State of the controller and its axes in one cycle."""

    state: ControllerState
    stamp: (
        float | None
    )  #: when the drives sampled the positions (SYNC), on the system clock [s]
    axes: tuple[AxisSnapshot, ...]  #: in the order q1, q2, q3
    causes: tuple[Cause, ...] = ()  #: why the drives are stopped, the first cause first
    next_step: str = ''  #: action of the operator and the requests after it
    #: rejected real-time settings, and objects or checks that configure has skipped
    notes: tuple[str, ...] = ()
    cycle: CycleStatistics = CycleStatistics()
    bus: BusStatistics = BusStatistics()
    bus_error: str = ''  #: why the bus is not open, ``''`` if it is
    realtime_priority: int | None = (
        None  #: of the control loop; 0 for normal scheduling
    )

    @property
    def cause(self) -> str:
        """Return the reason why the drives are stopped, ``''`` if they are not stopped."""
        return self.causes[0].message if self.causes else ''

    @property
    def unhomed(self) -> tuple[str, ...]:
        """Return the names of the axes that must be homed."""
        return tuple(axis.name for axis in self.axes if not axis.homed)

    @property
    def power(self) -> str:
        """Return the power state of the drives in words, of each drive if they differ."""
        powers = {axis.name: axis.power.value for axis in self.axes}
        if len({*powers.values()}) == 1:
            return self.axes[0].power.value
        return ', '.join(f'{name} {power}' for name, power in powers.items())

    def joints(self) -> JointStates | None:
        """
        Return the joint states; None unless all axes are homed and answer.

        The counts of an encoder that was not homed are not a carriage position.
        """
        if not self.stamp or not all(
            [
                one.homed and not one.is_silent and one.position is not None
                for one in self.axes
            ]
        ):
            return None
        return JointStates(
            self.stamp,
            *zip(
                *[
                    (one.position, one.velocity or 0.0, one.force or 0.0)
                    for one in self.axes
                ],
                strict=True,
            ),
        )

    def component_states(self) -> tuple[Any, ...]:
        """Return the values from which levels and messages of bus and axes are derived."""
        axes = [
            (axis.state, axis.homed, axis.error_code, axis.is_silent, axis.warning)
            for axis in self.axes
        ]
        return self.bus_error, axes
