"""Bad setpoints through ROS itself, judged by what comes out on the bus."""

from __future__ import annotations

from pathlib import Path

from bad_setpoints import HOME, NEAR_BY, REACH
import can
from command_watch import CommandWatch
from listener import Frame, NODES
import pytest
from stack import PERIOD
from support import wait_until

from facade_manipulator.drives.pdo import rpdo_cob_id
from facade_manipulator.drives.settings import DEFAULT_AXES

HERE = Path(__file__).resolve().parent
SECONDS = 4.0
EXTRAPOLATED = 0.02  # m, where a busy machine interrupts the good ones for a moment
REASONS = ('stale', 'future', 'not_finite', 'out_of_order', 'names', 'stroke')


def judge(frames: list[Frame]) -> CommandWatch:
    """Judge every command that a listener has heard."""
    watch = CommandWatch(DEFAULT_AXES, PERIOD)
    commands = {rpdo_cob_id(1, node) for node in NODES}
    watch.take([
        can.Message(frame.time, frame.cob_id, is_extended_id=False, data=frame.data)
        for frame in frames if frame.cob_id in commands])
    return watch


def test_of_bad_setpoints_at_a_kilohertz_none_reaches_a_drive(
        active, driver, listener, start_process):
    stranger = start_process('bad_setpoints', str(SECONDS), env={'PYTHONPATH': str(HERE)})
    wait_until(lambda: stranger.poll() is not None, 'the last setpoint', 60.0,
               step=lambda: (active.spin(0.05), listener.read()))
    assert stranger.returncode == 0, stranger.log.read_text()
    watch = judge(listener.frames)
    operation, bus = (
        {item.key: item.value for item in active.component(f'driver: {name}').status.values}
        for name in ('operation', 'bus'))
    print(stranger.log.read_text(), {key: value for key, value in operation.items()
                                     if key.startswith('refused')},
          {key: bus[key] for key in ('cycles', 'missed cycles', 'skipped SYNCs')},
          watch.least, watch.greatest)
    assert watch.complaints == []
    for home, least, greatest in zip(HOME, watch.least, watch.greatest, strict=True):
        assert home - EXTRAPOLATED <= least
        assert greatest == pytest.approx(home + REACH, abs=EXTRAPOLATED)
    assert EXTRAPOLATED < -NEAR_BY
    for reason in REASONS:
        assert int(operation[f'refused: {reason}']) > 0, reason
    assert active.driver_state() == 'active'
    assert driver.poll() is None
    assert 'Traceback' not in driver.log.read_text()
