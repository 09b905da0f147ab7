"""docs/commissioning.md, command by command at a terminal: from the box to the whole stroke."""

from __future__ import annotations

from contextlib import ExitStack
import math
from pathlib import Path
import re
import shlex
import threading
import time

import can
from commission_rig import SERIALS
from drive_parts import Source
from loop_bench import CONTROLLER as SETTINGS
import pytest
from support import wait_until

import facade_manipulator
from facade_manipulator.canopen.bus import can_bus
from facade_manipulator.control_loop.control_loop import assemble, LoopSetup
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.session import BusAccess, Session
from facade_manipulator.drives.states import State
from facade_manipulator.drives.targets import MechanismChecks
from facade_manipulator.kinematics import Geometry
from facade_manipulator.simulation.drives.drive import SimulatedIdentity
from facade_manipulator.tools.commissioning.__main__ import main
from facade_manipulator.tools.commissioning.machine import Machine

DOCUMENT = Path(facade_manipulator.__file__).parents[1] / 'docs' / 'commissioning.md'
PREFIX = 'ros2 run facade_manipulator commission '
AXES = ('q1', 'q2', 'q3')
FORCE, SWEEP = 30.0, 0.37  # N, m
NEW = ('--new', '--directions', '1', '-1', '1', '--leads', '0.02', '0.02', '0.01',
       '--start-positions', '-0.1', '0.1', '-0.05')
# exit status of the first of these commands; of the simulated drives nothing blinks
OPEN = {'scan': 1, 'compare': 1, 'identify': 1}


def steps(text):
    """Yield the commands of each block and the lines that the block after it promises."""
    blocks = re.findall(r'```\n((?:ros2 run facade_manipulator commission [^\n]*\n)+)```\n'
                        r'(?:\n```text\n(.*?)```)?', text, re.DOTALL)
    for commands, expected in blocks:
        yield ([line.removeprefix(PREFIX) for line in commands.splitlines()],
               expected.splitlines())


class Technician:
    """Whoever does what the tool asks: answers, pushes carriages, reads the ruler, holds keys."""

    def __init__(self, rig, sit) -> None:
        self.rig, self.axis = rig, 0
        self.terminal = sit(self.read)
        self._mark = 0.0
        self._answers = {
            r'Do this\? \[y/N\] ': lambda _: 'y\n',
            r'\[coupled/uncoupled\] ': lambda _: 'uncoupled\n',
            r'serial number (\d+) .*nothing\] ': self._carriage,
            r'Mark where': self._remember,
            r'How many mm by the ruler\? ': lambda _: f'{1e3 * (self.place - self._mark):.2f}\n',
            r'Push its carriage': lambda _: self._start(self._push),
            r'q ends': lambda _: self._start(self._hold),
        }
        self._unread = ''

    @property
    def place(self) -> float:
        return self.rig.drives[self.axis].motor.carriage_position

    def read(self, text: str) -> None:
        self._unread += text
        for pattern, answer in self._answers.items():
            if match := re.search(pattern, self._unread.replace('\r\n', ' ')):
                self._unread = ''
                self.terminal.type(answer(match) or '')

    def _carriage(self, match) -> str:
        return AXES[SERIALS.index(int(match[1]))] + '\n'

    def _remember(self, _) -> None:
        self._mark = self.place

    def _start(self, action) -> None:
        threading.Thread(target=action).start()

    def _push(self) -> None:
        with self.rig.simulator.access() as drives:
            motor = drives[self.axis].motor
            motor.place(motor.carriage_position + 0.01)

    def _hold(self) -> None:
        start = self.place
        wait_until(lambda: self.terminal.type('d') or abs(self.place - start) > 0.002,
                   'motion', step=lambda: time.sleep(0.03))
        self.terminal.type('q')


@pytest.fixture
def rig(make_rig, monkeypatch):
    made = make_rig(*NEW)
    monkeypatch.chdir(made.folder)
    Machine(made.parameters).write({'bus': {'interface': 'virtual', 'channel': made.channel}})
    with made.simulator.access() as drives:  # somebody has changed and stored an object
        drives[1].objects.stored[0x6084, 0] = 12345
    made.power_cut()
    return made


