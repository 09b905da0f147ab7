"""Drive controller on a lost bus, on a bus with another master, or with spoiled frames."""

from __future__ import annotations

import random

from bus_world import (
    at_rest,
    configured,
    in_motion,
    SETTINGS,
    SITUATIONS,
    SWITCH_HOMING,
)
from canopen import SdoAbortedError
from drive_faults import deaf_to_rpdo
from fake_bus import FakeBus
import pytest

from facade_manipulator.canopen import cob_ids, pdo
from facade_manipulator.canopen.bus import BusCongestedError
from facade_manipulator.drives.snapshot import ControllerState, Remedy
from facade_manipulator.drives.states import State
from facade_manipulator.errors import BusError
from facade_manipulator.kinematics.geometry import AXIS_NAMES

pytestmark = pytest.mark.long


def lose(rig):
    rig.bus_error = BusError('can0 is down')
    rig.until(lambda: rig.state is ControllerState.BUS_LOST)


@pytest.mark.parametrize(
    ('request_', 'state'),
    [('cleanup', ControllerState.UNCONFIGURED), ('close', ControllerState.CLOSED)],
)
def test_lost_bus_can_be_cleaned_up_and_closed(rig, request_, state):
    at_rest(rig)
    lose(rig)
    rig.until(lambda: rig.snapshot.axes[0].heartbeat_age > 1.0)
    assert 'the control loop failed' not in rig.all_causes
    assert 'q3 (node 3) is not confirmed off: the bus is lost' in rig.rejection(
        request_
    )
    assert rig.state is state
    rig.bus_error = None
    if request_ == 'cleanup':  # drives that miss our heartbeat have no other master
        rig.request('configure')


def push(drives):
    for drive in drives:
        drive.motor.place(drive.motor.carriage_position + 0.068)


@pytest.mark.parametrize('meanwhile', [list, lambda drives: drives[1].reboot(), push])
def test_drives_behind_lost_bus_are_configured_and_homed_again(rig, meanwhile):
    in_motion(rig)
    lose(rig)
    meanwhile(rig.drives)
    rig.bus_error = None
    rig.run(2.0)
    assert rig.state is ControllerState.BUS_LOST
    assert rig.bus is None
    assert rig.snapshot.unhomed == AXIS_NAMES
    for request in ('configure', 'home', 'activate', 'clear_faults'):
        assert (
            'next: check the CAN bus, wait until it is back, then cleanup, configure, home, '
            'activate' in rig.rejection(request)
        )
    assert 'configure, home, activate' in rig.rejection('cleanup')
    rig.request('configure')
    assert 'must be homed' in rig.rejection('activate')
    rig.request('home', 'activate')


@pytest.mark.parametrize(
    ('is_virtual', 'remedy'), [(False, Remedy.BUS), (True, Remedy.COMPUTER)]
)
def test_silence_of_all_drives_is_attributed_to_the_bus(rig, is_virtual, remedy):
    configured(rig)
    rig.bus.is_virtual = is_virtual
    for drive in rig.drives:
        drive.is_silent = True
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    (cause,) = rig.snapshot.causes
    assert cause.message.startswith(
        'no drive answers any longer: q1 (node 1) did not answer'
    )
    assert cause.remedy == remedy


@pytest.mark.parametrize(
    ('seconds', 'state'),
    [(0.1, ControllerState.STOPPED), (0.3, ControllerState.BUS_LOST)],
)
def test_full_send_queue_is_lost_bus_after_200_ms(rig, seconds, state):
    def reject(*_):
        raise BusCongestedError('can0: the send queue is full')

    at_rest(rig)
    bus = rig.bus
    bus.send = reject
    rig.run(seconds)
    del bus.send
    rig.run(1.0)
    assert rig.state is state


