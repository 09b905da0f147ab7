"""
What processes, the interface and strangers on a real SocketCAN bus may do to the drives.

The tests share a driver as long as it lives: those that end it come last.
"""

from __future__ import annotations

from contextlib import contextmanager, suppress
import os
from pathlib import Path
import re
import shutil
import signal
import struct
import subprocess
import time

import can
from command_watch import CommandWatch
from frames import decode_rpdo1, decode_tpdo1
from listener import Listener
import pytest
from stack import as_driver, assert_says, bring_up, come_down, DRIVER, go_on, PERIOD
from support import children, DEADLINE, hear_much, patiently, wait_until
from test_drive_simulator import switch

from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.cia402.states import Controlword, decode_state, State
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.ros.client import ManipulatorClient, ManipulatorError

NODES = (1, 2, 3)
HEARTBEAT_TIMEOUT = 0.15
QUICK_STOP_WITHIN = 0.16
RAMP_WITHIN = 3.0
MOST_BUSY = 0.5  # of a guest's processor: far from a loop without a pause
PULSE, PULSE_PERIOD = 0x7F1, 0.005  # no drive listens to it
HERE = Path(__file__).resolve().parent


class Watcher:
    """A python-can bus of its own; the kernel stamps the frames."""

    def __init__(self, interface: str) -> None:
        self._bus = can.Bus(interface='socketcan', channel=interface)
        hear_much(self._bus.socket)
        self._bus.set_filters([
            {'can_id': cob_id, 'can_mask': 0x7FF, 'extended': False} for node in NODES
            for cob_id in (0x080, 0x080 + node, 0x180 + node, 0x200 + node, 0x77F, PULSE)])
        self.frames: list[can.Message] = []
        self.commands = CommandWatch(DEFAULT_AXES, PERIOD)
        self._bus.send_periodic(
            can.Message(arbitration_id=PULSE, is_extended_id=False), PULSE_PERIOD)

    def read(self) -> list[can.Message]:
        """Take what has come; return all frames so far."""
        with suppress(can.CanOperationError):  # told once when the interface went down
            while (message := self._bus.recv(0.0)) is not None:
                if not message.is_remote_frame:
                    self.frames.append(message)
                    self.commands.take([message])
        return self.frames

    def first(self, cob_id: int, since: float, wanted=lambda data: True) -> float | None:
        """Return when a frame of a COB-ID first came since then, None if none did."""
        return next((
            frame.timestamp for frame in self.read() if frame.arbitration_id == cob_id
            and frame.timestamp >= since and wanted(bytes(frame.data))), None)

    def last(self, cob_id: int, until: float) -> float:
        """Return when a frame of a COB-ID last came until then."""
        return max(frame.timestamp for frame in self.read()
                   if frame.arbitration_id == cob_id and frame.timestamp <= until)

    def pause(self, begin: float, end: float) -> float:
        """Return for how long this machine as a whole did nothing: its kernel sends the pulse."""
        pulses = [frame.timestamp for frame in self.read() if frame.arbitration_id == PULSE
                  and begin - PULSE_PERIOD <= frame.timestamp <= end + PULSE_PERIOD]
        steps = [after - before for before, after in zip(pulses, pulses[1:], strict=False)]
        return max(steps) - PULSE_PERIOD

    def states(self) -> list[State | None]:
        """Return the drives' states by their newest TPDO1."""
        newest = {frame.arbitration_id: bytes(frame.data) for frame in self.read()}
        return [decode_state(decode_tpdo1(newest[0x180 + node]).statusword)
                if 0x180 + node in newest else None for node in NODES]

    def close(self) -> None:
        self._bus.shutdown()


@pytest.fixture
def watcher(vcan0):
    made = Watcher(vcan0)
    yield made
    switch(vcan0, up=True)
    made.close()


def misses_heartbeat(data: bytes) -> bool:
    return data[:2] == b'\x30\x81'


def stops(data: bytes) -> bool:
    return decode_rpdo1(data).controlword == Controlword.QUICK_STOP


def is_off(data: bytes) -> bool:
    return decode_state(decode_tpdo1(data).statusword) is State.SWITCH_ON_DISABLED


def enables(data: bytes) -> bool:
    return decode_rpdo1(data).controlword & 0x0F == Controlword.ENABLE_OPERATION


def assert_drives_stopped_by_themselves(watcher: Watcher, since: float) -> None:
    """Check how long after the master's last heartbeat each drive has said that it misses it."""
    times = wait_until(lambda: all_of(
        watcher.first(0x080 + node, since, misses_heartbeat) for node in NODES), 'the drives')
    last = watcher.last(0x77F, min(times))
    pause = watcher.pause(last, max(times))
    print(f'quick stop {1e3 * (max(times) - since):.0f} ms after the signal, '
          f'{1e3 * (max(times) - last):.1f} ms after the last heartbeat; '
          f'the machine stood still for {1e3 * pause:.1f} ms of it')
    assert HEARTBEAT_TIMEOUT <= max(times) - last <= QUICK_STOP_WITHIN + pause


