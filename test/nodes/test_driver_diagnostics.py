"""What the driver says of its drives: what is old is shown as old."""

from diagnostic_msgs.msg import DiagnosticStatus
from frames import encode_tpdo1
import pytest

from facade_manipulator.drives.canopen import Frame, pdo
from facade_manipulator.drives.cia402.settings import AxisSettings
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.nodes.driver_diagnostics import axis_status

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
    assert axis_status(made.snapshot(None, 1e3)).message == 'nothing received yet'
