"""Diagnostic components of the driver, derived from a snapshot of the controller."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.drives.outcome import (
    DriverOutcome,
    ERRORS,
    outcome_of,
    overload,
)
from facade_manipulator.drives.realtime import NO_PRIORITY
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.drives.states import describe_state, State
from facade_manipulator.errors import joined, NEXT
from facade_manipulator.motion.follower import StreamStatus
from facade_manipulator.nodes.diagnostics import diagnostic_status


class StopCounter:
    """Counter of stops for the driver node, which passes each new state of the drives."""

    def __init__(self) -> None:
        self._state: ControllerState | None = None  # of the present stop
        self._counts = {'drive faults': 0, 'software stops': 0}

    @property
    def values(self) -> dict[str, int]:
        """Return the counts as values for /diagnostics."""
        return dict(self._counts)

    def count(self, snapshot: ControllerSnapshot) -> str:
        """Count a new stop; return its log message, or ``''`` without a new stop."""
        before = self._state
        self._state = snapshot.state if snapshot.state in ERRORS else None
        if self._state in (None, before):
            return ''
        log = outcome_of(snapshot).with_next_step(snapshot.bus_error or snapshot.cause)
        if before is ControllerState.SILENT:  # its drives have stopped by themselves
            return log
        is_requested = self._state is ControllerState.STOPPED and any(
            cause.is_requested for cause in snapshot.causes[:1]
        )
        self._counts['software stops' if is_requested else 'drive faults'] += 1
        return log


def operation_status(
    outcome: DriverOutcome,
    snapshot: ControllerSnapshot,
    stream: StreamStatus,
    active_since: float,
    more: dict[str, Any],
    node_notes: tuple[str, ...],
) -> DiagnosticStatus:
    """
    Return the component of the drive group, which is also published on driver/status.

    `active_since` is the time since which the drives follow setpoints [s, ROS time], infinite
    while they do not. The notes of the node follow those of the drives.
    """
    return diagnostic_status(
        'operation',
        outcome.level,
        outcome.message,
        {
            'state': outcome.state,
            'power': outcome.power,
            'activity': outcome.activity,
            'cause': outcome.cause,
            'next step': outcome.next_step,
            'active since': str(active_since),  # all digits
            'further causes': '; '.join(one.message for one in snapshot.causes[1:]),
            'notes': '; '.join(snapshot.notes + node_notes),
            'not homed': ', '.join(snapshot.unhomed),
            'limited cycles': stream.limited_cycles,
            'brakes': stream.brakes,
            'last brake': stream.last_brake,
            **more,
        },
    )


_BUS_WORDS = {
    ControllerState.UNCONFIGURED: 'closed',
    ControllerState.CLOSED: 'closed',
    ControllerState.CONFIGURING: 'configuring',
}


def bus_status(snapshot: ControllerSnapshot, is_real: bool) -> DiagnosticStatus:
    """Return the component of bus and cycle; for real drives, require real-time priority."""
    cycle = snapshot.cycle
    bus = snapshot.bus
    values = {
        'cycles': cycle.cycles,
        'missed cycles': cycle.incomplete,
        'late commands': cycle.late,
        'skipped SYNCs': cycle.skipped,
        'worst lateness [ms]': 1e3 * cycle.worst,
        'late share [%]': 100.0 * cycle.late_share,
        'real-time priority': snapshot.realtime_priority,
        **{name.replace('_', ' '): value for name, value in vars(bus).items()},
    }
    lost = snapshot.bus_error
    if snapshot.state in (ControllerState.SILENT, ControllerState.LOST):
        lost = f'unknown: {snapshot.cause}'
    if lost:
        message = outcome_of(snapshot).with_next_step(lost)
        return diagnostic_status('bus', 'error', message, values)

    warnings = []
    if late := overload(snapshot):
        warnings.append(late)
    elif snapshot.realtime_priority == 0 and is_real:
        warnings.append(NO_PRIORITY)
    if bus.condition != 'active' or bus.overflows:
        warnings.append(
            f'the CAN controller is {bus.condition}, with {bus.overflows} overflows'
            f'{NEXT}check wiring, termination and bit rate'
        )
    return diagnostic_status(
        'bus',
        'warn' if warnings else 'ok',
        joined(_BUS_WORDS.get(snapshot.state, 'open'), *warnings),
        values,
    )


def axis_status(axis: AxisSnapshot) -> DiagnosticStatus:
    """Return the component of a drive, whose serial number is the hardware id (REP 107)."""
    values = {
        'node id': axis.node_id,
        'statusword': _hex(axis.statusword),
        'power': axis.power.value,
        'homed': axis.homed,
        'position [m]': axis.position,
        'velocity [m/s]': axis.velocity,
        'force [N]': axis.force,
        'following error [m]': axis.following_error,
        'target [m]': axis.target,
        'digital inputs': _hex(axis.digital_inputs),
        'error code': _hex(axis.error_code),
        'heartbeat age [s]': axis.heartbeat_age,
        'missed': axis.missed,
    }
    serial_number = axis.serial_number
    identity = f'node {axis.node_id}' if serial_number is None else str(serial_number)
    return diagnostic_status(axis.name, *_axis_outcome(axis), values, identity)


FAULTS = (State.FAULT, State.FAULT_REACTION_ACTIVE)


def _axis_outcome(axis: AxisSnapshot) -> tuple[str, str]:
    """Return level and message of a drive's component."""
    if axis.is_silent:
        before = '' if axis.state is None else f'; before: {_words(axis.state)}'
        return 'stale', f'silent: these values are old{before}'
    if axis.state in FAULTS:
        return 'error', axis.error or 'in fault; the drive sent no error code'
    if axis.statusword is None:
        # While no SYNC is unanswered this is not a fault: diagnostic_aggregator reports a stale
        # component beside others as an error.
        return 'stale' if axis.missed else 'ok', 'no frame received yet'
    if axis.state is None:
        return 'warn', joined(describe_state(axis.statusword), axis.warning)
    state = _words(axis.state) + ('' if axis.homed else ', not homed')
    return ('warn', f'{state}; {axis.warning}') if axis.warning else ('ok', state)


def _words(state: State) -> str:
    return state.name.lower().replace('_', ' ')


def _hex(value: int | None) -> str:
    return '-' if value is None else f'{value:04X}h'
