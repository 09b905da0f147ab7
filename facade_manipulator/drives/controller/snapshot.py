"""What the controller shows of itself: immutable, of one cycle."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from facade_manipulator.drives.canopen import BusStatistics
from facade_manipulator.drives.cia402 import State
from facade_manipulator.drives.controller.cycle import CycleStatistics


class ControllerState(Enum):
    """What the controller is doing."""

    UNCONFIGURED = 'unconfigured'
    CONFIGURING = 'configuring'
    INACTIVE = 'inactive'
    HOMING = 'homing'
    ACTIVATING = 'activating'
    ACTIVE = 'active'
    HALTING = 'halting'
    HALTED = 'halted'
    DEACTIVATING = 'deactivating'
    STOPPED = 'stopped'
    CLEARING = 'clearing faults'
    TESTING = 'testing itself'
    BUS_LOST = 'bus lost'
    CLEANING_UP = 'cleaning up'
    CLOSED = 'closed'


class AxisSnapshot(NamedTuple):
    """
    One axis; what was never heard is None.

    Attributes
    ----------
    name : str
    node_id : int
    serial_number : int or None
        As the drive told at configure.
    position : float or None
        Actual position [m].
    velocity : float or None
        Actual velocity [m/s].
    force : float or None
        Force of the carriage along the rail [N], from the motor's torque.
    following_error : float or None
        [m].
    target : float or None
        Commanded position [m] while the drives follow.
    statusword : int or None
    state : State or None
        CiA 402 state, None if the statusword names none.
    mode : int or None
        Mode of operation display.
    digital_inputs : int or None
        60FD.
    homed : bool
    error_code : int
        Last error code, 0 for none.
    error : str
        The same as a message, ``''`` for none.
    nmt_state : int or None
    heartbeat_age : float or None
        [s]
    missed : int
        SYNCs that the drive did not answer.

    """

    name: str
    node_id: int
    serial_number: int | None = None
    position: float | None = None
    velocity: float | None = None
    force: float | None = None
    following_error: float | None = None
    target: float | None = None
    statusword: int | None = None
    state: State | None = None
    mode: int | None = None
    digital_inputs: int | None = None
    homed: bool = False
    error_code: int = 0
    error: str = ''
    nmt_state: int | None = None
    heartbeat_age: float | None = None
    missed: int = 0


class ControllerSnapshot(NamedTuple):
    """
    The controller and its axes at one cycle.

    Attributes
    ----------
    state : ControllerState
    stamp : float or None
        When the drives sampled the positions (SYNC), on the system clock [s].
    axes : tuple of AxisSnapshot
        In the order q1, q2, q3.
    cause : str
        Why the drives are stopped, ``''`` if they are not.
    next_step : str
        What the operator does about it.
    further_causes : tuple of str
        What happened after that.
    notes : tuple of str
        What was skipped or rejected without stopping anything.
    cycle : CycleStatistics
    bus : BusStatistics
    bus_error : str
        Why the bus is not open, ``''`` if it is.
    bus_load : float
        Worst-case share of the bus.

    """

    state: ControllerState
    stamp: float | None
    axes: tuple[AxisSnapshot, ...]
    cause: str = ''
    next_step: str = ''
    further_causes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    cycle: CycleStatistics = CycleStatistics()
    bus: BusStatistics = BusStatistics()
    bus_error: str = ''
    bus_load: float = 0.0

    @property
    def unhomed(self) -> tuple[str, ...]:
        """Names of the axes that must be homed."""
        return tuple(axis.name for axis in self.axes if not axis.homed)

