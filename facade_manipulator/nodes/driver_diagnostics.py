"""The driver's components in /diagnostics: what the controller's snapshot says, for people."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.drives.cia402 import State
from facade_manipulator.drives.controller import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
    Finding,
    LATENESS_BOUNDS,
)
from facade_manipulator.loop import StreamStatus
from facade_manipulator.ros import diagnostic_status

STATE_LEVELS = {
    ControllerState.STOPPED: 'error',
    ControllerState.BUS_LOST: 'error',
    ControllerState.LOST: 'error',
    ControllerState.HALTED: 'warn',
    ControllerState.HALTING: 'warn',
}
FAULTS = (State.FAULT, State.FAULT_REACTION_ACTIVE)


def operation_status(
    snapshot: ControllerSnapshot, stream: StreamStatus, last_failure: str,
    counters: dict[str, Any],
) -> DiagnosticStatus:
    """Say what the drives do as a group, why, what was rejected last and what comes next."""
    values = {
        'state': snapshot.state.value,
        'activity': stream.activity,
        'cause': snapshot.cause,
        'next step': snapshot.next_step,
        'further causes': '; '.join(snapshot.further_causes),
        'notes': '; '.join(snapshot.notes),
        'not homed': ', '.join(snapshot.unhomed),
        'limited cycles': stream.limited_cycles,
        'brakes': stream.brakes,
        'last brake': stream.last_brake,
        'states dropped': stream.dropped,
        **_margins(stream.margins),
        **counters,
    }
    level = STATE_LEVELS.get(snapshot.state, 'warn' if last_failure else 'ok')
    return diagnostic_status('operation', level, _message(snapshot, last_failure), values)


def bus_status(snapshot: ControllerSnapshot) -> DiagnosticStatus:
    """Say how the bus and the cycle do."""
    cycle, bus = snapshot.cycle, snapshot.bus
    values = {
        'cycles': cycle.cycles,
        'missed cycles': cycle.incomplete,
        'late commands': cycle.late,
        'skipped SYNCs': cycle.skipped,
        'worst lateness [ms]': 1e3 * cycle.worst,
        **_histogram(cycle.lateness),
        'worst-case load [%]': 100.0 * snapshot.bus_load,
        **{name.replace('_', ' '): value for name, value in bus._asdict().items()},
        'condition': bus.condition.name.lower(),
    }
    if snapshot.bus_error:
        return diagnostic_status('bus', 'error', snapshot.bus_error, values)
    is_open = snapshot.state is not ControllerState.UNCONFIGURED
    return diagnostic_status('bus', 'ok', 'open' if is_open else 'closed', values)


def axis_status(axis: AxisSnapshot) -> DiagnosticStatus:
    """Say how one drive does; its serial number is the hardware id (REP 107)."""
    values = {
        'node id': axis.node_id,
        'statusword': _hex(axis.statusword),
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
    serial = '' if axis.serial_number is None else str(axis.serial_number)
    if axis.state in FAULTS:
        message = axis.error or 'in fault, the drive sent no error code'
        return diagnostic_status(axis.name, 'error', message, values, serial)
    if axis.state is None:
        return diagnostic_status(axis.name, 'stale', 'nothing received yet', values, serial)
    message = axis.state.name.lower().replace('_', ' ') + ('' if axis.homed else ', not homed')
    return diagnostic_status(axis.name, 'ok', message, values, serial)


def finding_status(finding: Finding) -> DiagnosticStatus:
    """Say how one part of the self-test ended."""
    level = 'ok' if finding.passed else 'error'
    return diagnostic_status(finding.name, level, finding.message, {})


def _message(snapshot: ControllerSnapshot, last_failure: str) -> str:
    if snapshot.cause:
        return f'{snapshot.state.value}: {snapshot.cause}; next: {snapshot.next_step}'
    return f'{snapshot.state.value}; {last_failure}' if last_failure else snapshot.state.value


def _margins(margins: tuple[float, ...]) -> dict[str, float]:
    """How early setpoints come: 0 would be the instant at which the carriages should be there."""
    return {f'setpoint margin {name} [ms]': 1e3 * margin
            for name, margin in zip(('p1', 'p50'), margins, strict=False)}


def _histogram(counts: tuple[int, ...]) -> dict[str, int]:
    names = [f'lateness below {1e3 * bound:g} ms' for bound in LATENESS_BOUNDS]
    return dict(zip((*names, 'lateness beyond'), counts, strict=True))


def _hex(value: int | None) -> str:
    return '-' if value is None else f'{value:04X}h'
