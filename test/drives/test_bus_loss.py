"""The drive controller on a bus that goes away, or carries frames badly, or anybody's."""

from __future__ import annotations

from dataclasses import replace
import random

from bus_world import SETTINGS
from drive_faults import at_rest, configured, in_motion
import pytest

from facade_manipulator.canopen.bus import Condition
from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.cause import Remedy
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import BusError

# --- the bus goes away

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
    if request_ == 'cleanup':  # drives that miss our heartbeat are nobody else's
        rig.request('configure')


def test_drive_restarted_behind_lost_bus_must_be_configured(make_rig):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.25, step_timeout=0.4))
    configured(rig)
    lose_the_bus(rig, lambda drives: drives[1].reboot())
    assert 'cleanup, configure' in rig.rejection('clear_faults')
    rig.request('cleanup', 'configure')


def lose_the_bus(rig, meanwhile):
    rig.bus_error = BusError('can0 is down')
    rig.until(lambda: rig.state is ControllerState.BUS_LOST)
    meanwhile(rig.drives)
    rig.bus_error = None
    rig.until(lambda: rig.state is ControllerState.STOPPED)


def restart_with_stored_objects(drives):
    drive = drives[1]
    stored = dict(drive.objects.values)
    drive.reboot()
    drive.objects.values.update(stored)
    drive._restart_heartbeat(drive.objects.values[0x1017, 0])


def push(drives):
    for drive in drives:
        drive.motor.place(drive.motor.carriage_position + 0.068)


@pytest.mark.parametrize(('meanwhile', 'unhomed', 'says'), [
    # its objects read back as they were written, its encoder counts from another zero
    (restart_with_stored_objects, ('q2',), ''),
    (push, AXIS_NAMES, '0.068 m from where it was when the bus was lost')])
def test_carriage_moved_behind_lost_bus_is_not_homed(
        make_rig, meanwhile, unhomed, says):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.3))
    configured(rig)
    lose_the_bus(rig, meanwhile)
    rig.until(lambda: rig.snapshot.unhomed == unhomed)
    assert says in rig.all_causes
    assert 'next: home, activate' in rig.request('clear_faults')
    assert f'{unhomed[-1]} must be homed' in rig.rejection('activate')


@pytest.mark.parametrize(('is_virtual', 'remedy'), [(False, Remedy.BUS), (True, Remedy.COMPUTER)])
def test_silence_of_all_drives_is_blamed_on_the_bus(rig, is_virtual, remedy):
    configured(rig)
    rig.bus.is_virtual = is_virtual
    for drive in rig.drives:
        drive.is_silent = True
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    cause, = rig.snapshot.causes
    assert cause.message.startswith('no drive answers any more: q1 (node 1) did not answer')
    assert cause.remedy == remedy


def test_bus_that_is_back_is_used_once_it_is_healthy(rig):
    configured(rig)
    rig.bus_error = BusError('can0 is down')
    rig.until(lambda: rig.state is ControllerState.BUS_LOST)
    rig.bus_error = None
    rig.until(lambda: rig.bus is not None)
    rig.bus._condition = Condition.PASSIVE
    rig.frames()
    rig.run(1.0)
    assert rig.state is ControllerState.BUS_LOST
    assert not [frame for frame in rig.frames() if frame.cob_id in (0x77F, 0x201)]
    rig.bus._condition = Condition.ACTIVE
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    rig.recover()


# --- a bad wire

DELAY, COPIES = 0.005, {'dropped': 0, 'doubled': 2}  # s, the longest of a late frame


class BadWire:
    """One way of a drive's frames, of which a share is dropped, doubled or delayed."""

    def __init__(self, kind: str, share: float, seed: int) -> None:
        self._kind, self._share, self._chance = kind, share, random.Random(seed).random
        self._underway = []

    def carry(self, frames, now):
        """Return what arrives now; what is late comes with a later frame."""
        for frame in frames:
            kind = self._kind if self._chance() < self._share else ''
            delay = DELAY * self._chance() if kind == 'delayed' else 0.0
            self._underway += [(now + delay, frame)] * COPIES.get(kind, 1)
        arrived = [frame for arrival, frame in self._underway if arrival <= now]
        self._underway = [one for one in self._underway if one[0] > now]
        return arrived


def put_on_bad_bus(drive, *details) -> None:
    receive, advance = drive.receive, drive.advance
    there, back = BadWire(*details, drive.node_id), BadWire(*details, drive.node_id)
    drive.receive = lambda cob_id, data, now: [
        answer for frame in there.carry([(cob_id, data)], now) for answer in receive(*frame, now)]
    drive.advance = lambda now: back.carry(advance(now), now)


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
