"""Components of the driver: levels, messages and values, and marks on old values."""

import math

import pytest

from facade_manipulator.canopen.link import BusStatistics
from facade_manipulator.drives.cycle import CycleStatistics
from facade_manipulator.drives.outcome import (
    ERRORS,
    MAX_LATE_SHARE,
    NodeProblems,
    outcome_of,
)
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.motion.follower import StreamStatus
from facade_manipulator.nodes.driver_diagnostics import (
    axis_status,
    bus_status,
    operation_status,
    StopCounter,
)
from facade_manipulator.nodes.planar_messages import status_level, status_values

SLOW = 'end other programs on this computer'
NO_PRIORITY = 'without real-time'


def late(share, priority):
    return {'cycle': CycleStatistics(late_share=share), 'realtime_priority': priority}


@pytest.mark.parametrize(
    'changes, is_real, warnings',
    [
        (late(MAX_LATE_SHARE, 50), True, []),
        (late(0.0, None), True, []),
        (late(0.0, 0), False, []),
        (
            late(MAX_LATE_SHARE + 0.002, 50),
            True,
            ['late in 0.7 % of 500 cycles, above the limit 0.5 %', SLOW],
        ),
        (
            late(0.0, 0),
            True,
            [NO_PRIORITY, 'controller.realtime_priority', 'LimitRTPRIO'],
        ),
        (late(0.9, 0), False, ['late in 90.0 %', SLOW, NO_PRIORITY, 'LimitRTPRIO']),
        ({'bus': BusStatistics(overflows=1)}, True, ['is active, with 1 overflows']),
        (
            {'bus': BusStatistics(condition='passive')},
            True,
            ['is passive, with 0 overflows'],
        ),
    ],
)
def test_bus_component_warns_of_computer_priority_and_controller(
    changes, is_real, warnings
):
    status = bus_status(
        ControllerSnapshot(ControllerState.ACTIVE, 1.0, (), **changes), is_real
    )
    assert status_level(status) == ('warn' if warnings else 'ok')
    assert all(warning in status.message for warning in ('open', *warnings))
    assert warnings or status.message == 'open'


BUS_MESSAGES = {
    ControllerState.UNCONFIGURED: ('ok', 'closed'),
    ControllerState.CLOSED: ('ok', 'closed'),
    ControllerState.CONFIGURING: ('ok', 'configuring'),
    ControllerState.SILENT: ('error', 'unknown: the loop has ended; next: configure'),
    ControllerState.LOST: ('error', 'unknown: the loop has ended; next: configure'),
    ControllerState.BUS_LOST: ('error', 'can0 is down; next: configure'),
}


@pytest.mark.parametrize('state', ControllerState)
def test_bus_component_has_the_state_of_the_bus(state):
    bus_error = 'can0 is down' if state is ControllerState.BUS_LOST else ''
    causes = (Cause('the loop has ended', ''),)
    snapshot = ControllerSnapshot(
        state, 1.0, (), causes, 'configure', bus_error=bus_error
    )
    status = bus_status(snapshot, is_real=True)
    found = (status_level(status), status.message)
    assert found == BUS_MESSAGES.get(state, ('ok', 'open'))


@pytest.mark.parametrize('state', ControllerState)
@pytest.mark.parametrize('is_requested', [False, True])
def test_each_stop_is_counted_and_logged_once(state, is_requested):
    counter = StopCounter()
    stop = ControllerSnapshot(
        state, 1.0, (), (Cause('cause', is_requested=is_requested),), 'activate'
    )
    active = ControllerSnapshot(ControllerState.ACTIVE, 1.0, ())
    lines = [counter.count(one) for one in (active, stop, stop, active, stop)]
    is_stop = state in ERRORS
    line = 'cause; next: activate' if is_stop else ''
    assert lines == ['', line, '', '', line]
    is_wanted = is_requested and state is ControllerState.STOPPED
    stops = 2 if is_stop else 0
    assert counter.values == {
        'drive faults': 0 if is_wanted else stops,
        'software stops': stops if is_wanted else 0,
    }


@pytest.mark.parametrize('later', [ControllerState.STOPPED, ControllerState.LOST])
def test_stop_after_silence_is_logged_but_counted_once(later):
    counter = StopCounter()
    causes = (Cause('first'),)
    silent = ControllerSnapshot(ControllerState.SILENT, 1.0, (), causes)
    assert counter.count(silent)
    assert counter.count(silent._replace(state=later))
    assert counter.values['drive faults'] == 1


def test_bus_lost_after_a_stop_is_logged():
    counter = StopCounter()
    stop = ControllerSnapshot(ControllerState.STOPPED, 1.0, (), (Cause('first'),))
    counter.count(stop)
    lost = stop._replace(state=ControllerState.BUS_LOST, bus_error='can0 is down')
    assert counter.count(lost).startswith('can0 is down')


