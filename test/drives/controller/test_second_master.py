"""Another master on the bus: heard before the first word, named when it comes later."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
import threading
import time

from drive_rig import moving, PATIENCE, Rig, SETTINGS, SITUATIONS, Source
import pytest
from support import wait_until

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.cia402.states import State
from facade_manipulator.drives.controller.controller import DriveController
from facade_manipulator.drives.controller.session import BusAccess, Session
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.drives.controller.targets import MechanismChecks
from facade_manipulator.errors import BusError


@contextmanager
def chatter(rig: Rig, cob_id: int, data: bytes):
    """Let somebody send a frame every few milliseconds meanwhile."""
    ends = threading.Event()

    def talk():
        while not ends.wait(0.005):
            rig.forge(cob_id, data)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield
    finally:
        ends.set()
        thread.join()


def second_controller(rig: Rig, opening: float = 0.0) -> tuple[DriveController, list]:
    """Return another controller on the same bus, which opens within a time, and what it sends."""
    sent = []

    def open_bus():
        time.sleep(opening)
        bus = rig.open_bus()
        send = bus.send
        bus.send = lambda *frame: (sent.append(frame), send(*frame))
        return bus

    controller = DriveController(Session(
        SETTINGS, DEFAULT_AXES, BusAccess(open_bus), MechanismChecks(Source())))
    controller.start()
    return controller, sent


@pytest.mark.parametrize('opening', [pytest.param(0.0, marks=pytest.mark.quick), 2.0])
def test_a_second_driver_is_rejected_before_it_says_a_word(rig, opening):
    moving(rig)
    second, sent = second_controller(rig, opening)
    with pytest.raises(BusError, match='another master uses this bus') as caught:
        second.request('configure').result(PATIENCE)
    second.close()
    assert all(what in str(caught.value) for what in (
        'its heartbeat (77Fh)', 'SYNC (080h)', 'process data for node 2'))
    assert not sent
    assert rig.state is ControllerState.ACTIVE
    assert rig.drive_states == [State.OPERATION_ENABLED] * 3


@pytest.mark.parametrize('delay', [0.0, 0.01, 0.03, 0.05, 0.1, 0.3])
def test_of_two_drivers_that_configure_together_at_most_one_does(rig, delay):
    """None of them needs the ROS graph for that: each finds the other on the bus."""
    second, _ = second_controller(rig)
    jobs = [rig.controller.request('configure')]
    time.sleep(delay)  # s; each listens for two heartbeats before its first frame
    jobs.append(second.request('configure'))
    errors = [error for job in jobs if (error := job.exception(PATIENCE)) is not None]
    assert errors
    assert all('another master uses this bus' in str(error) for error in errors)
    if len(errors) == 1:
        loser = next(job for job in jobs if job.exception() is not None)
        assert loser is jobs[1] and rig.state is ControllerState.INACTIVE
        rig.do('home', 'activate')
        assert rig.drive_states == [State.OPERATION_ENABLED] * 3
    second.close()


@pytest.mark.parametrize(('cob_id', 'data', 'what'), [
    (0x77F, b'\x05', 'its heartbeat (77Fh)'),
    (0x080, b'', 'SYNC (080h)'),
    (pdo.RPDO1.cob_id(3), bytes(7), 'process data for node 3'),
    (0x601, b'\x40\x00\x10' + bytes(5), 'an SDO request to node 1'),
    (0x000, b'\x01\x00', 'an NMT command'),
])
def test_whatever_another_master_sends_is_heard_and_named(rig, cob_id, data, what):
    with chatter(rig, cob_id, data):
        assert what in rig.rejection('configure')
    assert rig.state is ControllerState.UNCONFIGURED
    rig.do('configure')


def test_the_drives_own_frames_are_nobody_elses(rig):
    with chatter(rig, 0x701, b'\x7f'):
        rig.do('configure')


@pytest.mark.parametrize(('situation', 'cob_id', 'data', 'what'), [
    ('inactive', 0x77F, b'\x05', 'its heartbeat (77Fh)'),
    ('at rest', 0x080, b'', 'SYNC (080h)'),
    ('moving', pdo.RPDO1.cob_id(2), bytes(7), 'process data for node 2'),
])
def test_a_master_that_comes_later_stops_all_and_is_named(rig, situation, cob_id, data, what):
    SITUATIONS[situation](rig)
    rig.forge(cob_id, data)
    rig.until_stopped()
    assert f'another master is on the bus, {what} was received' in rig.all_causes
    rig.source.speed = 0.0
    rig.do('clear_faults')


@pytest.mark.parametrize('opening', [0.0, 2.0])
def test_a_lost_bus_on_which_another_master_is_by_now_stays_lost(make_rig, opening, monkeypatch):
    rig = make_rig(settings=replace(SETTINGS, reopen_after=0.1))
    SITUATIONS['inactive'](rig)
    new_bus = rig._new_bus
    monkeypatch.setattr(rig, '_new_bus', lambda: (time.sleep(opening), new_bus())[1])
    rig.bus_is_missing = True
    rig.buses[-1].shutdown()
    rig.until(ControllerState.BUS_LOST)
    with chatter(rig, 0x77F, b'\x05'):
        rig.bus_is_missing = False
        wait_until(lambda: 'another master' in rig.controller.snapshot().bus_error, 'the reason')
        assert rig.state is ControllerState.BUS_LOST
    rig.until(ControllerState.STOPPED)
