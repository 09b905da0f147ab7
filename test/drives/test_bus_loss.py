"""The drive controller on a bus that is lost, or that drops, doubles or delays frames."""

from __future__ import annotations

import random

from drive_faults import at_rest, configured, in_motion
import pytest

from facade_manipulator.canopen.bus import BusCongestedError
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.cause import Remedy
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import BusError


@pytest.mark.parametrize(('request_', 'state'), [
    ('cleanup', ControllerState.UNCONFIGURED), ('close', ControllerState.CLOSED)])
def test_lost_bus_can_be_cleaned_up_and_closed(rig, request_, state):
    at_rest(rig)
    rig.bus_error = BusError('can0 is down')
    rig.until(lambda: rig.state is ControllerState.BUS_LOST)
    rig.until(lambda: rig.snapshot.axes[0].heartbeat_age > 1.0)
    assert 'the control loop failed' not in rig.all_causes
    assert 'q3 (node 3) is not confirmed off: the bus is lost' in rig.rejection(request_)
    assert rig.state is state
    rig.bus_error = None
    if request_ == 'cleanup':  # drives that miss our heartbeat have no other master
        rig.request('configure')


def restart(drives):
    drives[1].reboot()


def push(drives):
    for drive in drives:
        drive.motor.place(drive.motor.carriage_position + 0.068)


@pytest.mark.parametrize('meanwhile', [list, restart, push])
def test_drives_behind_lost_bus_are_configured_and_homed_again(rig, meanwhile):
    in_motion(rig)
    rig.bus_error = BusError('can0 is down')
    rig.until(lambda: rig.state is ControllerState.BUS_LOST)
    meanwhile(rig.drives)
    rig.bus_error = None
    rig.run(2.0)
    assert rig.state is ControllerState.BUS_LOST and rig.bus is None
    assert rig.snapshot.unhomed == AXIS_NAMES
    for request in ('configure', 'home', 'activate', 'clear_faults'):
        assert 'next: check the CAN bus, wait until it is back, then cleanup, configure, home, ' \
               'activate' in rig.rejection(request)
    assert 'configure, home, activate' in rig.rejection('cleanup')
    rig.request('configure')
    assert 'must be homed' in rig.rejection('activate')
    rig.request('home', 'activate')


@pytest.mark.parametrize(('is_virtual', 'remedy'), [(False, Remedy.BUS), (True, Remedy.COMPUTER)])
def test_silence_of_all_drives_is_blamed_on_the_bus(rig, is_virtual, remedy):
    configured(rig)
    rig.bus.is_virtual = is_virtual
    for drive in rig.drives:
        drive.is_silent = True
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    cause, = rig.snapshot.causes
    assert cause.message.startswith('no drive answers any longer: q1 (node 1) did not answer')
    assert cause.remedy == remedy


@pytest.mark.parametrize(('seconds', 'state'), [
    (0.1, ControllerState.STOPPED), (0.3, ControllerState.BUS_LOST)])
def test_full_send_queue_is_lost_bus_after_200_ms(rig, seconds, state):
    at_rest(rig)
    bus, send = rig.bus, rig.bus.send

    def reject(*_):
        raise BusCongestedError('can0: the send queue is full')

    bus.send = reject
    rig.run(seconds)
    bus.send = send
    rig.run(1.0)
    assert rig.state is state


DELAY = 0.005  # s, the longest of a late frame


def bad_wire(kind, share, seed):
    """Return a function that drops, doubles or delays a share of the frames in one direction."""
    chance, underway = random.Random(seed).random, []

    def carry(frames, now):
        for frame in frames:
            fault = kind if chance() < share else ''
            arrival = now + DELAY * chance() if fault == 'delayed' else now
            underway.extend([(arrival, frame)] * {'dropped': 0, 'doubled': 2}.get(fault, 1))
        arrived = [frame for arrival, frame in underway if arrival <= now]
        underway[:] = [one for one in underway if one[0] > now]  # comes with a later frame
        return arrived
    return carry


def put_on_bad_bus(drive, *details):
    receive, advance = drive.receive, drive.advance
    there, back = bad_wire(*details, drive.node_id), bad_wire(*details, drive.node_id)
    drive.receive = lambda cob_id, data, now: [
        answer for frame in there([(cob_id, data)], now) for answer in receive(*frame, now)]
    drive.advance = lambda now: back(advance(now), now)


@pytest.mark.parametrize(
    ('kind', 'share'), [('dropped', 0.05), ('doubled', 0.2), ('delayed', 0.2)])
def test_dropped_doubled_or_late_frames_keep_limits(rig, kind, share):
    in_motion(rig)
    rig.checks.is_late = True  # a SYNC waits for answers that do not come
    for drive in rig.drives:
        put_on_bad_bus(drive, kind, share)
    before = rig.checks.commands
    rig.cycles(30)
    assert rig.checks.commands > before
