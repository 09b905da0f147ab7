"""
Procedure of every command: print the action, ask once, act, and write the result.

A `Context` keeps the parameter files, the operator at the terminal and the bus. The results are in
one file, `Overlay`, which nodes load after the parameter file.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
import re
import time
from typing import Any

import yaml

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.bus import CanBus, open_bus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.canopen.sdo import SdoChannel
from facade_manipulator.drives.axis_settings import AxisSettings, check_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import decode_state, POWERED_STATES
from facade_manipulator.errors import CommissioningError, DriveError, ParameterError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.package_files import (
    atomic_write,
    MACHINE_FILE,
    machine_files,
    overlay_of,
)
from facade_manipulator.parameters import ParameterSource, read_value
from facade_manipulator.tools.commissioning.tool_bus import ToolBus
from facade_manipulator.tools.parameter_files import read_machine
from facade_manipulator.tools.stopping import read_analysis


class Overlay:
    """Parameter file with driver parameters, and the time of each completed commissioning step."""

    HEADER = (
        '# Written by `commission`; nodes load this file after the parameter file of the '
        'machine.'
    )

    def __init__(self, path: Path) -> None:
        self.path = path

    def steps(self) -> dict[str, str]:
        """Return the time of each completed step, by the words of its command."""
        return dict(re.findall('^# done: (.+) at (.+)$', self._text(), re.MULTILINE))

    def write(
        self, step: str, results: Mapping[str, Any], is_done: bool = True
    ) -> None:
        """
        Write driver parameters by full name, and record whether a step is complete.

        The file is valid, because each command reads it first.
        """
        steps = self.steps()
        steps.pop(step, None)
        if is_done:
            steps[step] = time.strftime('%Y-%m-%d %H:%M')
        content = self._content()
        for name, value in results.items():
            group, _, key = name.partition('.')
            driver = content.setdefault('/**/driver', {}).setdefault(
                'ros__parameters', {}
            )
            driver.setdefault(group, {})[key] = value
        self._save(steps, content)

    def undo(self, names: Collection[str]) -> list[str]:
        """Record that steps are no longer complete; return those that were complete."""
        steps = self.steps()
        undone = [name for name in names if name in steps]
        if undone:
            left = {name: when for name, when in steps.items() if name not in undone}
            self._save(left, self._content())
        return undone

    def _save(self, steps: Mapping[str, str], content: Mapping[str, Any]) -> None:
        done = [f'# done: {name} at {when}' for name, when in steps.items()]
        text = yaml.safe_dump(content, sort_keys=False) if content else ''
        with atomic_write(self.path) as draft:
            draft.write_text('\n'.join([self.HEADER, *done, text]), 'utf-8')

    def _content(self) -> dict[str, Any]:
        """Return the sections of the file."""
        return read_value(self._text()) or {}

    def _text(self) -> str:
        return self.path.read_text('utf-8', 'replace') if self.path.exists() else ''


class Context:
    """Context of a command: machine, operator and options; tests pass a bus and a clock."""

    def __init__(
        self,
        options: argparse.Namespace,
        open_frames: Callable[[BusSettings], CanBus] = lambda one: CanBus(
            open_bus(one)
        ),
        clock: Clock | None = None,
    ) -> None:
        self.options = options
        self.clock = clock or Clock()
        self._open_frames = open_frames
        self.overlay = Overlay(overlay_of(options.parameters or MACHINE_FILE))
        self.written = 'nothing'  #: results that the command wrote into the overlay
        self.state = ''  #: state of the drives if the command ended at present
        self._has_agreed = options.yes

    # --- parameters

    @property
    def files(self) -> list[Path]:
        """Return the machine's parameter files; later files override earlier files."""
        return machine_files(
            [self.options.parameters] if self.options.parameters else []
        )

    @property
    def controller(self) -> ControllerSettings:
        """Return the controller settings; raise a ParameterError if they are invalid."""
        return read_analysis(self.files).controller

    @property
    def axes(self) -> dict[str, AxisSettings]:
        """Return the axis settings by name, in drive units; raise a ParameterError if invalid."""
        axes = read_analysis(self.files).axes
        check_axes(axes)
        return {
            name: load_profile(axis.profile).applied(axis)
            for name, axis in zip(AXIS_NAMES, axes, strict=True)
        }

    def begin(self, step: str) -> None:
        """Record that a repeated step is not complete until it succeeds again."""
        if self.overlay.undo([step]):
            self.written = f'{step}: no longer done'

    def record(
        self, step: str, results: Mapping[str, Any], problems: Sequence[str] = ()
    ) -> None:
        """
        Write results and the completed step into the overlay, and print them.

        Raises a CommissioningError with the problems of the step. Raises a ParameterError if the
        overlay cannot be written or the user's own file overrides it; the step is then not done.
        """
        if problems:
            raise CommissioningError('\n! '.join([f'{step} found problems', *problems]))
        self.overlay.write(step, results, is_done=False)
        self.written = ', '.join(
            f'{name}: {value}' for name, value in results.items()
        ) or (f'{step}: done')
        effective = read_machine(self.files, 'driver')
        for name, value in results.items():
            if effective[name] != value:
                raise ParameterError(
                    f'{name}: {value} has no effect: {self.files[0]} overrides it for one '
                    'namespace; next: remove the parameter from that file'
                )
        self.overlay.write(step, {})
        print(f'{self.overlay.path} gets {self.written}')

    # --- the operator

    def agree(self, action: str) -> None:
        """Print the action and ask once; raise a CommissioningError unless the answer is yes."""
        print(action)
        self._has_agreed = self._has_agreed or self.ask('Do this? [y/N]', '--yes') in (
            'y',
            'yes',
        )
        if not self._has_agreed:
            raise CommissioningError('nothing was done: the answer was not yes')

    def ask(self, question: str, option: str) -> str:
        """Return the operator's answer, or raise an error that names the replacing option."""
        with suppress(EOFError):
            if not self.options.yes:
                return input(f'{question} ').strip()
        raise CommissioningError(f'no answer to "{question}"; next: set {option}')

    # --- the bus

    def open(self) -> CanBus:
        """Open the machine's bus; raise a BusError if this fails."""
        source = ParameterSource(read_machine(self.files, 'driver'))
        return self._open_frames(source.read(BusSettings, 'bus'))

    @contextmanager
    def bus(self) -> Iterator[ToolBus]:
        """Yield the bus, or raise a BusError or a DriveStateError if it has another master."""
        bus = ToolBus(self.open(), self.clock)
        try:
            bus.require_alone()
            yield bus
        finally:
            bus.frames.close()

    @contextmanager
    def drive(
        self, name: str, eds: Path | None = None
    ) -> Iterator[tuple[ToolBus, SdoChannel]]:
        """
        Yield the bus, and the objects of an axis's drive.

        Raises a CommissioningError if the drive has power, a DriveError unless exactly one drive
        answers.
        """
        node_id = self.axes[name].node_id
        with self.bus() as bus:
            answers = bus.serial_numbers([node_id])[node_id]
            if len(answers) > 1:
                raise DriveError(
                    f'{name} rejected: {len(answers)} drives answer as node {node_id}; next: '
                    'commission assign'
                )
            drive = bus.objects(node_id, name, eds)
            state = decode_state(bus.run(drive.read_number(indices.STATUSWORD)))
            if state is None or state in POWERED_STATES:
                shown = state.value if state else 'an unknown statusword'
                raise CommissioningError(
                    f'{name} rejected: its drive has power ({shown}); next: end the program '
                    'that commands the drive'
                )
            yield bus, drive