def test_operation_and_bus_values_have_units_of_their_keys():
    axes = (AxisSnapshot('q1', 1, homed=True), AxisSnapshot('q2', 2))
    causes = (Cause('late', 'wait'), Cause('silent', ''))
    snapshot = ControllerSnapshot(
        ControllerState.STOPPED,
        1.0,
        axes,
        causes,
        'wait',
        ('a note', 'another'),
        CycleStatistics(7, 1, 2, 3, 0.012, 0.004),
        BusStatistics(50, 40, 3, 2, 1, 'passive'),
    )
    stream = StreamStatus('braking', 5, 6, 'too near')
    gone = bus_status(snapshot._replace(bus_error='can0 is down'), is_real=True)
    assert status_level(gone) == 'error'
    assert gone.message.startswith('can0 is down; next: ')
    outcome = outcome_of(snapshot, stream.activity)
    operation = operation_status(
        outcome, snapshot, stream, math.inf, {'version': '1'}, node_notes=()
    )
    bus = bus_status(snapshot, is_real=True)
    values = status_values(bus) | status_values(operation)
    expected = {
        'state': 'stopped',
        'activity': 'braking',
        'cause': 'late',
        'next step': 'wait',
        'active since': 'inf',
        'further causes': 'silent',
        'notes': 'a note; another',
        'not homed': 'q2',
        'brakes': '6',
        'last brake': 'too near',
        'missed cycles': '1',
        'worst lateness [ms]': '12',
        'late share [%]': '0.4',
        'condition': 'passive',
    }
    assert {key: values[key] for key in expected} == expected


SET = 'software_stop was set'
STOPPED = (Cause('q2 is late'),)


@pytest.mark.parametrize(
    'causes, problems, level, message',
    [
        ((), ('', '', ''), 'ok', 'inactive; next: activate'),
        (
            (),
            ('home failed; next: home', '', ''),
            'warn',
            'inactive; home failed; next: activate',
        ),
        ((), ('home failed', '', SET), 'warn', f'inactive: {SET}; next: activate'),
        (
            (),
            ('home failed', 'two drivers; next: end one', SET),
            'error',
            'inactive; two drivers; next: end one, then activate',
        ),
        (
            STOPPED,
            ('home failed', 'two drivers', SET),
            'error',
            'inactive: q2 is late; next: activate',
        ),
    ],
)
def test_driver_message_has_the_most_severe_problem(causes, problems, level, message):
    snapshot = ControllerSnapshot(
        ControllerState.INACTIVE, 1.0, (), causes, next_step='activate'
    )
    found = outcome_of(snapshot, problems=NodeProblems(*problems))
    assert found.level == level
    assert found.message == message


CLEANUP = 'cleanup rejected: the node is active; next: deactivate'


@pytest.mark.parametrize('state', ControllerState)
@pytest.mark.parametrize('failure', ['', 'home failed; next: home', CLEANUP])
@pytest.mark.parametrize('share', [0.0, 0.02])
def test_warning_leaves_the_next_step_of_each_state(state, failure, share):
    snapshot = ControllerSnapshot(state, 1.0, (), (), 'do this', **late(share, 50))
    found = outcome_of(snapshot, problems=NodeProblems(failure))
    text, _, steps = found.message.partition('; next: ')
    assert text.startswith(state.value)
    assert steps.startswith('do this')
    assert failure.partition(';')[0] in text
    assert 'next: ' not in steps
    assert (SLOW in steps) == ('late' in text) == bool(share)
    assert found.level != 'ok' or not (failure or share)


@pytest.mark.parametrize(
    'change, level, message',
    [
        ({}, 'ok', 'operation enabled'),
        ({'homed': False}, 'ok', 'operation enabled, not homed'),
        (
            {'warning': 'it reports a warning: warm'},
            'warn',
            'operation enabled; it reports a warning: warm',
        ),
        ({'statusword': 0x0008}, 'error', 'in fault; the drive sent no error code'),
        ({'statusword': 0x0008, 'error': 'following error (8611h)'}, 'error', '8611h'),
        # diagnostic_aggregator reports a stale component beside others as an error
        ({'statusword': None}, 'ok', 'no frame received yet'),
        ({'statusword': None, 'missed': 3}, 'stale', 'no frame received yet'),
        ({'statusword': 0x0001}, 'warn', 'statusword 0001h'),
        (
            {'is_silent': True},
            'stale',
            'silent: these values are old; before: operation enabled',
        ),
    ],
)
def test_drive_component_has_the_level_of_its_state(change, level, message):
    axis = AxisSnapshot('q2', 2, 0x0637, 0.25, -0.1, homed=True)._replace(**change)
    status = axis_status(axis)
    assert status_level(status) == level
    assert message in status.message
    values = status_values(status)
    assert values['position [m]'] == '0.25'
    assert values['velocity [m/s]'] == '-0.1'
    assert values['statusword'] == (
        '-' if axis.statusword is None else f'{axis.statusword:04X}h'
    )
    assert axis_status(axis).hardware_id == 'node 2'
    assert axis_status(axis._replace(serial_number=77)).hardware_id == '77'