def spoil_frames(rig, kind, share):
    """Drop, double or delay a share of the frames to and from each drive."""
    chance = random.Random(1).random
    deliver = rig.deliver

    def spoilt(carry, answer=lambda frames: None):
        if chance() >= share:
            return carry()
        if kind == 'delayed':
            rig.later(0.005 * chance(), lambda: answer(carry()))
        return [*carry(), *carry()] if kind == 'doubled' else []

    def connect(drive):
        receive = drive.receive
        drive.receive = lambda *frame: spoilt(lambda: receive(*frame), rig.deliver)

    for drive in rig.drives:
        connect(drive)

    def deliver_spoilt(frames):
        for frame in frames:
            spoilt(lambda frame=frame: deliver([frame]) or [])

    rig.deliver = deliver_spoilt


@pytest.mark.parametrize(
    ('kind', 'share'), [('dropped', 0.05), ('doubled', 0.2), ('delayed', 0.2)]
)
def test_dropped_doubled_or_late_frames_keep_limits(rig, kind, share):
    in_motion(rig)
    rig.checks.is_late = True  # a SYNC waits for answers that do not come
    spoil_frames(rig, kind, share)
    before = rig.checks.commands
    rig.cycles(30)
    assert rig.checks.commands > before


# --- another master

FRAMES = {
    'its heartbeat (77Fh)': (0x77F, b'\x05'),
    'SYNC (080h)': (0x080, b''),
    'process data for node 3': (pdo.RPDO1.cob_id(3), bytes(7)),
    'an SDO request to node 1': (0x601, b'\x40\x00\x10' + bytes(5)),
    'an SDO request to node 2': (0x602, b''),  # without a command
    'an NMT command': (0x000, b'\x01\x00'),
    'an LSS request (7E5h)': (0x7E5, b'\x04\x01' + bytes(6)),
    'process data for node 2': (0x402, bytes(2)),
    'node guarding of node 3 (RTR to 703h)': (cob_ids.REMOTE_FRAME | 0x703, b''),
    'a remote request to node 1': (cob_ids.REMOTE_FRAME | 0x281, b''),
}


def is_upload(cob_id: int, data: bytes) -> bool:
    """Return whether a frame asks one of our drives for an object."""
    return cob_id - cob_ids.SDO_REQUEST in (1, 2, 3) and data[0] == 0x40


@pytest.mark.parametrize('name', FRAMES)
def test_configure_sends_nothing_beside_another_master(rig, name):
    rig.frames()
    job = rig.ask('configure')
    for _ in range(1000):
        rig.forge(*FRAMES[name])
        rig.run(0.001)
        if job.done():
            break
    with pytest.raises(BusError, match='another master uses this bus') as caught:
        job.result()
    assert name in str(caught.value)
    sent = set()
    for frame in rig.frames():
        if frame.cob_id < 0x581:
            sent.add((frame.cob_id, frame.data))
    if name == 'SYNC (080h)':  # a drive may send it: configure reads 1005h
        sent = {one for one in sent if not is_upload(*one)}
    assert sent <= {FRAMES[name]}
    assert rig.state is ControllerState.UNCONFIGURED
    rig.request('configure')


def test_drives_that_a_master_seldom_guards_are_left_unchanged(rig):
    """A guard time of 100Ch shows how long the other master may be silent."""
    for drive in rig.drives:
        drive.objects.stored[0x100C, 0] = 800
        drive.reboot()
    rig.run(0.1)
    rig.later(0.7, lambda: rig.forge(cob_ids.REMOTE_FRAME | 0x702))
    rig.frames()
    message = rig.rejection('configure')
    assert 'another master uses this bus: node guarding of node 2' in message
    assert not any(one.cob_id == cob_ids.NMT for one in rig.frames())


def test_configure_sends_nothing_within_two_heartbeats(rig):
    rig.frames()
    rig.ask('configure')
    rig.run(2.0 * SETTINGS.heartbeat_period - 0.005)
    assert not rig.frames()
    rig.run(0.1)
    assert rig.frames()


