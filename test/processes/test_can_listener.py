"""The black box beside the bus: every frame of the kernel's, whoever sent it."""

from __future__ import annotations

import time

import can
from support import wait_until

from facade_manipulator.blackbox import CanListener, frame_bytes, Kept, messages_of

FRAMES = 100
BETWEEN_CLOCKS = 0.05  # s, that may pass between a look at the kernel's clock and at Python's


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
            wait_until(lambda: recorder.hand_on() or kept or bus.send(sent[0]), 'the first frame')
            kept.clear()
            begin = time.monotonic()
            for frame in sent * FRAMES:
                bus.send(frame)
            wait_until(lambda: recorder.hand_on() or [
                one.data[12:] for one in kept].count(expected[-1][12:]) == FRAMES, 'all of them')
    finally:
        recorder.close()
    assert [data[12:] for _, _, data in kept[-3 * FRAMES:]] == FRAMES * [
        data[12:] for data in expected]  # after the stamp
    times = [at for at, _, _ in kept[-3 * FRAMES:]]
    assert min(b - a for a, b in zip(times, times[1:], strict=False)) > -BETWEEN_CLOCKS
    assert begin - BETWEEN_CLOCKS <= times[0] and times[-1] <= time.monotonic() + BETWEEN_CLOCKS


def test_the_black_box_names_an_interface_that_is_not_there(vcan0):
    recorder = CanListener('vcan9', print)
    wait_until(lambda: recorder.error == 'vcan9: No such device', 'the message')
    recorder.close()
