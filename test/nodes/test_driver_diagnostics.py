"""Components of the driver: levels, messages and values; old values are marked."""

import math
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus
from frames import encode_tpdo1
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import BusStatistics, Condition, Frame
from facade_manipulator.control_loop.control_loop import StreamStatus
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.commissioning import Finding
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.cycle import CycleStatistics
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.snapshot import AxisSnapshot, ControllerSnapshot
from facade_manipulator.messages import status_level, status_values
from facade_manipulator.nodes import driver_diagnostics
from facade_manipulator.nodes.driver_diagnostics import (
    axis_status,
    bus_status,
    finding_status,
    MAX_LATE_SHARE,
    operation_status,
    self_test_outcome,
    StatusPublisher,
)
from facade_manipulator.nodes.driver_status import DriverStatus, STATUS_PERIOD

OPERATIONAL = b'\x05'
SETTINGS = ControllerSettings()


@pytest.fixture
def monitor():
    """Return the monitor of a drive in operation, with messages of 10 s."""
    made = AxisMonitor('q2', AxisSettings(node_id=2), SETTINGS)
    made.receive_heartbeat(Frame(pdo.heartbeat_cob_id(1), OPERATIONAL, 10.0, 10.0))
    made.receive_tpdo(pdo.TPDO1, encode_tpdo1(0x0637, 8, 0), 10.0, 10.0)
    return made


@pytest.mark.parametrize('silence', ['', 'heartbeats', 'answers'])
def test_silent_drive_is_stale(monitor, silence):
    now = 10.05
    if silence == 'heartbeats':
        now = 10.0 + SETTINGS.heartbeat_timeout + 0.01
    elif silence == 'answers':
        for _ in range(SETTINGS.max_missed_cycles + 1):
            monitor.end_cycle(10.0)
    status = axis_status(monitor.snapshot(None, now))
    assert (status_level(status), status.message) == (
        ('stale', 'silent: these values are old; before: operation enabled') if silence else
        ('ok', 'operation enabled, not homed'))


def test_drive_that_was_never_asked_is_ok():
    made = AxisMonitor('q2', AxisSettings(node_id=2), SETTINGS)
    parked = axis_status(made.snapshot(None, 1e3))
    # diagnostic_aggregator reports a stale component beside others as an error
    assert (parked.level, parked.message) == (DiagnosticStatus.OK, 'nothing received yet')
    made.begin_supervision(0.0)
    for _ in range(SETTINGS.max_missed_cycles):
        made.end_cycle(10.0)
    dead = axis_status(made.snapshot(None, 1e3))
    assert (dead.level, dead.message) == (DiagnosticStatus.STALE, 'nothing received yet')


@pytest.mark.parametrize('late, priority, is_real, warnings', [
    (0.0, 50, True, []), (MAX_LATE_SHARE, 50, True, []), (0.0, None, True, []),
    (0.0, 0, False, []),
    (MAX_LATE_SHARE + 0.002, 50, True, ['late in 0.7 % of 500 cycles, bound 0.5 %: take load']),
    (0.0, 0, True, ['without real-time', 'controller.realtime_priority', 'LimitRTPRIO']),
    (0.9, 0, False, ['late in 90.0 %', 'take load off this computer', 'without real-time']),
])
def test_bus_warns_of_slow_computer_and_missing_priority(
        late, priority, is_real, warnings):
    snapshot = ControllerSnapshot(
        ControllerState.ACTIVE, 1.0, (), cycle=CycleStatistics(late_share=late),
        realtime_priority=priority)
    status = bus_status(snapshot, is_real)
    assert status.level == (DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK)
    assert status.message.startswith('open')
    assert all(warning in status.message for warning in warnings)
    assert warnings or status.message == 'open'


def test_operation_and_bus_values_have_the_units_of_their_keys():
    snapshot = ControllerSnapshot(
        ControllerState.STOPPED, 1.0, (AxisSnapshot('q1', 1, homed=True), AxisSnapshot('q2', 2)),
        (Cause('late', 'wait'), Cause('silent', '')), 'wait', ('a note', 'another'),
        CycleStatistics(7, 1, 2, 3, 4, tuple(range(8)), 0.012, 0.004),
        BusStatistics(50, 40, 3, 2, 1, Condition.PASSIVE), bus_load=0.31)
    stream = StreamStatus('braking', 5, 6, 'too near', (0.011, 0.025))
    status = operation_status(snapshot, stream, '', {'version': '1'})
    values = status_values(status)
    assert (status_level(status), status.message) == ('error', 'stopped: late; next: wait')
    assert [values[key] for key in (
        'state', 'activity', 'cause', 'further causes', 'notes', 'not homed', 'limited cycles',
        'brakes', 'last brake', 'setpoint margin p1 [ms]',
        'setpoint margin p50 [ms]', 'version')] == [
            'stopped', 'braking', 'late', 'silent', 'a note; another', 'q2', '5', '6', 'too near',
            '11', '25', '1']
    values = status_values(bus_status(snapshot))
    assert [values[key] for key in (
        'cycles', 'missed cycles', 'late commands', 'skipped SYNCs', 'worst lateness [ms]',
        'late share [%]', 'worst-case load [%]', 'received', 'overflows', 'condition',
        'lateness below 1 ms', 'lateness below 100 ms', 'lateness beyond')] == [
            '7', '1', '2', '3', '12', '0.4', '31', '50', '1', 'passive', '0', '6', '7']
    gone = bus_status(snapshot._replace(bus_error='can0 is down'))
    assert (status_level(gone), gone.message) == ('error', 'can0 is down')


