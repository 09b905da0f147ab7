"""
Outcome of the driver in words: state, activity, cause, next step, power and level.

Driver/status, /diagnostics, the log and the replies to requests use these words.
"""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.drives.cycle import LATE_WINDOW
from facade_manipulator.drives.realtime import PERMIT_PRIORITY
from facade_manipulator.drives.snapshot import (
    ControllerSnapshot,
    ControllerState,
    Remedy,
)
from facade_manipulator.errors import joined, NEXT

ERRORS = (
    ControllerState.STOPPED,
    ControllerState.BUS_LOST,
    ControllerState.SILENT,
    ControllerState.LOST,
)


class NodeProblems(NamedTuple):
    """Problems that only the node detects; ``''`` means no problem."""

    last_failure: str = ''  #: message of the last request if it failed
    fault: str = ''  #: second publisher of a topic, with its next step
    forbidden: str = ''  #: why no drive may have power


class DriverOutcome(NamedTuple):
    """State of the driver for the operator, published at each change."""

    state: str
    activity: str  #: of the carriages while the state is active, such as ``'holding'``
    #: first cause of a stop, reason that forbids power, or the halt; ``''`` for none
    cause: str
    next_step: str  #: of the operator, ``''`` while setpoints are followed
    power: str  #: confirmed off, unknown or on
    level: str  #: ok, warn or error
    message: str  #: state, most severe problem and next step

    def with_next_step(self, text: str, *more: str) -> str:
        """Join a text and further texts that contain next steps with this next step."""
        step = f'{NEXT}{self.next_step}' if self.next_step else ''
        return joined(text, *more, step)


WARNINGS = (ControllerState.HALTED, ControllerState.HALTING)
HALT = 'driver/halt was called'  # no other event halts the drives
NO_PROBLEMS = NodeProblems()


def outcome_of(
    snapshot: ControllerSnapshot,
    activity: str = '',
    problems: NodeProblems = NO_PROBLEMS,
) -> DriverOutcome:
    """
    Return the driver's outcome for a snapshot.

    The problem in the message is the cause of a stop, a fault of the graph, the reason that
    forbids power, or the last failed request and an overload. The state determines the next step.
    The remedy of a fault or of a failed request stands before the next step, because its problem
    blocks this step. The remedy of an overload stands after the next step.
    """
    state = snapshot.state
    slow = overload(snapshot)
    level = 'ok'
    if problems.last_failure or slow or problems.forbidden or state in WARNINGS:
        level = 'warn'
    if problems.fault or state in ERRORS:
        level = 'error'

    following = f'{NEXT}{snapshot.next_step}' if snapshot.next_step else ''
    reason = snapshot.cause
    if not reason and not problems.fault:
        reason = problems.forbidden
    if reason:
        message = f'{state.value}: {reason}{following}'
    elif problems.fault:
        message = joined(state.value, problems.fault, following)
    else:
        failure, _, step = problems.last_failure.partition(NEXT)
        # otherwise the state has changed since the request failed
        if following and step.endswith(snapshot.next_step):
            following = f'{NEXT}{step}'
        message = joined(f'{state.value}{following}', failure, slow)
    cause = snapshot.cause or problems.forbidden
    if not cause and state in WARNINGS:
        cause = HALT
    return DriverOutcome(
        state.value,
        activity,
        cause,
        snapshot.next_step,
        snapshot.power,
        level,
        message,
    )


# Share of late cycles in LATE_WINDOW. At 100 Hz without priority, on two processors, the share is
# at most 0.2 % beside idle programs. Beside busy programs, it is at least 0.8 % in each window
# with three late cycles in a row.
MAX_LATE_SHARE = 0.005


def overload(snapshot: ControllerSnapshot) -> str:
    """Return a warning if the computer is too slow for the cycle, or ``''``."""
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
