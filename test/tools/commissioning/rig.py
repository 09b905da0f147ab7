"""Rig of the tool `commission`: three new drives on a fake bus, and a technician."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re
from types import SimpleNamespace

from fake_bus import BusWorld
import yaml

from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import config_path
from facade_manipulator.parameters import read_parameters
from facade_manipulator.simulation.drives.__main__ import _parser, make_drives
from facade_manipulator.tools.commissioning import carriage_measurements
from facade_manipulator.tools.commissioning.__main__ import main
from facade_manipulator.tools.commissioning.procedure import Overlay

SERIALS = (4711, 4712, 4713)


class CommissionRig(BusWorld):
    """
    Simulated drives made from the options of `drive_simulator`; `run` is `commission`.

    Simulated time passes while the tool waits. `answers` has the replies or actions of the
    technician by a pattern of the question.
    """

    def __init__(self, folder: Path, monkeypatch, *options: str) -> None:
        super().__init__(make_drives(_parser().parse_args(options)))
        self.folder = folder
        self.overlay = Overlay(folder / 'machine.yaml')
        self.answers: dict[str, Callable[[re.Match], str] | str] = {}
        self.questions: list[str] = []
        monkeypatch.chdir(folder)
        monkeypatch.setattr('builtins.input', self._answer)
        # m/s, twice the speed of the tool: half the cycles for an edge that is 0.1 mm less sharp
        monkeypatch.setattr(carriage_measurements, '_APPROACH', 1e-3)
        # the library's pauses between two questions
        monkeypatch.setattr('canopen.lss.time', SimpleNamespace(sleep=self.pass_time))
        self.power_cut()

    def power_cut(self) -> None:
        """Switch the drives off and on, and wait until they have booted."""
        super().power_cut()
        self.pass_time(0.5)

    # --- the tool

    def run(self, *arguments: str, yes: bool = True) -> int:
        """Run a command; return its exit status."""
        words = [*arguments, *(['--yes'] if yes else [])]
        return main(words, open_frames=self.open_bus, clock=self.clock)

    def _answer(self, question: str) -> str:
        self.questions.append(question)
        print(question)
        for pattern, answer in self.answers.items():
            if match := re.search(pattern, question):
                return answer(match) if callable(answer) else answer
        return 'y'

    def configured(
        self, profile: str = 'simulated', is_moving: bool = True, **others: object
    ) -> CommissionRig:
        """Write an overlay for drives that have their node ids, and may move."""
        values = {'axes.profile': profile}
        for name, drive in zip(AXIS_NAMES, self.drives, strict=True):
            values[f'{name}.node_id'] = drive.node_id
        self.overlay.write('assign', values | others)
        for name in AXIS_NAMES if is_moving else ():
            self.overlay.write(f'direction {name}', {})
        return self

    def push(self, number: int, after: float) -> None:
        """Push a carriage to the right by a centimetre after a time [s]."""
        motor = self.drives[number].motor
        self.later(after, lambda: motor.place(motor.carriage_position + 0.01))

    # --- what a test looks at

    @property
    def parameters(self) -> dict[str, object]:
        """Return the parameters in the overlay."""
        return read_parameters([self.overlay.path], 'driver')

    @property
    def places(self) -> list[float]:
        """Return the positions of the carriages [m]."""
        return [drive.motor.carriage_position for drive in self.drives]

    @property
    def is_powered(self) -> bool:
        """Return whether a drive has power."""
        return any(drive.axis.is_moving for drive in self.drives)


def raising(error):
    """Return a function that raises an error, whatever its arguments."""

    def act(*_):
        raise error

    return act


def own_profile(folder, without=0, **changes):
    """Write a drive profile with changes and without an object; return its path."""
    data = yaml.safe_load(config_path('drives/simulated.yaml').read_text())
    data['objects'] = [one for one in data['objects'] if one['index'] != without]
    eds = str(config_path('drives/cia402.eds'))
    path = folder / 'own.yaml'
    path.write_text(yaml.safe_dump(data | {'eds': eds} | changes))
    return str(path)
