"""docs/practise.md in processes: simulated drives, `commission`, and a user at both terminals."""

from multiprocessing import get_context
import os
import re
import shlex
import subprocess
import sys

from own_processes import SOURCE
import pytest
from stack import begun
from support import limited, patiently, wait_until

from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import config_path
from facade_manipulator.tools.commissioning.__main__ import main, STEPS
from facade_manipulator.tools.commissioning.procedure import Overlay

PAGE = (SOURCE / 'docs' / 'practise.md').read_text()
COMMISSION = 'ros2 run facade_manipulator commission'
SIMULATOR = 'ros2 run facade_manipulator drive_simulator'
PARKED = {'q1': -100.0, 'q2': 100.0, 'q3': -30.0}  # mm
# options by command that save half a minute
QUICK_MOTION = ['--speed', '50']
FASTER = {
    'assign': ['--lss-timeout', '0.03'],
    'jog': QUICK_MOTION,
    'lead': QUICK_MOTION,
}
COMMAND_LIMIT = 180.0  # s, of a command with its repetitions on a busy computer
SERIALS = {'4711': 'q1', '4712': 'q2', '4713': 'q3'}
# a question or a request of `commission`
ASKED = re.compile(
    r'(?P<agree>Do this\?)'
    r'|serial number (?P<serial>\d+) .*nothing\] '
    r'|(?P<push>Push the carriage)'
    r'|(?P<ruler>How many mm)'
)


def blocks():
    """Yield kind and lines of each block of the page; a block of commands has no kind."""
    for kind, block in re.findall(r'^ *```(\w*)\n(.*?)^ *```', PAGE, re.M | re.S):
        yield kind, [line.strip() for line in block.splitlines()]


def run_command(words: list[str], answers: int, screen: int, folder) -> None:
    """Run `commission` in a forked process, which needs no second import of the package."""
    os.chdir(folder)
    for descriptor, number in ((answers, 0), (screen, 1), (screen, 2)):
        os.dup2(descriptor, number)
    sys.stdin = open(0)
    sys.stdout = open(1, 'w', buffering=1)
    sys.stderr = open(2, 'w', buffering=1)
    sys.exit(main(words))


class Practice:
    """
    Simulated drives in terminal 1, `commission` in terminal 2, and the user of both.

    `shown` is the output of the last block of the page.
    """

    def __init__(self, bus, folder, start_process) -> None:
        self.shown = ''
        self._bus = bus
        self._folder = folder
        self._start_process = start_process
        self.overlay = Overlay(folder / 'machine.yaml')
        text = config_path('manipulator.yaml').read_text()
        text = text.replace('socketcan ', f'{bus.interface} ')
        text = text.replace('channel: can0', f'channel: {bus.channel}')
        (folder / 'manipulator.yaml').write_text(text)

    # --- blocks of the page

    def run(self, lines: list[str]) -> None:
        """Run the commands of a block; ROS commands are not part of this test."""
        self.shown = ''
        for line in lines:
            if line.startswith(SIMULATOR):
                self._start_drives(line.removeprefix(SIMULATOR).split())
            elif line.startswith(COMMISSION):
                self._try(line)

    def _try(self, line: str) -> None:
        """Run a command of the page; the first scan reports that all have one node id."""
        command, _, push = line.partition('  # when asked, in terminal 1: ')
        words = shlex.split(command.removeprefix(COMMISSION))
        words += FASTER.get(words[0], []) if words else []
        is_first = words == ['scan'] and not self.overlay.steps()
        places = {axis: self._place(axis) for axis in AXIS_NAMES}
        with limited(line, COMMAND_LIMIT):
            patiently(
                lambda: self._commission(words, push, int(is_first)),
                lambda: self._return_to(places),
            )

    def push(self, lines: list[str]) -> None:
        """Type the lines of a block in terminal 1; `…` is the way to the parking place."""
        self.shown = ''
        for line in lines:
            if line.endswith('…'):
                axis = line.split()[1]
                way = PARKED[axis] - self._place(axis)
                line = line.replace('…', f'{way:.1f}')
            self.shown += self._type(line)

    def check(self, lines: list[str]) -> None:
        """Compare the lines of the page with the output; `…` is any text."""
        for line in lines:
            pattern = '.*'.join(map(re.escape, line.split('…')))
            assert re.search(pattern, self.shown), f'{line!r} is not in\n{self.shown}'

    # --- terminal 1

    def _start_drives(self, words: list[str]) -> None:
        bus = self._bus
        bus_words = ('--interface', bus.interface, '--channel', bus.channel)
        self._drives = self._start_process(
            'facade_manipulator.simulation.drives',
            *words,
            *bus_words,
            stdin=subprocess.PIPE,
        )
        shown = begun(self._drives, 'ruler').log.read_text()
        self.shown = shown.replace(f'{bus.interface} {bus.channel}', 'socketcan vcan0')

    def _type(self, line: str) -> str:
        """Type a line in terminal 1; return the reply."""
        before = self._drives.log.read_text()
        self._drives.stdin.write(f'{line}\n'.encode())
        self._drives.stdin.flush()
        return wait_until(
            lambda: self._drives.log.read_text().removeprefix(before),
            f'the reply to {line}',
        )

    def _place(self, axis: str) -> float:
        """Return the place of a carriage by the ruler [mm]."""
        return float(re.search(rf'{axis} (\S+) mm', self._type('ruler'))[1])

    def _return_to(self, places: dict[str, float]) -> None:
        """Push the carriages back to their places [mm], so that a second try begins there."""
        for axis, place in places.items():
            way = place - self._place(axis)
            if abs(way) > 0.1:
                self._type(f'push {axis} {way:.1f}')

    # --- terminal 2

    def _commission(self, words: list[str], push: str, expected: int) -> None:
        """Run a command and do what it asks for; it must end with an exit status."""
        axis = next((word for word in words if word in AXIS_NAMES), 'q1')
        before = self._place(axis)
        answers, keyboard = os.pipe()
        screen, output = os.pipe()
        details = (words, answers, output, self._folder)
        process = get_context('fork').Process(target=run_command, args=details)
        process.start()
        os.close(answers)
        os.close(output)
        shown = ''
        answered = 0
        while data := os.read(screen, 4096):
            shown += data.decode()
            while asked := ASKED.search(shown, answered):
                answered = asked.end()
                if asked['push']:
                    self._type(push)
                else:
                    os.write(
                        keyboard, f'{self._answer(asked, axis, before)}\n'.encode()
                    )
        process.join()
        os.close(keyboard)
        os.close(screen)
        print(f'$ commission {shlex.join(words)}\n{shown}')
        assert process.exitcode == expected, shown
        self.shown += shown

    def _answer(self, asked: re.Match, axis: str, before: float) -> str:
        """Return the answer to a question, for an axis that was at a place before [mm]."""
        if asked['serial']:
            return SERIALS[asked['serial']]
        if asked['ruler']:
            return f'{self._place(axis) - before:.1f}'
        return 'y'


@pytest.mark.long
def test_practice_page_leads_to_a_commissioned_machine(bus, start_process, tmp_path):
    practice = Practice(bus, tmp_path, start_process)
    actions = {
        '': practice.run,
        'simulator': practice.push,
        'text': practice.check,
        'python': lambda _: None,  # needs nodes, as the commands of ROS do
    }
    for kind, lines in blocks():
        actions[kind](lines)
    assert practice.overlay.steps().keys() == {*STEPS, 'home-switch q3'}
