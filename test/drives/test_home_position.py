"""Home position: lost with every restart that a drive may have made, kept in our own pauses."""

from __future__ import annotations

from bus_world import at_rest, configured, Rig
import pytest

from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.simulation.drives.drive import SimulatedDrive

pytestmark = pytest.mark.long

BOOT_TIME = 0.3  # s, in which a restarting drive sends no frame
SHORT_PAUSE = 0.09  # s, which excuses silence and stops nothing


def stopped(rig: Rig) -> None:
    at_rest(rig)
    rig.controller.stop('the operator stops')
    rig.run(0.3)


def halted(rig: Rig) -> None:
    at_rest(rig)
    rig.request('halt')


SITUATIONS = {
    'configured': configured,
    'active': at_rest,
    'halted': halted,
    'stopped': stopped,
}
situations = pytest.mark.parametrize('situation', SITUATIONS)


# --- restarts of which no boot-up message arrives


def restart(rig: Rig, drive: SimulatedDrive) -> None:
    """Restart a drive, whose objects are stored, without a boot-up message."""
    drive.objects.sdo.download(0x1010, 1, b'save')
    drive.is_silent = True
    drive.reboot()
    rig.later(BOOT_TIME, lambda: setattr(drive, 'is_silent', False))


def restart_itself(rig: Rig, drive: SimulatedDrive) -> None:
    """Restart a drive that enters the NMT state operational by itself."""
    restart(rig, drive)
    state = drive.objects.nmt
    rig.later(BOOT_TIME - 0.05, lambda: setattr(state, 'state', 'OPERATIONAL'))


def restart_without_heartbeat(rig: Rig, drive: SimulatedDrive) -> None:
    """Restart a drive without stored objects: it sends neither answers nor heartbeats."""
    drive.is_silent = True
    drive.reboot()
    rig.later(BOOT_TIME, lambda: setattr(drive, 'is_silent', False))


@situations
@pytest.mark.parametrize(
    'restart_', [restart, restart_itself, restart_without_heartbeat]
)
@pytest.mark.parametrize('numbers', [(0,), (0, 1, 2)], ids=str)
def test_unnoticed_restart_loses_the_home_position(rig, situation, restart_, numbers):
    SITUATIONS[situation](rig)
    for number in numbers:
        restart_(rig, rig.drives[number])
    rig.run(BOOT_TIME + 0.7)
    assert set(rig.snapshot.unhomed) >= {AXIS_NAMES[number] for number in numbers}
    assert 'home, activate' in rig.snapshot.next_step
    rig.recover()
    places = [axis.position for axis in rig.snapshot.axes]
    assert places == pytest.approx(rig.carriages, abs=1e-3)


@situations
def test_uncommanded_pre_operational_loses_the_home_position(rig, situation):
    SITUATIONS[situation](rig)
    rig.deliver([(0x701, b'\x7f')])
    rig.run(0.1)
    assert rig.snapshot.unhomed == ('q1',)


# --- pauses and commands of our own


ENDLESS = 10_000  # frames


@situations
@pytest.mark.parametrize(
    ('seconds', 'room'),
    [  # a pause below 0.2 s does not fill a queue of 100 frames
        (0.1, ENDLESS),
        (0.14, ENDLESS),
        (0.2, ENDLESS),
        (0.2, 100),
        (2.0, ENDLESS),
        (2.0, 100),
    ],
)
@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_own_pause_keeps_the_home_position(
    make_rig, situation, seconds, has_kernel_sync, room
):
    rig = make_rig(has_kernel_sync=has_kernel_sync)
    SITUATIONS[situation](rig)
    limit_queue(rig, room)
    rig.stall(seconds)
    rig.run(0.5)
    assert not rig.snapshot.unhomed
    assert 'configure' not in rig.snapshot.next_step
    rig.recover()


def limit_queue(rig: Rig, room: int) -> None:
    """Drop frames to the master while its queue is full, as the socket does."""
    deliver = rig.deliver

    def deliver_while_there_is_room(frames):
        for frame in frames:
            if rig.bus is None or len(rig.bus.inbox) < room:
                deliver([frame])

    rig.deliver = deliver_while_there_is_room


def test_own_nmt_stop_keeps_the_home_position(rig):
    stopped(rig)
    rig.controller.bus.command('STOPPED', rig.controller.axes[:1])
    rig.run(1.0)
    assert rig.drives[0].objects.nmt.state == 'STOPPED'
    assert not rig.snapshot.unhomed
    rig.request('clear_faults', 'activate')


@situations
@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_drive_that_falls_silent_in_a_pause_is_named(
    make_rig, situation, has_kernel_sync
):
    rig = make_rig(has_kernel_sync=has_kernel_sync)
    SITUATIONS[situation](rig)
    deliver = rig.deliver
    tpdos = rig.controller.axes[0].profile.tpdos
    answers = {tpdo.cob_id(1) for tpdo in tpdos}
    rig.deliver = lambda frames: deliver(
        [one for one in frames if one[0] not in answers]
    )
    rig.stall(SHORT_PAUSE)
    rig.until(lambda: 'q1 (node 1) did not answer 3 cycles' in rig.all_causes, 0.1)
    assert rig.snapshot.unhomed == ('q1',)
