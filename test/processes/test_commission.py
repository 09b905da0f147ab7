"""`commission jog` in a process with a terminal: every end of the jog stops the carriage."""

import fcntl
import os
import signal
import termios
import time

import pytest
from support import patiently, wait_until

from facade_manipulator.canopen.bus import open_bus
from facade_manipulator.drives.states import State
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.simulation.drives.__main__ import _parser, make_drives
from facade_manipulator.simulation.drives.simulator import DriveSimulator
from facade_manipulator.tools.commissioning.procedure import Overlay

STOP_TIME = 0.25  # s: the drives miss the heartbeat after 0.15 s


def take_terminal():
    """Make standard input the terminal that controls this process."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


class Jog:
    """Carriage that moves by 150 mm, and the terminal of the process that moves the carriage."""

    def __init__(self, start_process, bus, drive) -> None:
        self.drive = drive
        self.master, terminal = os.openpty()
        words = 'jog q1 150 --speed 20'.split()
        self.process = start_process(
            'facade_manipulator.tools.commissioning',
            *words,
            stdin=terminal,
            stdout=terminal,
            stderr=terminal,
            preexec_fn=take_terminal,
        )
        os.close(terminal)
        self.shown = ''
        self.read('Do this?')
        os.write(self.master, b'y\n')
        wait_until(lambda: self.moves, 'motion')

    def read(self, words: str) -> None:
        """Read the screen until it shows some words."""
        while words not in self.shown:
            self.shown += os.read(self.master, 4096).decode()

    @property
    def moves(self) -> bool:
        return abs(self.drive.motor.velocity) > 5.0  # counts/s


@pytest.fixture
def jog(bus, tmp_path, start_process):
    """Return a function that starts a jog of new drives."""
    overlay = Overlay(tmp_path / 'machine.yaml')
    results = {
        'axes.profile': 'simulated',
        'bus.interface': bus.interface,
        'bus.channel': bus.channel,
    }
    for name in AXIS_NAMES:
        overlay.write(f'direction {name}', results)
    drives = make_drives(_parser().parse_args([]))

    def are_off():
        return {drive.axis.state for drive in drives} == {State.SWITCH_ON_DISABLED}

    with DriveSimulator(open_bus(bus), drives):
        wait_until(are_off, 'boot')
        yield lambda: Jog(start_process, bus, drives[0])


def press_ctrl_c(jog):
    os.write(jog.master, b'\x03')


def close_terminal(jog):
    os.close(jog.master)


def kill(jog):
    jog.process.kill()


def freeze(jog):
    jog.process.send_signal(signal.SIGSTOP)


ENDS = {
    'Ctrl-C': press_ctrl_c,
    'closed terminal': close_terminal,
    'kill': kill,
    'freeze': freeze,
}


@pytest.mark.parametrize('end', ENDS)
def test_carriage_stops_at_any_end_of_the_process(jog, end):
    def stops_in_time():
        made = jog()
        begun = time.monotonic()
        ENDS[end](made)
        wait_until(lambda: not made.moves, 'rest')
        elapsed = time.monotonic() - begun
        if end == 'Ctrl-C':
            made.read('Written into machine.yaml: nothing')
            assert 'confirmed that their power is off' in made.shown
        made.process.send_signal(signal.SIGCONT)
        made.process.kill()
        made.process.wait()
        assert elapsed < STOP_TIME, f'{1e3 * elapsed:.0f} ms'

    patiently(stops_in_time)
