"""Another master on the bus: named before the first word, and when it comes later."""

from __future__ import annotations

from bus_world import SETTINGS
from drive_faults import SITUATIONS
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.errors import BusError

FRAMES = {
    'its heartbeat (77Fh)': (0x77F, b'\x05'),
    'SYNC (080h)': (0x080, b''),
    'process data for node 3': (pdo.RPDO1.cob_id(3), bytes(7)),
    'an SDO request to node 1': (0x601, b'\x40\x00\x10' + bytes(5)),
    'an NMT command': (0x000, b'\x01\x00'),
}


def configure_beside(rig, cob_id, data):
    """Configure while another node repeats a frame; return the future of the reply."""
    job = rig.ask('configure')
    rig.until(lambda: rig.forge(cob_id, data) or job.done())
    return job


@pytest.mark.parametrize('name', FRAMES)
def test_configure_sends_nothing_where_another_master_is(rig, name):
    rig.frames()
    job = configure_beside(rig, *FRAMES[name])
    with pytest.raises(BusError, match='another master uses this bus') as caught:
        job.result()
    assert name in str(caught.value)
    sent = {(frame.cob_id, frame.data) for frame in rig.frames() if frame.cob_id < 0x581}
    assert sent <= {FRAMES[name]}
    assert rig.state is ControllerState.UNCONFIGURED
    rig.request('configure')


def test_configure_sends_nothing_within_two_heartbeats(rig):
    rig.frames()
    rig.ask('configure')
    rig.run(2.0 * SETTINGS.heartbeat_period - 0.005)
    assert not rig.frames()
    rig.run(0.1)
    assert rig.frames()


def test_frames_of_the_drives_are_not_another_masters(rig):
    job = rig.ask('configure')
    rig.run(0.05)
    rig.forge(0x701, b'\x7f')
    rig.finish(job)


@pytest.mark.parametrize(('situation', 'name', 'frame'), [
    ('configured', 'its heartbeat (77Fh)', (0x77F, b'\x05')),
    ('active at rest', 'SYNC (080h)', (0x080, b'')),
    ('active in motion', 'process data for node 2', (pdo.RPDO1.cob_id(2), bytes(7)))])
def test_master_that_comes_later_stops_all_and_is_named(rig, situation, name, frame):
    SITUATIONS[situation](rig)
    rig.forge(*frame)
    rig.until_stopped()
    assert f'another master is on the bus, {name} was received' in rig.all_causes
    rig.request('clear_faults')
