"""Outcome of the driver: it changes with its six values, and not with a counter."""

import pytest

from facade_manipulator.canopen.link import BusStatistics
from facade_manipulator.drives.cycle import CycleStatistics
from facade_manipulator.drives.outcome import NodeProblems, outcome_of
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
)

ACTIVE = ControllerSnapshot(
    ControllerState.ACTIVE, 1.0, (AxisSnapshot('q1', 1, statusword=0x0027),)
)


@pytest.mark.parametrize(
    'changes',
    [
        {'stamp': 2.0},
        {'cycle': CycleStatistics(7, 1, 2, 3, 0.012, 0.004)},
        {'bus': BusStatistics(50, 40, 3, 2, 1)},
        {'axes': (ACTIVE.axes[0]._replace(position=0.1, missed=3),)},
    ],
)
def test_counters_and_measurements_do_not_change_the_outcome(changes):
    assert outcome_of(ACTIVE._replace(**changes)) == outcome_of(ACTIVE)


@pytest.mark.parametrize(
    'value, changes',
    [
        ('state', {'state': ControllerState.HALTING}),
        ('cause', {'causes': (Cause('q1 is late'),)}),
        ('next_step', {'next_step': 'clear_faults'}),
        ('power', {'axes': (ACTIVE.axes[0]._replace(statusword=0x0040),)}),
        ('level', {'state': ControllerState.STOPPED}),
    ],
)
def test_change_of_each_value_changes_the_outcome(value, changes):
    found = outcome_of(ACTIVE._replace(**changes))
    assert getattr(found, value) != getattr(outcome_of(ACTIVE), value)


@pytest.mark.parametrize(
    'state, forbidden, cause',
    [
        ('halted', '', 'driver/halt was called'),
        ('halting', '', 'driver/halt was called'),
        ('unconfigured', 'software_stop was set', 'software_stop was set'),
        ('unconfigured', '', ''),
        ('active', '', ''),
    ],
)
def test_halt_and_forbidden_power_have_a_cause(state, forbidden, cause):
    snapshot = ACTIVE._replace(state=ControllerState(state))
    found = outcome_of(snapshot, problems=NodeProblems(forbidden=forbidden))
    assert found.cause == cause
    stopped = snapshot._replace(causes=(Cause('q1 is late'),))
    assert outcome_of(stopped).cause == 'q1 is late'


def test_state_next_step_follows_that_of_the_reply():
    halted = ACTIVE._replace(state=ControllerState.HALTED, next_step='clear_faults')
    reply = outcome_of(halted).with_next_step('home failed; next: wait', 'power: on')
    assert reply == 'home failed; power: on; next: wait, then clear_faults'
    assert outcome_of(ACTIVE).with_next_step('done') == 'done'


def test_remedy_of_a_failed_request_precedes_the_requests():
    requests = 'configure, home, activate'
    snapshot = ACTIVE._replace(state=ControllerState.UNCONFIGURED, next_step=requests)

    def message(failure: str) -> str:
        return outcome_of(snapshot, problems=NodeProblems(failure)).message

    problem = 'configure failed: another master uses this bus'
    remedy = f'end that master, then {requests}'
    expected = f'unconfigured; {problem}; next: {remedy}'
    assert message(f'{problem}; next: {remedy}') == expected
    # the state has changed since the failure
    expected = f'unconfigured; {problem}; next: {requests}'
    assert message(f'{problem}; next: clear_faults') == expected
