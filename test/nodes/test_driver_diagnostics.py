"""What the driver says of its drives: what is old is shown as old."""

from diagnostic_msgs.msg import DiagnosticStatus
from frames import encode_tpdo1
import pytest

from facade_manipulator.drives.canopen import Frame, pdo
from facade_manipulator.drives.cia402.settings import AxisSettings
from facade_manipulator.drives.controller import (
    ControllerSnapshot,
    ControllerState,
    CycleStatistics,
)
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.nodes.driver_diagnostics import (
    axis_status,
    bus_status,
    MAX_LATE_SHARE,
)

OPERATIONAL = b'\x05'
SETTINGS = ControllerSettings()


@pytest.fixture
def monitor():
    """Return what was received at 10 s from a drive in operation."""
    made = AxisMonitor('q2', AxisSettings(node_id=2), SETTINGS)
    made.receive_heartbeat(Frame(pdo.heartbeat_cob_id(1), OPERATIONAL, 10.0, 10.0))
    made.receive_tpdo(pdo.TPDO1, encode_tpdo1(0x0637, 8, 0), 10.0, 10.0)
    return made


def test_a_drive_that_answers_is_shown_with_its_state(monitor):
    status = axis_status(monitor.snapshot(None, 10.05))
    assert (status.level, status.message) == (
        DiagnosticStatus.OK, 'operation enabled, not homed')


@pytest.mark.parametrize('silence', ['heartbeats', 'answers'])
def test_a_drive_that_no_longer_answers_is_stale_whatever_it_said_last(monitor, silence):
    now = 10.05
    if silence == 'heartbeats':
        now = 10.0 + SETTINGS.heartbeat_timeout + 0.01
    else:
        for _ in range(SETTINGS.max_missed_cycles + 1):
            monitor.end_cycle(10.0)
    status = axis_status(monitor.snapshot(None, now))
    assert status.level == DiagnosticStatus.STALE
    assert status.message == 'silent: what stands here is old; before: operation enabled'


def test_a_drive_that_never_sent_anything_is_not_called_silent():
    made = AxisMonitor('q2', AxisSettings(node_id=2), SETTINGS)
    parked = axis_status(made.snapshot(None, 1e3))
    # diagnostic_aggregator makes an error of what is stale beside what is not
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
def test_the_bus_warns_of_a_slow_computer_and_a_missing_priority(
        late, priority, is_real, warnings):
    snapshot = ControllerSnapshot(
        ControllerState.ACTIVE, 1.0, (), cycle=CycleStatistics(late_share=late),
        realtime_priority=priority)
    status = bus_status(snapshot, is_real)
    assert status.level == (DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK)
    assert status.message.startswith('open')
    assert all(warning in status.message for warning in warnings)
    assert warnings or status.message == 'open'
