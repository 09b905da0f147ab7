"""
Drives stop safely when a process of the driver is killed or frozen.

The tests share a driver as long as it runs, so tests that end it are last.
"""

import os
from pathlib import Path
import signal
import time

from frames import decode_rpdo1, decode_tpdo1
import pytest
from stack import go_on, make_sure_of_power
from support import children, wait_until
from watcher import NODES

from facade_manipulator.drives.states import Controlword, decode_state, State

HEARTBEAT_TIMEOUT = 0.15
QUICK_STOP_WITHIN = 0.16
RAMP_WITHIN = 3.0


def misses_heartbeat(data: bytes) -> bool:
    return data[:2] == b'\x30\x81'


def stops(data: bytes) -> bool:
    return decode_rpdo1(data).controlword == Controlword.QUICK_STOP


def is_off(data: bytes) -> bool:
    return decode_state(decode_tpdo1(data).statusword) is State.SWITCH_ON_DISABLED


def enables(data: bytes) -> bool:
    return decode_rpdo1(data).controlword & 0x0F == Controlword.ENABLE_OPERATION


def first_of_each(watcher, base, since, wanted) -> list[float] | None:
    """Return the times of the first wanted frame of each node, None until all have come."""
    times = [watcher.first(base + node, since, wanted) for node in NODES]
    return None if None in times else times


# a guest may pause on a busy computer
@pytest.mark.driver('controller.max_missed_cycles:=10')
def test_frozen_loop_stops_drives_and_enables_none_later(
    active, driver, watcher, vcan0
):
    """The kernel continues to send SYNC while the loop is frozen."""
    make_sure_of_power(active, watcher)
    (loop,) = children(driver.pid)
    begin = time.time()
    os.kill(loop, signal.SIGSTOP)
    try:

        def emergencies():
            return first_of_each(watcher, 0x080, begin, misses_heartbeat)

        times = wait_until(emergencies, 'the drives')
        last = watcher.last(0x77F, min(times))  # heartbeat of the master
        pause = watcher.pause(last, max(times))
        assert HEARTBEAT_TIMEOUT <= max(times) - last <= QUICK_STOP_WITHIN + pause
        wait_until(
            lambda: watcher.states() == [State.QUICK_STOP_ACTIVE] * 3, 'quick stop'
        )
        wait_until(
            lambda: time.time() > begin + 2.0 * HEARTBEAT_TIMEOUT, 'a long pause'
        )
    finally:
        thawed = time.time()
        os.kill(loop, signal.SIGCONT)
    active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
    assert first_of_each(watcher, 0x200, thawed, stops)
    assert [watcher.first(0x200 + node, thawed, enables) for node in NODES] == [
        None
    ] * 3
    assert watcher.states() == [State.QUICK_STOP_ACTIVE] * 3
    assert 'the control loop was paused' in active.clear_faults()
    go_on(active)


def test_loop_of_a_killed_node_ramps_down(active, driver, watcher):
    """The drives lose power by commands of the loop, without a quick stop."""
    make_sure_of_power(active, watcher)
    (loop,) = children(driver.pid)
    begin = time.time()
    os.kill(driver.pid, signal.SIGKILL)
    off = wait_until(lambda: first_of_each(watcher, 0x180, begin, is_off), 'power off')
    assert max(off) - begin <= RAMP_WITHIN + watcher.pause(begin, max(off))
    assert [watcher.first(0x200 + node, begin, stops) for node in NODES] == [None] * 3
    assert [watcher.first(0x080 + node, begin) for node in NODES] == [None] * 3
    wait_until(lambda: not Path(f'/proc/{loop}').exists(), 'the end of the loop')
