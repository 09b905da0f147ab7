"""Three new drives on a virtual bus, and the tool `commission` in the test's own process."""

from __future__ import annotations

import itertools
from pathlib import Path

import can
from support import wait_until

from facade_manipulator.commissioning import Machine
from facade_manipulator.commissioning.__main__ import main
from facade_manipulator.drives.canopen.nmt import NmtState
from facade_manipulator.drives.simulated.__main__ import _parser, make_drives
from facade_manipulator.drives.simulated.simulator import DriveSimulator

_numbers = itertools.count()
SERIALS = (4711, 4712, 4713)


class CommissionRig:
    """Simulated drives made from the options of `drive_simulator`; `run` is `commission`."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        self.parameters = folder / 'machine.yaml'
        self.channel = f'commission {next(_numbers)}'
        self._bus = can.Bus(interface='virtual', channel=self.channel)
        self.drives = make_drives(_parser().parse_args(options))
        self.simulator = DriveSimulator(self._bus, self.drives)
        self.simulator.start()
        wait_until(lambda: all(
            drive.nmt_state is not NmtState.INITIALISING or drive.node_id == 255
            for drive in self.drives), 'drives that are on')

    def close(self) -> None:
        self.simulator.stop()
        self._bus.shutdown()

    def run(self, *arguments: str, yes: bool = True) -> int:
        """Run a command; return its exit status."""
        command, *others = arguments
        return main([command, '--interface', 'virtual', '--channel', self.channel,
                     '--parameters', str(self.parameters), *(['--yes'] if yes else []), *others])

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
