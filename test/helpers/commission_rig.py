"""Three new drives on a virtual bus, and the tool `commission` in the test's own process."""

from __future__ import annotations

from collections.abc import Callable
import itertools
import os
from pathlib import Path
import pty
import sys
import termios
from typing import Any

import can
from support import wait_until

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.canopen.nmt import NmtState
from facade_manipulator.drives.states import State
from facade_manipulator.simulation.drives.__main__ import _parser, make_drives
from facade_manipulator.simulation.drives.simulator import DriveSimulator
from facade_manipulator.tools.commissioning.__main__ import main
from facade_manipulator.tools.commissioning.machine import Machine

_numbers = itertools.count()
SERIALS = (4711, 4712, 4713)


class Terminal:
    """A terminal of 80 columns; who sits at it reads what is new on it, and types."""

    def __init__(self, monkeypatch, read: Callable[[str], None] = lambda text: None) -> None:
        self._ours, its = pty.openpty()
        termios.tcsetwinsize(its, (24, 80))
        self._keys, self._screen = os.fdopen(os.dup(its), 'r'), os.fdopen(its, 'w')
        self._read = read
        self.shown = ''
        monkeypatch.setattr(sys, 'stdin', self._keys)
        monkeypatch.setattr(sys, 'stdout', self)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._screen, name)

    def type(self, text: str) -> None:
        os.write(self._ours, text.encode())

    def write(self, text: str) -> int:
        """Show a text, with what was typed before."""
        for line in text.splitlines(keepends=True):
            self._screen.write(line)
            self._screen.flush()
            new = b''
            while line.rstrip('\n').encode() not in new or not new:  # all of it, and echoes
                new += os.read(self._ours, 1 << 16)
            self.shown += new.decode().replace('\r', '')
            self._read(new.decode())
        return len(text)

    def hang_up(self) -> None:
        for file in (self._keys, self._screen):
            file.close()
        os.close(self._ours)


class CommissionRig:
    """Simulated drives made from the options of `drive_simulator`; `run` is `commission`."""

    def __init__(self, folder: Path, *options: str, bus: BusSettings | None = None) -> None:
        self.folder = folder
        self.parameters = folder / 'machine.yaml'
        bus = bus or BusSettings(channel=f'commission {next(_numbers)}')
        self.interface, self.channel = bus.interface, bus.channel
        self.drives = make_drives(_parser().parse_args(options))
        self.simulator = DriveSimulator(
            lambda: can.Bus(
                interface=bus.interface, channel=bus.channel, ignore_config=True), self.drives)
        self.simulator.start()
        try:
            wait_until(lambda: all(
                drive.nmt_state is not NmtState.INITIALISING or drive.node_id == 255
                for drive in self.drives), 'drives that are on')
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self.simulator.stop()

    def run(self, *arguments: str, yes: bool = True) -> int:
        """Run a command; return its exit status."""
        return main(self.command(*arguments, yes=yes))

    def command(self, *arguments: str, yes: bool = True) -> list[str]:
        """Return the arguments of `commission` for this bus and parameter file."""
        command, *others = arguments
        return [command, '--interface', self.interface, '--channel', self.channel,
                '--parameters', str(self.parameters), *(['--yes'] if yes else []), *others]

    def moves(self, number: int = 0) -> bool:
        """Return whether a carriage moves."""
        with self.simulator.access() as drives:
            return abs(drives[number].motor.velocity) > 5.0  # counts/s

    def is_enabled(self, number: int = 0) -> bool:
        """Return whether a drive would follow targets."""
        return self.drives[number].state is State.OPERATION_ENABLED

    def configured(self, profile: str = 'simulated', **axes: dict) -> CommissionRig:
        """Write a parameter file for drives that have their node ids."""
        sections = {
            name: {'node_id': drive.node_id, 'profile': profile, **axes.get(name, {})}
            for name, drive in zip(('q1', 'q2', 'q3'), self.drives, strict=True)}
        Machine(self.parameters).write(sections)
        return self

    def power_cut(self) -> None:
        with self.simulator.access() as drives:
            for drive in drives:
                drive.reboot()
        wait_until(lambda: all(drive.nmt_state is not NmtState.INITIALISING
                               for drive in self.drives), 'drives that are on again')
