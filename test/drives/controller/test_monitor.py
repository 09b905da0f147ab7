"""What is believed of one drive's answers; no bus, no clock."""

from __future__ import annotations

import pytest

from facade_manipulator.drives.canopen import Frame
from facade_manipulator.drives.canopen.pdo import TPDO1, TPDO2
from facade_manipulator.drives.cia402.settings import AxisSettings
from facade_manipulator.drives.cia402.states import Mode
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.settings import ControllerSettings

AXIS, SETTINGS = AxisSettings(), ControllerSettings()
T, OPERATION_ENABLED = SETTINGS.period, 0x0027
SPEED = 0.4  # m/s


@pytest.fixture
def monitor():
    made = AxisMonitor('q1', AXIS, SETTINGS)
    made.begin_supervision(0.0)
    made.end_homing(True)
    return made


def answer(monitor, time, position, velocity=SPEED):
    """Let the drive answer a SYNC; return why all must stop."""
    counts, speed = AXIS.to_counts(position), AXIS.to_counts(velocity)
    cause = monitor.receive_tpdo(TPDO1, TPDO1.codec.pack(
        OPERATION_ENABLED, Mode.CYCLIC_SYNCHRONOUS_POSITION, counts),
        time, time)
    return cause or monitor.receive_tpdo(
        TPDO2, TPDO2.codec.pack(speed, 0), time, time)


def test_an_answer_is_complete_with_all_that_comes_with_each_sync(monitor):
    """Else the following error of one cycle is compared with another drive's of the next."""
    answer(monitor, T, 0.0)
    monitor.end_cycle()
    status = bytes(TPDO1.codec.size)
    monitor.receive_tpdo(TPDO1, status, 2 * T, 2 * T)
    assert monitor.answered == T
    monitor.receive_tpdo(TPDO2, bytes(TPDO2.codec.size), 2 * T, 2 * T)
    assert monitor.answered == 2 * T


@pytest.mark.parametrize('rate', [250, 500])
def test_a_fast_cycle_waits_for_nothing_that_comes_more_seldom(rate):
    settings = ControllerSettings(rate=rate)
    monitor = AxisMonitor('q1', AXIS, settings)
    status = bytes(TPDO1.codec.size)
    monitor.receive_tpdo(TPDO1, status, settings.period, settings.period)
    assert monitor.answered == settings.period


@pytest.mark.parametrize('moved', [SPEED * SETTINGS.heartbeat_timeout, 0.2])
def test_how_far_a_carriage_may_be_after_a_lost_bus_is_told_by_its_drives_speed(monitor, moved):
    """Two answers close together say nothing of it."""
    for time, position in ((T, 0.0), (2 * T, 0.002), (3 * T, 0.006), (3.01 * T, 0.006)):
        assert answer(monitor, time, position) is None
    monitor.end_cycle()
    monitor.lose()
    monitor.receive_heartbeat(Frame(0x701, b'\x05', 1.0, 1.0))
    monitor.recover(boots_operational=False)
    cause = answer(monitor, 2.0, 0.006 + moved, 0.0)
    assert monitor.homed is (cause is None) is (moved < 0.1)


def test_a_carriage_that_has_slowed_down_while_the_loop_was_late_is_no_jump(monitor):
    """The speed between two late answers is a mean one, which is not the present one."""
    time = position = 0.0
    for pause, mean in ((T, 0.0), (T, 0.2), (T, 0.4), (11 * T, 0.15), (T, -0.2)):
        time, position = time + pause, position + mean * pause
        assert answer(monitor, time, position) is None
    assert monitor.homed
    assert 'has jumped' in answer(monitor, time + T, position + 0.01).message
