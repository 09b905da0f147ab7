"""docs/commissioning.md word by word: three drives from the box become a machine that homes."""

from __future__ import annotations

import os
from pathlib import Path
import re
import shlex
import threading
import time

import can
from commission_rig import SERIALS
from drive_rig import SETTINGS
import pytest
from support import wait_until

import facade_manipulator
from facade_manipulator.drives.cia402.states import State
from facade_manipulator.drives.controller import BusAccess
from facade_manipulator.kinematics import Geometry
from facade_manipulator.loop import assemble, LoopSetup
from facade_manipulator.tools.commissioning import Machine
from facade_manipulator.tools.commissioning.__main__ import main
from facade_manipulator.tools.commissioning.operator import Operator

DOCUMENT = Path(facade_manipulator.__file__).parents[1] / 'docs' / 'commissioning.md'
PREFIX = 'ros2 run facade_manipulator commission '
AXES = ('q1', 'q2', 'q3')
FORCE = 30.0  # N
NEW = ('--new', '--directions', '1', '-1', '1', '--leads', '0.02', '0.02', '0.01',
       '--start-positions', '-0.1', '0.1', '-0.05', '--viscous-friction', '20')
OPEN = {'scan': 1, 'compare': 1}  # exit status of the first of these commands


def steps(text):
    """Yield the commands of each block and the lines that the block after it promises."""
    blocks = re.findall(r'```\n((?:ros2 run facade_manipulator commission [^\n]*\n)+)```\n\n'
                        r'```text\n(.*?)```', text, re.DOTALL)
    for commands, expected in blocks:
        yield ([line.removeprefix(PREFIX) for line in commands.splitlines()],
               expected.splitlines())


class Technician:
    """Whoever does what the tool asks: answers, pushes carriages, reads the ruler, holds keys."""

    def __init__(self, rig, monkeypatch) -> None:
        self.rig = rig
        self.axis = 0
        self._mark = 0.0
        self._keys, self._hand = os.pipe()
        monkeypatch.setattr('sys.stdin', os.fdopen(self._keys, 'rb', closefd=False))
        say = Operator.say

        def listen(operator, text=''):
            say(operator, text)
            self._act(text)

        monkeypatch.setattr(Operator, 'say', listen)
        monkeypatch.setattr(Operator, '_answer', lambda operator, question: self._answer(question))

    def close(self) -> None:
        os.close(self._keys)
        os.close(self._hand)

    @property
    def place(self) -> float:
        with self.rig.simulator.access() as drives:
            return drives[self.axis].motor.carriage_position

    def _act(self, text: str) -> None:
        if text.startswith('Mark'):
            self._mark = self.place
        elif 'Push its carriage' in text:
            threading.Thread(target=self._push).start()
        elif text.startswith('Hold'):
            threading.Thread(target=self._hold).start()

    def _push(self) -> None:
        with self.rig.simulator.access() as drives:
            motor = drives[self.axis].motor
            motor.place(motor.carriage_position + 0.01)

    def _hold(self) -> None:
        start = self.place
        wait_until(lambda: os.write(self._hand, b'd') and abs(self.place - start) > 0.002,
                   'motion', step=lambda: time.sleep(0.03))
        os.write(self._hand, b'q')

    def _answer(self, question: str) -> str:
        if 'serial number' in question:
            serial = int(re.search(r'serial number (\d+)', question).group(1))
            return AXES[SERIALS.index(serial)]
        if 'coupled' in question:
            return 'uncoupled'
        if 'How many mm' in question:
            return f'{1e3 * (self.place - self._mark):.2f}'
        return 'y'


@pytest.fixture
def rig(make_rig, monkeypatch):
    made = make_rig(*NEW)
    monkeypatch.chdir(made.folder)
    with made.simulator.access() as drives:  # somebody has changed and stored an object
        drives[1].objects.stored[0x6084, 0] = 12345
    made.power_cut()
    return made


@pytest.mark.long
def test_the_document_makes_a_machine_that_homes_and_holds(rig, monkeypatch, capsys):
    technician = Technician(rig, monkeypatch)
    known = list(steps(DOCUMENT.read_text()))
    assert len(known) >= 10
    first = dict(OPEN)
    for commands, expected in known:
        said = ''
        for command in commands:
            name, *rest = words = shlex.split(command)
            technician.axis = AXES.index(rest[0]) if rest and rest[0] in AXES else 0
            status = main([*words, '--interface', 'virtual', '--channel', rig.channel])
            output = capsys.readouterr()
            assert status == first.pop(name, 0), f'{command}: {output.out}{output.err}'
            said += output.out
        for line in expected:
            assert line in said, f'{commands}: {line!r} is not in\n{said}'
    technician.close()

    machine = Machine(Path('machine.yaml'))
    axes = machine.axes
    assert [axis.direction for axis in axes.values()] == [1, -1, 1]
    assert [axis.lead for axis in axes.values()] == pytest.approx([0.02, 0.02, 0.01], rel=2e-3)
    assert [axis.serial_number for axis in axes.values()] == list(SERIALS)
    assert rig.drives[1].objects.values[0x6084, 0] != 12345
    homes_and_holds(rig, tuple(axes.values()))


def homes_and_holds(rig, axes) -> None:
    _, controller = assemble(LoopSetup(Geometry(), SETTINGS, axes), BusAccess(
        lambda: can.Bus(interface='virtual', channel=rig.channel)))
    try:
        for name in ('configure', 'home', 'activate'):
            controller.request(name).result(60.0)
        with rig.simulator.access() as drives:
            before = [drive.motor.carriage_position for drive in drives]
            for drive in drives:
                drive.motor.external_force = FORCE
        time.sleep(0.5)
        with rig.simulator.access() as drives:
            after = [drive.motor.carriage_position for drive in drives]
            assert {drive.state for drive in drives} == {State.OPERATION_ENABLED}
            forces = [abs(drive._scale.to_force(drive.motor.torque)) for drive in drives]
        assert after == pytest.approx(before, abs=1e-3)
        # what is pushed back passes gear and screw the other way round, with their efficiency
        assert min(forces) > 0.5 * FORCE, forces
    finally:
        controller.close()
