"""Bad setpoints through ROS itself, judged by what comes out on the bus."""

from __future__ import annotations

from pathlib import Path

from bad_setpoints import HOME, NEAR_BY, REACH
import can
from command_watch import CommandWatch
from diagnostic_msgs.msg import DiagnosticStatus
from listener import Frame, Listener, NODES
from stack import bring_up, come_down, PERIOD
from support import patiently, wait_until

from facade_manipulator.drives.canopen.pdo import rpdo_cob_id
from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.ros.client import ManipulatorClient

HERE = Path(__file__).resolve().parent
ENOUGH = 500
EXTRAPOLATED = 0.02  # m, where a busy machine interrupts the good ones for a moment
TOLD = ('rejected', 'cycles', 'missed', 'skipped')
REASONS = ('stale', 'future', 'not_finite', 'out_of_order', 'names', 'stroke')


def judge(frames: list[Frame]) -> CommandWatch:
    """Judge every command that a listener has heard."""
    watch = CommandWatch(DEFAULT_AXES, PERIOD)
    commands = {rpdo_cob_id(1, node) for node in NODES}
    watch.take([
        can.Message(frame.time, frame.cob_id, is_extended_id=False, data=frame.data)
        for frame in frames if frame.cob_id in commands])
    return watch


def values_of(client: ManipulatorClient, name: str) -> dict[str, str]:
    """Return what /diagnostics last told of a component of the driver."""
    component = client.component(f'driver: {name}')
    return {item.key: item.value for item in component.status.values} if component else {}


def test_of_bad_setpoints_at_a_kilohertz_none_reaches_a_drive(
        active, driver, listener, start_process):
    stranger = start_process('bad_setpoints', env={'PYTHONPATH': str(HERE)})
    watches = []

    def hear():
        listener.read().clear()
        try:
            wait_for_much_of_both_kinds(active, listener)
        finally:
            watches.append(judge(listener.read()))

    patiently(hear, lambda: (come_down(active), bring_up(active)), tries=2)
    print(stranger.log.read_text(), *(
        f'{key}: {value}' for name in ('operation', 'bus')
        for key, value in values_of(active, name).items() if key.startswith(TOLD)), sep='\n')
    for watch in watches:  # a try that came to nothing is no excuse
        print(watch.least, watch.greatest)
        assert watch.complaints == []
        for home, least, greatest in zip(HOME, watch.least, watch.greatest, strict=True):
            assert home - EXTRAPOLATED <= least
            assert greatest <= home + REACH + EXTRAPOLATED
    assert EXTRAPOLATED < -NEAR_BY
    assert active.driver_state() == 'active'
    assert driver.poll() is None
    assert 'Traceback' not in driver.log.read_text()


def wait_for_much_of_both_kinds(active: ManipulatorClient, listener: Listener) -> None:
    """Wait for rejections for every reason, and for carriages that follow the good setpoints."""
    def tell():
        active.spin(0.05)
        listener.read()
        status = active.component('driver: operation')
        assert status is None or status.status.level != DiagnosticStatus.ERROR, status

    def all_rejected():
        told = values_of(active, 'operation')
        return int(told.get('rejected', 0)) >= ENOUGH and all(
            f'rejected: {reason}' in told for reason in REASONS)
    wait_until(all_rejected, 'rejections for every reason', 60.0, step=tell)
    wait_until(lambda: max(judge(listener.frames).greatest[0] - HOME[0], 0.0) > 0.5 * REACH,
               'the carriages to follow the good ones', 60.0, step=tell)
