"""What an interface of the kernel's and strangers on it may do to the driver."""

from __future__ import annotations

from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import signal
import subprocess
import time

import pytest
from stack import (
    assert_says,
    bring_up,
    come_down,
    go_on,
    is_enabled,
    make_sure_of_power,
    wait_until_enabled,
)
from support import wait_until
from test_drive_simulator import switch
from test_kills import enables
from watcher import NODES

from facade_manipulator.ros.client import ManipulatorError

MOST_BUSY = 0.5  # of a guest's processor: far from a loop without a pause


def busy_share(pid: int) -> float:
    """
    Return which share of a processor a process uses.

    User-mode Linux counts processor time by looking who runs at its tick of 100 Hz, and a timer of
    100 Hz may be what it always sees. It has one processor, so there it is told from what is left
    for others.
    """
    if os.cpu_count() > 1:
        begin, used = time.monotonic(), processor_time(pid)
        time.sleep(2.0)
        return (processor_time(pid) - used) / (time.monotonic() - begin)
    beside = work_done(1.0)
    os.kill(pid, signal.SIGSTOP)
    try:
        alone = work_done(1.0)
    finally:
        os.kill(pid, signal.SIGCONT)
    return 1.0 - beside / alone


def work_done(duration: float) -> int:
    """Return how often this process gets round a loop in a time [s]."""
    end, rounds = time.monotonic() + duration, 0
    while time.monotonic() < end:
        sum(range(10_000))
        rounds += 1
    return rounds


def processor_time(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def test_an_interface_that_goes_and_comes_back_leaves_the_driver_inactive(
        active, driver, watcher, vcan0):
    make_sure_of_power(active, watcher)
    switch(vcan0, up=False)
    try:
        active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
        assert_says(active, 'bus', 'down')
        used = busy_share(driver.pid)
        print(f'{100.0 * used:.0f} % of the processor while the bus is gone')
        assert used < MOST_BUSY
    finally:
        switch(vcan0, up=True)
    thawed = time.time()
    wait_until(lambda: cleared(active), 'clear_faults to be possible', 30.0,
               step=lambda: active.spin(0.2))
    assert [watcher.first(0x200 + node, thawed, enables) for node in NODES] == [None] * 3
    go_on(active)
    wait_until_enabled(watcher)


def cleared(client) -> bool:
    try:
        client.clear_faults()
    except ManipulatorError:
        return False
    return True


@contextmanager
def cangen(interface: str, *options: str):
    """Let the generator of can-utils talk meanwhile."""
    program = shutil.which('cangen')
    if program is None:
        pytest.skip('no cangen here: it is in the package can-utils')
    process = subprocess.Popen([program, interface, '-i', *options])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def test_extended_and_remote_frames_of_a_stranger_disturb_nothing(
        active, driver, watcher, vcan0):
    make_sure_of_power(active, watcher)
    with cangen(vcan0, '-g', '4', '-e', '-n', '300') as extended, \
            cangen(vcan0, '-g', '4', '-R', '-n', '300') as remote:
        wait_until(lambda: extended.poll() == remote.poll() == 0, 'the end of both', 40.0,
                   step=watcher.read)
    assert active.driver_state() == 'active'
    assert is_enabled(watcher)
    assert watcher.commands.complaints == []


def test_whatever_a_stranger_says_the_driver_lives_and_recovers(
        active, driver, watcher, vcan0):
    make_sure_of_power(active, watcher)
    with cangen(vcan0, '-g', '1', '-n', '3000') as everything:
        wait_until(lambda: everything.poll() == 0, 'the end of it', 40.0,
                   step=lambda: active.spin(0.1))
    assert driver.poll() is None
    assert 'Traceback' not in driver.log.read_text()
    come_down(active)
    bring_up(active)
