"""`commission jog` as a process of its own: killed, stopped or cut off, the carriage stops."""

from __future__ import annotations

import os
import signal
import subprocess
import time

from commission_rig import CommissionRig
from link import clear_flags, IFF_UP, set_flags
from own_processes import end_process
import pytest
from support import patiently, wait_until

STOP_TIME = 0.16  # s
MODULE = 'facade_manipulator.tools.commissioning'
END = 20.0


@pytest.fixture
def rig(bus, tmp_path, start_process):
    made = CommissionRig(tmp_path, bus=bus).configured()
    made.start_process = start_process
    yield made
    made.close()


class Jogger:
    """A process that jogs q1 while a key is written into it."""

    def __init__(self, rig: CommissionRig) -> None:
        self.process = rig.start_process(
            MODULE, *rig.command('jog', 'q1', '--links', 'uncoupled', '--speed', '20'),
            stdin=subprocess.PIPE)
        wait_until(lambda: self.press() or rig.moves(), 'motion', END, lambda: time.sleep(0.02))

    def press(self) -> None:
        os.write(self.process.stdin.fileno(), b'd')

    def end(self) -> None:
        self.process.send_signal(signal.SIGCONT)
        self.process.kill()
        self.process.stdin.close()
        end_process(self.process)


def stop_time(rig, act) -> float:
    jogger = Jogger(rig)
    try:
        begun = time.monotonic()
        act(jogger.process)
        while (rig.moves() or rig.is_enabled()) and time.monotonic() - begun < 2.0:
            if act is _hold_on:
                jogger.press()
            time.sleep(0.002)
        return time.monotonic() - begun
    finally:
        jogger.end()


def _hold_on(process) -> None:
    """Do nothing to it: the control of this test."""


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSTOP, signal.SIGHUP, signal.SIGTERM])
def test_the_carriage_stops_whatever_ends_the_process(rig, number):
    def stops_in_time():
        elapsed = stop_time(rig, lambda process: process.send_signal(number))
        assert elapsed < STOP_TIME, f'{1e3 * elapsed:.0f} ms'
        print(f'{signal.Signals(number).name}: {1e3 * elapsed:.0f} ms')

    patiently(stops_in_time, rig.power_cut)


def test_the_carriage_stops_when_the_bus_is_pulled(vcan0, rig):
    def stops_in_time():
        try:
            elapsed = stop_time(rig, lambda process: clear_flags(vcan0, IFF_UP))
        finally:
            set_flags(vcan0, IFF_UP)
        assert elapsed < STOP_TIME, f'{1e3 * elapsed:.0f} ms'
        print(f'bus pulled: {1e3 * elapsed:.0f} ms')

    patiently(stops_in_time, rig.power_cut)


def test_while_the_key_is_held_it_goes_on(rig):
    def goes_on():
        assert stop_time(rig, _hold_on) >= 2.0

    patiently(goes_on, rig.power_cut)  # a key that comes late stops it, as it should