def all_of(times) -> list[float] | None:
    found = list(times)
    return None if None in found else found


def is_enabled(watcher: Watcher) -> bool:
    return watcher.states() == [State.OPERATION_ENABLED] * 3


def make_sure_of_power(client: ManipulatorClient, watcher: Watcher) -> None:
    """Wait for three enabled drives; bring them up again if this computer was too busy."""
    patiently(lambda: wait_until_enabled(watcher, 2.0),
              lambda: (come_down(client), bring_up(client)), tries=2)


def wait_until_enabled(watcher: Watcher, deadline: float = DEADLINE) -> None:
    wait_until(lambda: is_enabled(watcher) and watcher.first(0x77F, 0.0),
               'three enabled drives and a heartbeat of their master', deadline)


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


def assert_ramped_down_and_off(watcher: Watcher, since: float, within: float) -> None:
    """Check that the drives lost power on the loop's commands, without a quick stop."""
    off = wait_until(lambda: all_of(
        watcher.first(0x180 + node, since, is_off) for node in NODES), 'power off')
    print(f'power off {1e3 * (max(off) - since):.0f} ms after the node was gone')
    assert max(off) - since <= within + watcher.pause(since, max(off))
    assert [watcher.first(0x200 + node, since, stops) for node in NODES] == [None] * 3
    assert [watcher.first(0x080 + node, since) for node in NODES] == [None] * 3
    assert watcher.commands.complaints == []


def test_a_killed_node_leaves_a_loop_that_ramps_down_and_powers_off(active, driver, watcher):
    make_sure_of_power(active, watcher)
    loop, = children(driver.pid)
    begin = time.time()
    os.kill(driver.pid, signal.SIGKILL)
    assert_ramped_down_and_off(watcher, begin, RAMP_WITHIN)
    wait_until(lambda: not Path(f'/proc/{loop}').exists(), 'the end of the loop')


@pytest.mark.driver()
def test_a_frozen_loop_is_missed_in_time_and_enables_nothing_when_it_thaws(
        active, driver, watcher):
    make_sure_of_power(active, watcher)
    loop, = children(driver.pid)
    begin = time.time()
    os.kill(loop, signal.SIGSTOP)
    try:
        assert_drives_stopped_by_themselves(watcher, begin)
        wait_until(lambda: watcher.states() == [State.QUICK_STOP_ACTIVE] * 3, 'quick stop')
        wait_until(lambda: time.time() > begin + 2.0 * HEARTBEAT_TIMEOUT, 'a long pause')
    finally:
        thawed = time.time()
        os.kill(loop, signal.SIGCONT)
    active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
    assert all_of(watcher.first(0x200 + node, thawed, stops) for node in NODES)
    assert [watcher.first(0x200 + node, thawed, enables) for node in NODES] == [None] * 3
    assert watcher.states() == [State.QUICK_STOP_ACTIVE] * 3
    assert 'the control loop stood still' in active.clear_faults()
    go_on(active)


@pytest.mark.driver()
def test_a_driver_that_is_killed_with_its_loop_is_missed_by_every_drive_in_time(
        active, driver, watcher, listener):
    make_sure_of_power(active, watcher)
    begin = time.time()
    for pid in (*children(driver.pid), driver.pid):
        os.kill(pid, signal.SIGKILL)
    assert_drives_stopped_by_themselves(watcher, begin)
    wait_until(lambda: states_by_sdo(listener) == [State.QUICK_STOP_ACTIVE] * 3, 'quick stop')


def states_by_sdo(listener: Listener) -> list[State]:
    """Ask the drives for their statuswords: nobody sends SYNC any more."""
    for node in NODES:
        listener.send(0x600 + node, struct.pack('<BHB4x', 0x40, 0x6041, 0))
    answers = [listener.of(0x580 + node)[-1:] for node in NODES]
    return [decode_state(struct.unpack_from('<H', found[0].data, 4)[0])
            for found in answers if found]


def test_a_node_that_hangs_leaves_a_loop_that_ramps_down_and_powers_off(
        drives, start_process, client, watcher):
    process = start_process(
        'hanging_driver', '--ros-args', *DRIVER, env={'PYTHONPATH': str(HERE)},
        preexec_fn=as_driver)
    bring_up(client)
    make_sure_of_power(client, watcher)
    os.kill(process.pid, signal.SIGUSR1)
    hung = float(wait_until(
        lambda: re.search(r'hung at ([\d.]+)\n', process.log.read_text()), 'the hanging')[1])
    assert_ramped_down_and_off(
        watcher, hung, ControllerSettings().watchdog_timeout + RAMP_WITHIN)
    process.kill()  # it would receive nothing else