@pytest.mark.long
def test_the_document_makes_a_machine_that_homes_holds_and_moves(rig, sit, capsys):
    technician = Technician(rig, sit)
    known = list(steps(DOCUMENT.read_text()))
    assert sum(len(commands) for commands, _ in known) >= 25
    first = dict(OPEN)
    for commands, expected in known:
        before = len(technician.terminal.shown)
        for command in commands:
            name, *rest = words = shlex.split(command)
            technician.axis = AXES.index(rest[0]) if rest and rest[0] in AXES else 0
            if name == 'replace':
                exchange(rig, technician.axis)
            status = main(words)
            assert status == first.pop(name, 0), (
                f'{command}: {technician.terminal.shown[before:]}{capsys.readouterr().err}')
        said = technician.terminal.shown[before:]
        for line in expected:
            pattern = '.*'.join(map(re.escape, line.split('…')))
            assert re.search(f'^{pattern}$', said, re.MULTILINE), (
                f'{commands}: {line!r} is not in\n{said}')

    axes = Machine(Path('machine.yaml')).axes
    assert [axis.direction for axis in axes.values()] == [1, -1, 1]
    assert [axis.lead for axis in axes.values()] == pytest.approx([0.02, 0.02, 0.01], rel=2e-3)
    assert [axis.serial_number for axis in axes.values()] == [SERIALS[0], 99, SERIALS[2]]
    assert rig.drives[1].objects.values[0x6084, 0] != 12345
    homes_holds_and_moves(rig, tuple(axes.values()))


def exchange(rig, number) -> None:
    """Put a drive from the box in the place of another."""
    with rig.simulator.access() as drives:
        drives[number].set_identity(SimulatedIdentity(serial_number=99))
        drives[number].objects.stored.clear()
        drives[number].lss.stored = 1
        drives[number].reboot()


def homes_holds_and_moves(rig, axes) -> None:
    """Hold with the product's own wiring, then sweep from rest to both ends of the stroke."""
    access = BusAccess(
        lambda: can_bus(can.Bus(interface='virtual', channel=rig.channel, ignore_config=True)))
    with rig.simulator.access() as drives:  # parked, as *Home* says; q3 looks for its switch
        for drive, place in zip(drives, (-0.1, 0.1, -0.05), strict=True):
            drive.motor.place(place)

    def places():
        with rig.simulator.access() as drives:
            assert {drive.state for drive in drives} == {State.OPERATION_ENABLED}
            return [drive.motor.carriage_position for drive in drives]

    def push(force):
        with rig.simulator.access() as drives:
            for drive in drives:
                drive.motor.external_force = force
        time.sleep(0.5)

    def powered(controller):
        controller.start()
        stack.callback(controller.close)
        for name in ('configure', 'home', 'activate'):
            controller.request(name).result(60.0)
        return places()

    with ExitStack() as stack:
        before = powered(assemble(LoopSetup(Geometry(), SETTINGS, axes), access)[1])
        push(FORCE)
        assert places() == pytest.approx(before, abs=1e-3)
        with rig.simulator.access() as drives:
            assert min(abs(drive.motor.torque * drive._scale.force_per_torque_unit)
                       for drive in drives) > 0.5 * FORCE
        push(0.0)
    source = Source()
    with ExitStack() as stack:
        before = powered(DriveController(Session(SETTINGS, axes, access, MechanismChecks(source))))
        source.time, source.distort = 0.0, lambda positions: tuple(
            one + SWEEP * math.sin(0.5 * source.time)**3 for one in positions)
        source.speed = 1e-9  # so that it is not at rest
        seen = [places()]
        while source.time < 4.0 * math.pi:
            time.sleep(0.05)
            seen.append(places())
    ends = [abs(end - place) for end, place in zip(
        (*map(min, zip(*seen, strict=True)), *map(max, zip(*seen, strict=True))), 2 * before,
        strict=True)]
    assert ends == pytest.approx([SWEEP] * 6, abs=0.01)