@pytest.mark.parametrize('change, level, message', [
    ({}, 'ok', 'operation enabled'), ({'homed': False}, 'ok', 'operation enabled, not homed'),
    ({'warning': 'it warns: warm'}, 'warn', 'operation enabled; it warns: warm'),
    ({'statusword': 0x0008}, 'error', 'in fault, the drive sent no error code'),
    ({'statusword': 0x0008, 'error': 'following error (8611h)'}, 'error', '8611h'),
    ({'statusword': None}, 'ok', 'nothing received yet'),
    ({'statusword': None, 'missed': 3}, 'stale', 'nothing received yet'),
    ({'is_silent': True}, 'stale', 'silent: these values are old; before: operation enabled')])
def test_drive_has_the_level_of_its_state(change, level, message):
    axis = AxisSnapshot('q2', 2, 0x0637, 0.25, -0.1, homed=True)._replace(**change)
    status = axis_status(axis)
    assert status_level(status) == level and message in status.message
    values = status_values(status)
    assert (values['position [m]'], values['velocity [m/s]']) == ('0.25', '-0.1')
    assert values['statusword'] == ('-' if axis.statusword is None else f'{axis.statusword:04X}h')
    assert status.hardware_id == 'node 2'
    assert axis_status(axis._replace(serial_number=77)).hardware_id == '77'


@pytest.mark.parametrize('state, failure, step, level, message', [
    (ControllerState.ACTIVE, '', '', 'ok', 'active'),
    (ControllerState.INACTIVE, '', 'activate', 'ok', 'inactive; next: activate'),
    (ControllerState.ACTIVE, 'home is not possible', '', 'warn', 'active; home is not possible'),
    (ControllerState.HALTED, '', 'clear_faults', 'warn', 'halted; next: clear_faults'),
    (ControllerState.LOST, '', '', 'error', 'control loop lost')])
def test_group_has_level_and_next_step_of_its_state(
        state, failure, step, level, message):
    status = operation_status(
        ControllerSnapshot(state, None, (), next_step=step), StreamStatus(), failure, {})
    assert (status_level(status), status.message) == (level, message)


@pytest.mark.parametrize('passed, level', [(True, 'ok'), (False, 'error')])
def test_finding_has_level_name_and_message(passed, level):
    status = finding_status(Finding('q1', passed, 'it answers'))
    assert (status_level(status), status.name, status.message) == (level, 'q1', 'it answers')


def test_self_test_message_names_the_failed_parts():
    good, bad, worse = (Finding('q1', True, 'answers'), Finding('q2', False, 'silent'),
                        Finding('bus', False, 'passive'))
    assert self_test_outcome([good, good]) == (True, 'self-test passed')
    assert self_test_outcome([bad, good, worse]) == (False, 'q2: silent; bus: passive')


def test_status_is_published_on_change_and_periodically(monkeypatch):
    now, told = SimpleNamespace(monotonic=0.0), []
    monkeypatch.setattr(
        driver_diagnostics, 'time', SimpleNamespace(monotonic=lambda: now.monotonic))
    publisher = StatusPublisher(told.append)

    def publish(state, activity='holding', failure=''):
        before = len(told)
        publisher.publish(
            1000.0 + now.monotonic, ControllerSnapshot(state, 1.0, (), next_step='next'),
            activity, failure)
        return [DriverStatus.from_message(one) for one in told[before:]]

    first, = publish(ControllerState.INACTIVE)
    assert first[:4] == ('inactive', 'holding', 'next', math.inf)
    now.monotonic = 5.0
    active, = publish(ControllerState.ACTIVE)
    assert active.active_since == 1005.0
    now.monotonic += 0.9 * STATUS_PERIOD
    assert publish(ControllerState.ACTIVE) == []
    now.monotonic += 0.2 * STATUS_PERIOD
    assert publish(ControllerState.ACTIVE) == [active] and not publish(ControllerState.ACTIVE)
    changed, = publish(ControllerState.ACTIVE, 'following')
    assert changed == active._replace(activity='following')
    assert publish(ControllerState.ACTIVE, 'following', 'rejected') == [changed]
    assert status_level(told[-1]) == 'warn' and 'rejected' in told[-1].message
    assert publish(ControllerState.HALTED)[0].active_since == math.inf
    now.monotonic = 9.0
    assert publish(ControllerState.ACTIVE)[0].active_since == 1009.0