@pytest.mark.parametrize(
    ('situation', 'name'),
    [
        ('configured', 'its heartbeat (77Fh)'),
        ('active at rest', 'SYNC (080h)'),
        ('active in motion', 'process data for node 3'),
    ],
)
def test_master_that_starts_later_stops_all_and_is_named(rig, situation, name):
    SITUATIONS[situation](rig)
    rig.forge(*FRAMES[name])
    rig.until_stopped()
    assert f'another master is on the bus: {name} was received' in rig.all_causes
    rig.request('clear_faults')


# --- a drive that sends SYNC


def make_producer(drive, period_us: int) -> None:
    """Store in a drive that it sends SYNC with a period [us]."""
    drive.objects.stored |= {(0x1005, 0): 0x40000080, (0x1006, 0): period_us}
    drive.reboot()


@pytest.mark.parametrize('period_us', [0, 5_000, 80_000, 300_000])
@pytest.mark.parametrize('number', range(3))
def test_drive_that_sends_sync_is_named_and_configured(rig, period_us, number):
    make_producer(rig.drives[number], period_us)
    rig.run(0.1)
    rig.request('configure')
    assert (
        f'{AXIS_NAMES[number]} (node {number + 1}) sends SYNC itself (1005h = 40000080h)'
        in ' '.join(rig.snapshot.notes)
    )
    begin = rig.clock.now
    rig.request('home', 'activate')
    assert rig.state is ControllerState.ACTIVE
    syncs = [one for one in rig.frames() if one.cob_id == 0x80 and one.time > begin]
    periods = (rig.clock.now - begin) / SETTINGS.period
    assert len(syncs) == pytest.approx(periods, abs=2)


@pytest.mark.parametrize(('period_us', 'period'), [(80_000, 0.015), (2_000_000, 2.0)])
def test_master_beside_a_drive_that_sends_sync_is_named(rig, period_us, period):
    make_producer(rig.drives[1], period_us)
    forge_syncs(rig, period)
    with pytest.raises(BusError, match=r'another master.*SYNC \(080h\)'):
        rig.request('configure')


def keep_value(objects) -> None:
    objects.readers[0x1005, 0] = lambda: 0x40000080


def reject_write(objects) -> None:
    def abort(_):
        raise SdoAbortedError(0x06010002)

    objects.writers[0x1005, 0] = abort


@pytest.mark.parametrize('spoil', [keep_value, reject_write])
def test_drive_that_keeps_sending_sync_is_named(rig, spoil):
    make_producer(rig.drives[1], 80_000)
    spoil(rig.drives[1].objects)
    rig.run(0.1)
    message = rig.rejection('configure')
    assert 'q2 (node 2) sends SYNC itself (1005h = 40000080h)' in message
    assert 'store 1005h = 80h in the drive' in message
    assert 'another master' not in message


# --- a foreign SYNC beside that of the kernel


def forge_syncs(rig, period: float, frame=(cob_ids.SYNC, b'')) -> None:
    """Send SYNCs of another master with a period [s] from now on."""

    def send():
        rig.forge(*frame)
        rig.later(period, send)

    rig.later(0.003, send)


@pytest.mark.parametrize('period', [0.005, 0.01, 0.015, 0.037, 0.1, 0.2])
@pytest.mark.parametrize('data', [b'', b'\x01'])
def test_foreign_sync_stops_the_drives_within_a_second(make_rig, period, data):
    rig = make_rig(has_kernel_sync=True)
    at_rest(rig)
    forge_syncs(rig, period, (cob_ids.SYNC, data))
    rig.until(lambda: rig.state is ControllerState.STOPPED, 1.0)
    assert 'another master is on the bus: SYNC (080h) was received' in rig.all_causes


def test_unmarked_sync_is_foreign_where_ours_is_marked(make_rig):
    rig = make_rig(has_kernel_sync=True)
    rig.marks_kernel_sync = True
    at_rest(rig)
    rig.run(1.0)
    assert rig.state is ControllerState.ACTIVE
    rig.forge(cob_ids.SYNC)
    rig.until(lambda: rig.state is ControllerState.STOPPED, 0.02)


