"""What processes, the interface and strangers on a real SocketCAN bus may do to the drives."""

from __future__ import annotations

from contextlib import contextmanager, suppress
import os
from pathlib import Path
import shutil
import signal
import subprocess
import time

import can
from command_watch import CommandWatch
import pytest
from support import wait_until
from test_drive_simulator import switch
from test_stack import active, client, DRIVER, driver, drives, PATIENCE  # noqa: F401

from facade_manipulator.client import ManipulatorError
from facade_manipulator.drives import pdo
from facade_manipulator.drives.cia402 import Controlword, decode_state, State
from facade_manipulator.drives.settings import DEFAULT_AXES

NODES = (1, 2, 3)
HEARTBEAT_TIMEOUT = 0.15
QUICK_STOP_WITHIN = 0.16
EXECUTOR_TIMEOUT = 0.3
PERIOD = 0.02
HERE = Path(__file__).resolve().parent


class Watcher:
    """A python-can bus of its own; the kernel stamps the frames."""

    def __init__(self, interface: str) -> None:
        self._bus = can.Bus(interface='socketcan', channel=interface)
        self._bus.set_filters([
            {'can_id': cob_id, 'can_mask': 0x7FF, 'extended': False} for node in NODES
            for cob_id in (0x080 + node, 0x180 + node, 0x200 + node, 0x77F)])
        self.frames: list[can.Message] = []
        self.commands = CommandWatch(DEFAULT_AXES, PERIOD)

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

    def states(self) -> list[State | None]:
        """Return the drives' states by their newest TPDO1."""
        newest = {frame.arbitration_id: bytes(frame.data) for frame in self.read()}
        return [decode_state(pdo.decode_tpdo1(newest[0x180 + node]).statusword)
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
    return pdo.decode_rpdo1(data).controlword == Controlword.QUICK_STOP


def enables(data: bytes) -> bool:
    return pdo.decode_rpdo1(data).controlword & 0x0F == Controlword.ENABLE_OPERATION


def assert_drives_stopped_by_themselves(watcher: Watcher, since: float) -> None:
    """Check how long after the master's last heartbeat each drive has said that it misses it."""
    times = wait_until(lambda: all_of(
        watcher.first(0x080 + node, since, misses_heartbeat) for node in NODES), 'the drives')
    last = watcher.last(0x77F, min(times))
    print(f'quick stop {1e3 * (max(times) - since):.0f} ms after the signal, '
          f'{1e3 * (max(times) - last):.0f} ms after the last heartbeat')
    assert HEARTBEAT_TIMEOUT <= max(times) - last <= QUICK_STOP_WITHIN


def all_of(times) -> list[float] | None:
    found = list(times)
    return None if None in found else found


def is_enabled(watcher: Watcher) -> bool:
    return watcher.states() == [State.OPERATION_ENABLED] * 3


def wait_until_enabled(watcher: Watcher) -> None:
    wait_until(lambda: is_enabled(watcher) and watcher.first(0x77F, 0.0),
               'three enabled drives and a heartbeat of their master')


@pytest.mark.driver()
def test_a_killed_driver_is_missed_by_every_drive_in_time(active, driver, watcher):  # noqa: F811
    wait_until_enabled(watcher)
    begin = time.time()
    os.kill(driver.pid, signal.SIGKILL)
    assert_drives_stopped_by_themselves(watcher, begin)


@pytest.mark.driver()
def test_a_frozen_driver_is_missed_in_time_and_enables_nothing_when_it_thaws(
        active, driver, watcher):  # noqa: F811
    wait_until_enabled(watcher)
    begin = time.time()
    os.kill(driver.pid, signal.SIGSTOP)
    try:
        assert_drives_stopped_by_themselves(watcher, begin)
        wait_until(lambda: watcher.states() == [State.QUICK_STOP_ACTIVE] * 3, 'quick stop')
        wait_until(lambda: time.time() > begin + 2.0 * HEARTBEAT_TIMEOUT, 'a long pause')
    finally:
        thawed = time.time()
        os.kill(driver.pid, signal.SIGCONT)
    active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
    assert all_of(watcher.first(0x200 + node, thawed, stops) for node in NODES)
    assert [watcher.first(0x200 + node, thawed, enables) for node in NODES] == [None] * 3
    assert watcher.states() == [State.QUICK_STOP_ACTIVE] * 3
    assert 'the control loop stood still' in active.clear_faults()
    active.activate()


def test_an_executor_that_hangs_stops_the_drives_in_time(
        drives, start_process, client, watcher):  # noqa: F811
    process = start_process(
        'hanging_driver', '--ros-args', *DRIVER, '-p', 'controller.heartbeat_timeout:=1.0',
        '-p', f'controller.watchdog_timeout:={EXECUTOR_TIMEOUT}',
        env={'PYTHONPATH': str(HERE)})
    client.configure()
    client.home()
    client.activate()
    wait_until_enabled(watcher)
    begin = time.time()
    os.kill(process.pid, signal.SIGUSR1)
    times = wait_until(lambda: all_of(
        watcher.first(0x200 + node, begin, stops) for node in NODES), 'the commands to stop')
    print(f'commanded to stop {1e3 * (max(times) - begin):.0f} ms after the signal')
    assert max(times) - begin <= EXECUTOR_TIMEOUT + 3.0 * PERIOD
    wait_until(lambda: watcher.states() == [State.QUICK_STOP_ACTIVE] * 3, 'quick stop')
    process.kill()  # it would hear nothing else


def processor_time(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def test_an_interface_that_goes_and_comes_back_leaves_the_driver_inactive(
        active, driver, watcher, vcan0):  # noqa: F811
    wait_until_enabled(watcher)
    switch(vcan0, up=False)
    try:
        active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
        active.wait_until(lambda: told(active, 'down'), 'the reason in /diagnostics', 20.0)
        begin, used = time.monotonic(), processor_time(driver.pid)
        active.spin(2.0)
        used = (processor_time(driver.pid) - used) / (time.monotonic() - begin)
        print(f'{100.0 * used:.0f} % of the processor while the bus is gone')
    finally:
        switch(vcan0, up=True)
    thawed = time.time()
    wait_until(lambda: cleared(active), 'clear_faults to be possible', 30.0)
    assert [watcher.first(0x200 + node, thawed, enables) for node in NODES] == [None] * 3
    active.activate()
    wait_until_enabled(watcher)


def told(client, sentence: str) -> bool:  # noqa: F811
    found = client.component('driver: bus')
    return found is not None and sentence in found.status.message


def cleared(client) -> bool:  # noqa: F811
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
        active, driver, watcher, vcan0):  # noqa: F811
    wait_until_enabled(watcher)
    with cangen(vcan0, '-g', '4', '-e', '-n', '300') as extended, \
            cangen(vcan0, '-g', '4', '-R', '-n', '300') as remote:
        wait_until(lambda: extended.poll() == remote.poll() == 0, 'the end of both', 40.0,
                   step=watcher.read)
    assert active.driver_state() == 'active'
    assert is_enabled(watcher)
    assert watcher.commands.complaints == []


def test_whatever_a_stranger_says_the_driver_lives_and_recovers(
        active, driver, watcher, vcan0):  # noqa: F811
    wait_until_enabled(watcher)
    with cangen(vcan0, '-g', '2', '-n', '3000') as everything:
        wait_until(lambda: everything.poll() == 0, 'the end of it', 40.0,
                   step=lambda: active.spin(0.1))
    assert driver.poll() is None
    assert 'Traceback' not in driver.log.read_text()
    if active.driver_state() == 'active':
        active.deactivate()
    active.cleanup()
    active.configure()
    active.home()
    active.activate()
