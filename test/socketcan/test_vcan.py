"""The virtual CAN bus is the kernel's: raw sockets of several processes, and its own timer."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time

import can
from listener import Listener
import pytest
from support import period_of, wait_until

from facade_manipulator.blackbox import CanListener, frame_bytes, Kept, messages_of

PERIOD = 0.010
FRAMES = 100
BETWEEN_CLOCKS = 0.05  # s, that may pass between a look at the kernel's clock and at Python's
SENDER = """
import can, sys
with can.Bus(interface='socketcan', channel=sys.argv[1]) as bus:
    bus.send(can.Message(arbitration_id=0x181, data=b'carriage', is_extended_id=False))
"""


@pytest.fixture
def listener(vcan0):
    made = Listener(vcan0)
    yield made
    made.close()


def test_a_frame_of_another_process_arrives_whole(listener, vcan0):
    subprocess.run([sys.executable, '-c', SENDER, vcan0], check=True, timeout=60)
    frame, = wait_until(listener.read, 'the frame')
    assert frame[1:] == (0x181, b'carriage')


def test_a_raw_socket_does_not_hear_itself(listener):
    listener.send(0x080, b'')
    assert listener.read() == []


def test_the_broadcast_manager_keeps_the_period(listener, vcan0):
    sync = can.Message(arbitration_id=0x080, is_extended_id=False)
    with can.Bus(interface='socketcan', channel=vcan0) as bus:
        task = bus.send_periodic(sync, PERIOD)
        wait_until(lambda: len(listener.read()) >= FRAMES, f'{FRAMES} frames')
        task.stop()
    assert {frame[1:] for frame in listener.frames} == {(0x080, b'')}
    assert period_of([frame.time for frame in listener.frames]) == pytest.approx(PERIOD, rel=0.1)


def test_an_interface_that_is_not_there_is_an_error(vcan0):
    with pytest.raises(OSError), can.Bus(interface='socketcan', channel='vcan9'):
        pass


def test_the_black_box_keeps_every_frame_with_its_time(vcan0):
    sent = [can.Message(arbitration_id=0x181, data=b'carriage', is_extended_id=False),
            can.Message(arbitration_id=0x12345, data=b'\1', is_extended_id=True),
            can.Message(arbitration_id=0x701, is_remote_frame=True, is_extended_id=False)]
    expected = [frame_bytes(0.0, frame.arbitration_id, bytes(frame.data),
                            is_rtr=frame.is_remote_frame, is_extended=frame.is_extended_id)
                for frame in sent]
    kept = []
    recorder = CanListener(
        vcan0, lambda at, batch: kept.extend(messages_of(Kept(at, '', batch))))
    try:
        with can.Bus(interface='socketcan', channel=vcan0) as bus:
            wait_until(lambda: kept or bus.send(sent[0]), 'the first frame')
            kept.clear()
            begin = time.monotonic()
            for frame in sent * FRAMES:
                bus.send(frame)
            wait_until(lambda: [one.data[12:] for one in kept].count(expected[-1][12:]) == FRAMES,
                       'all of them')
    finally:
        recorder.close()
    assert [data[12:] for _, _, data in kept[-3 * FRAMES:]] == FRAMES * [
        data[12:] for data in expected]  # after the stamp
    times = [at for at, _, _ in kept[-3 * FRAMES:]]
    assert times == sorted(times)
    assert begin - BETWEEN_CLOCKS <= times[0] and times[-1] <= time.monotonic() + BETWEEN_CLOCKS


def test_the_black_box_names_an_interface_that_is_not_there(vcan0):
    recorder = CanListener('vcan9', print)
    wait_until(lambda: recorder.error == 'vcan9: No such device', 'the message')
    recorder.close()


@pytest.mark.skipif(not shutil.which('candump'), reason='can-utils are not installed')
def test_candump_sees_what_python_sends(vcan0):
    dump = subprocess.Popen(['candump', '-L', '-n', '1', vcan0], stdout=subprocess.PIPE, text=True)
    with can.Bus(interface='socketcan', channel=vcan0) as bus:
        task = bus.send_periodic(can.Message(arbitration_id=0x701, data=[5],
                                             is_extended_id=False), PERIOD)
        output, _ = dump.communicate(timeout=30)
        task.stop()
    assert output.split()[1:] == [vcan0, '701#05']
