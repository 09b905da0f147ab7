"""The controller and its drives at one cycle: immutable, made once, read by everybody."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from facade_manipulator.drives.canopen import BusStatistics, describe
from facade_manipulator.drives.cia402 import Cause, decode_state, State, Triple
from facade_manipulator.drives.controller.cycle import CycleStatistics
from facade_manipulator.errors import DriveStateError


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
    LOST = 'control loop lost'


ACTIVE_STATES = frozenset({
    ControllerState.ACTIVATING, ControllerState.ACTIVE, ControllerState.HALTING,
    ControllerState.HALTED, ControllerState.DEACTIVATING,
})
POWERED_STATES = ACTIVE_STATES | {ControllerState.HOMING}


class JointStates(NamedTuple):
    """
    The three carriages at one SYNC.

    Parameters
    ----------
    stamp : float
        Time of the SYNC on the system clock [s].
    positions, velocities, forces : tuple of float, shape (3,)
        [m, m/s, N]; a velocity or force that was never received is 0.

    """

    stamp: float
    positions: Triple
    velocities: Triple
    forces: Triple


class AxisSnapshot(NamedTuple):
    """
    One axis, in SI units; what was never received is None.

    Attributes
    ----------
    name : str
    node_id : int
    statusword : int or None
        6041h.
    position, velocity, force : float or None
        Of the carriage along the rail; the force is that of the motor's torque [m, m/s, N].
    following_error : float or None
        Demand minus actual position [m].
    digital_inputs : int or None
        60FDh.
    homed : bool
    error_code : int
        Last error code, 0 for none.
    heartbeat_age : float or None
        [s]
    is_silent : bool
        Whether the drive no longer answers: what is known of it is old.
    missed : int
        SYNCs that the drive did not answer.
    serial_number : int or None
        As read at configure.
    target : float or None
        Commanded position [m] while the drives follow.

    """

    name: str
    node_id: int
    statusword: int | None = None
    position: float | None = None
    velocity: float | None = None
    force: float | None = None
    following_error: float | None = None
    digital_inputs: int | None = None
    homed: bool = False
    error_code: int = 0
    heartbeat_age: float | None = None
    missed: int = 0
    serial_number: int | None = None
    target: float | None = None
    is_silent: bool = False

    @property
    def state(self) -> State | None:
        """CiA 402 state, None if the statusword names none."""
        try:
            return None if self.statusword is None else decode_state(self.statusword)
        except DriveStateError:
            return None

    @property
    def error(self) -> str:
        """The last error as a message, ``''`` for none."""
        return describe(self.error_code) if self.error_code else ''


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
    causes : tuple of Cause
        Why the drives are stopped, the first cause first.
    next_step : str
        What the operator does about it.
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
    causes: tuple[Cause, ...] = ()
    next_step: str = ''
    notes: tuple[str, ...] = ()
    cycle: CycleStatistics = CycleStatistics()
    bus: BusStatistics = BusStatistics()
    bus_error: str = ''
    bus_load: float = 0.0

    @property
    def cause(self) -> str:
        """Why the drives are stopped, ``''`` if they are not."""
        return self.causes[0].message if self.causes else ''

    @property
    def further_causes(self) -> tuple[str, ...]:
        """What happened after that."""
        return tuple(cause.message for cause in self.causes[1:])

    @property
    def unhomed(self) -> tuple[str, ...]:
        """Names of the axes that must be homed."""
        return tuple(axis.name for axis in self.axes if not axis.homed)

    def joints(self) -> JointStates | None:
        """
        Return where the carriages are, None unless all are homed and answer.

        An encoder that was not homed counts from anywhere: that is no carriage position.
        """
        if not self.stamp or not all(
                [axis.homed and axis.position is not None and not axis.is_silent
                 for axis in self.axes]):
            return None
        return JointStates(
            self.stamp, tuple([axis.position for axis in self.axes]),
            tuple([axis.velocity or 0.0 for axis in self.axes]),
            tuple([axis.force or 0.0 for axis in self.axes]))

    def outcome(self) -> tuple:
        """Return what the levels and messages in /diagnostics depend on."""
        return (self.state, self.causes[:1], self.next_step, self.bus_error, tuple([
            (axis.state, axis.homed, axis.error_code, axis.is_silent) for axis in self.axes]))
