"""Components of the driver on /diagnostics, built from the snapshot of the controller."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.drives.cycle import LATE_WINDOW
from facade_manipulator.drives.realtime import NO_PRIORITY, PERMIT_PRIORITY
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
    Remedy,
)
from facade_manipulator.drives.states import State
from facade_manipulator.errors import joined, NEXT
from facade_manipulator.motion.follower import StreamStatus
from facade_manipulator.nodes.diagnostics import diagnostic_status

ERRORS = (ControllerState.STOPPED, ControllerState.BUS_LOST, ControllerState.LOST)
WARNINGS = (ControllerState.HALTED, ControllerState.HALTING)
# Share of LATE_WINDOW cycles. At 100 Hz without priority, on two processors: at most 0.2 % beside
# idle programs; at least 0.8 % in each window with three late cycles in a row, beside busy ones
MAX_LATE_SHARE = 0.005
_BUS_WORDS = {
    ControllerState.UNCONFIGURED: 'closed',
    ControllerState.CLOSED: 'closed',
    ControllerState.CONFIGURING: 'configuring',
}
FAULTS = (State.FAULT, State.FAULT_REACTION_ACTIVE)


class StopCounter:
    """Counters of the stops, for the node that looks at each new state of the drives."""

    def __init__(self) -> None:
        self._state: ControllerState | None = None  # of the present stop
        self._counts = {'drive faults': 0, 'software stops': 0}

    @property
    def values(self) -> dict[str, int]:
        """Return the counts as values of /diagnostics."""
        return dict(self._counts)

    def count(self, snapshot: ControllerSnapshot) -> str:
        """Count a new stop; return its message for the log, ``''`` for none."""
        before = self._state
        self._state = snapshot.state if snapshot.state in ERRORS else None
        if self._state in (None, before):
            return ''
        is_requested = self._state is ControllerState.STOPPED and any(
            cause.is_requested for cause in snapshot.causes[:1]
        )
        self._counts['software stops' if is_requested else 'drive faults'] += 1
        return f'{snapshot.bus_error or snapshot.cause}; next: {snapshot.next_step}'


def operation_status(
    snapshot: ControllerSnapshot,
    stream: StreamStatus,
    outcome: tuple[str, str],
    counters: dict[str, Any],
) -> DiagnosticStatus:
    """Return the component of the group of drives: state, cause, last rejection, next step."""
    return diagnostic_status(
        'operation',
        *outcome,
        {
            'state': snapshot.state.value,
            'power': snapshot.power,
            'activity': stream.activity,
            'cause': snapshot.cause,
            'next step': snapshot.next_step,
            'further causes': '; '.join(one.message for one in snapshot.causes[1:]),
            'notes': '; '.join(snapshot.notes),
            'not homed': ', '.join(snapshot.unhomed),
            'limited cycles': stream.limited_cycles,
            'brakes': stream.brakes,
            'last brake': stream.last_brake,
            **counters,
        },
    )


def group_outcome(
    snapshot: ControllerSnapshot, last_failure: str, fault: str, forbidden: str
) -> tuple[str, str]:
    """
    Return level and message: the state, the most severe problem, and the next step.

    The problem is the cause of a stop, a fault of the graph, the reason that forbids power, or
    the last rejected request and an overload. The next step is that of the state. The remedy of a
    fault, which blocks the state's next step, stands before it, and that of an overload after it.
    """
    slow = overload(snapshot)
    level = 'ok'
    if last_failure or slow or forbidden or snapshot.state in WARNINGS:
        level = 'warn'
    if fault or snapshot.state in ERRORS:
        level = 'error'

    doing = snapshot.state.value
    following = f'{NEXT}{snapshot.next_step}' if snapshot.next_step else ''
    if reason := snapshot.cause or ('' if fault else forbidden):
        return level, f'{doing}: {reason}{following}'
    if fault:
        return level, joined(doing, fault, following)
    failure, _, _ = last_failure.partition(NEXT)  # its next step may be done
    return level, joined(doing + following, failure, slow)


def overload(snapshot: ControllerSnapshot) -> str:
    """Return a warning if the computer is too slow for the cycle, else ``''``."""
    share = snapshot.cycle.late_share
    if share <= MAX_LATE_SHARE:
        return ''

    seen = (
        f'the control loop was late in {100.0 * share:.1f} % of {LATE_WINDOW} cycles, '
        f'above the limit {100.0 * MAX_LATE_SHARE:g} %'
    )
    if snapshot.realtime_priority:
        return f'{seen}; next: {Remedy.COMPUTER}'
    return (
        f'{seen}, without real-time scheduling; next: {PERMIT_PRIORITY}, or '
        f'{Remedy.COMPUTER}'
    )


def bus_status(snapshot: ControllerSnapshot, is_real: bool = True) -> DiagnosticStatus:
    """Return the component of bus and cycle; real drives need a loop with real-time priority."""
    cycle, bus = snapshot.cycle, snapshot.bus
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
    if snapshot.bus_error:
        lost = f'{snapshot.bus_error}{NEXT}{snapshot.next_step}'
        return diagnostic_status('bus', 'error', lost, values)
    if snapshot.state is ControllerState.LOST:
        lost = f'unknown: {snapshot.cause}; next: {snapshot.next_step}'
        return diagnostic_status('bus', 'error', lost, values)
    late = overload(snapshot)
    wants_priority = snapshot.realtime_priority == 0 and is_real and not late
    is_disturbed = bus.condition != 'active' or bus.overflows
    warnings = [
        late,
        NO_PRIORITY if wants_priority else '',
        (
            f'the CAN controller is {bus.condition}, with {bus.overflows} overflows'
            f'{NEXT}check wiring, termination and bit rate'
        )
        if is_disturbed
        else '',
    ]
    return diagnostic_status(
        'bus',
        'warn' if any(warnings) else 'ok',
        joined(_BUS_WORDS.get(snapshot.state, 'open'), *warnings),
        values,
    )


def axis_status(axis: AxisSnapshot) -> DiagnosticStatus:
    """Return the component of a drive, with its serial number as hardware id (REP 107)."""
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


def _axis_outcome(axis: AxisSnapshot) -> tuple[str, str]:
    if axis.is_silent:
        before = '' if axis.state is None else f'; before: {_words(axis.state)}'
        return 'stale', f'silent: these values are old{before}'
    if axis.state in FAULTS:
        return 'error', axis.error or 'in fault, the drive sent no error code'
    if (
        axis.state is None
    ):  # not received yet: diagnostic_aggregator would make an error stale
        return 'stale' if axis.missed else 'ok', 'no frame received yet'
    state = _words(axis.state) + ('' if axis.homed else ', not homed')
    return ('warn', f'{state}; {axis.warning}') if axis.warning else ('ok', state)


def _words(state: State) -> str:
    return state.name.lower().replace('_', ' ')


def _hex(value: int | None) -> str:
    return '-' if value is None else f'{value:04X}h'