@pytest.mark.parametrize('situation', SITUATIONS)
def test_power_is_unknown_at_once_behind_a_lost_bus(make_rig, situation):
    rig = make_rig(axes=SWITCH_HOMING)
    SITUATIONS[situation](rig)
    powers = []
    observe = rig.controller.observe

    def record(snapshot):
        observe(snapshot)
        if snapshot.state is ControllerState.BUS_LOST:
            powers.append(snapshot.power)

    rig.controller.observe = record
    rig.bus_error = BusError('can0 is down')
    rig.run(1.5)
    assert {*powers} <= {'unknown'}


@pytest.mark.parametrize('cycles', range(0, 30, 3))
def test_cleanup_with_lost_bus_names_drives_not_confirmed_off(rig, cycles):
    at_rest(rig)
    rig.controller.stop('the operator stops')
    rig.until_stopped()
    for drive in rig.drives:
        deaf_to_rpdo(drive)
    job = rig.ask('cleanup')
    rig.cycles(cycles)
    rig.bus_error = BusError('can0 is down')
    rig.until(job.done)
    message = str(job.exception())
    assert 'q3 (node 3) is not confirmed off: the bus is lost: can0 is down' in message
    assert rig.state is ControllerState.UNCONFIGURED


# three each: reset, pre-operational, operational
@pytest.mark.parametrize('number', range(9))
def test_congested_network_command_is_sent_later(rig, number):
    commands = []

    class CongestedBus(FakeBus):
        def send(self, cob_id, *content):
            if cob_id == cob_ids.NMT:
                commands.append(content)
                if len(commands) == number + 1:
                    raise BusCongestedError('can0: the send queue is full')
            super().send(cob_id, *content)

    rig.make_bus = CongestedBus
    rig.request('configure', 'home', 'activate')
    assert len(commands) > number
    assert not rig.controller.bus.lost


def has_started(rig):
    """Return whether the cycle has started."""
    exchange = rig.controller.bus.exchange
    return exchange is not None and exchange.has_started


def test_states_during_configure_are_at_most_100_a_second(rig):
    observed = []
    observe = rig.controller.observe

    def record(snapshot):
        observe(snapshot)
        observed.append(snapshot.state)

    rig.controller.observe = record
    begin = rig.clock.now
    job = rig.ask('configure')
    rig.until(lambda: job.done() or has_started(rig))
    assert len(observed) <= 100.0 * (rig.clock.now - begin) + 10


# --- another master that changes the drives


@pytest.mark.parametrize('nodes', [[0], [2]], ids=['all', 'q2'])
def test_pre_operational_drives_with_power_stop_within_100_ms(rig, nodes):
    in_motion(rig)
    for node in nodes:
        rig.forge(0, bytes([128, node]))
    rig.run(0.1)
    assert State.OPERATION_ENABLED not in rig.drive_states
    rig.recover()


@pytest.mark.parametrize('situation', ['configured', 'active in motion'])
@pytest.mark.parametrize(
    'write', [b'\x23\x16\x10\x01', b'\xc2\x16\x10\x01', b'\x21\x16\x10\x01']
)
def test_sdo_write_of_another_master_stops_all(rig, situation, write):
    SITUATIONS[situation](rig)
    rig.forge(0x602, write + bytes(4))
    rig.until_stopped()
    assert 'another master is on the bus: an SDO write to node 2' in rig.all_causes


def test_object_changed_by_another_master_needs_configure(rig):
    at_rest(rig)
    rig.forge(0x602, b'\x23\x16\x10\x01' + bytes(4))
    rig.until_stopped()
    assert 'object 1016h:01 reads back as 0' in rig.rejection('clear_faults')
    rig.recover()


@pytest.mark.parametrize('request_', [b'\x40\x16\x10\x01' + bytes(4), b'\x40', b''])
def test_sdo_read_of_another_master_stops_nothing(rig, request_):
    at_rest(rig)
    rig.forge(0x602, request_)
    rig.run(0.2)
    assert rig.state is ControllerState.ACTIVE
