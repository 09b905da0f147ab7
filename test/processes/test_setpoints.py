"""Bad setpoints through ROS itself, judged by what comes out on the bus."""

from __future__ import annotations

from bad_setpoints import HOME, NEAR_BY, REACH
from diagnostic_msgs.msg import DiagnosticStatus
from stack import bring_up, come_down
from support import patiently, wait_until
from watcher import Watcher

from facade_manipulator.ros.client import ManipulatorClient

ENOUGH = 500
EXTRAPOLATED = 0.02  # m, where a busy machine interrupts the good ones for a moment
TOLD = ('rejected', 'cycles', 'missed', 'skipped')
REASONS = ('stale', 'future', 'not_finite', 'out_of_order', 'names', 'stroke')


def values_of(client: ManipulatorClient, name: str) -> dict[str, str]:
    """Return what /diagnostics last told of a component of the driver."""
    component = client.component(f'driver: {name}')
    return {item.key: item.value for item in component.status.values} if component else {}


def test_of_bad_setpoints_at_a_kilohertz_none_reaches_a_drive(
        active, driver, watcher, start_process):
    stranger = start_process('bad_setpoints')
    patiently(lambda: wait_for_much_of_both_kinds(active, watcher),
              lambda: (come_down(active), bring_up(active)), tries=2)
    print(stranger.log.read_text(), *(
        f'{key}: {value}' for name in ('operation', 'bus')
        for key, value in values_of(active, name).items() if key.startswith(TOLD)), sep='\n')
    commands = watcher.commands  # of a try that came to nothing, too
    print(commands.least, commands.greatest)
    assert commands.complaints == []
    for home, least, greatest in zip(HOME, commands.least, commands.greatest, strict=True):
        assert home - EXTRAPOLATED <= least
        assert greatest <= home + REACH + EXTRAPOLATED
    assert EXTRAPOLATED < -NEAR_BY
    assert active.driver_state() == 'active'
    assert driver.poll() is None
    assert 'Traceback' not in driver.log.read_text()


def wait_for_much_of_both_kinds(active: ManipulatorClient, watcher: Watcher) -> None:
    """Wait for rejections for every reason, and for carriages that follow the good setpoints."""
    def tell():
        active.spin(0.05)
        watcher.read()
        status = active.component('driver: operation')
        assert status is None or status.status.level != DiagnosticStatus.ERROR, status

    def all_rejected():
        told = values_of(active, 'operation')
        return int(told.get('rejected', 0)) >= ENOUGH and all(
            f'rejected: {reason}' in told for reason in REASONS)
    wait_until(all_rejected, 'rejections for every reason', 60.0, step=tell)
    wait_until(lambda: watcher.commands.greatest[0] - HOME[0] > 0.5 * REACH,
               'the carriages to follow the good ones', 60.0, step=tell)
