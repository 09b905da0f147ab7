"""Parameter files, the operator at the terminal and the bus, for every command."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator.canopen.bus import CanBus
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.link import BusSettings, open_bus
from facade_manipulator.canopen.sdo import SdoChannel
from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, check_axes, read_axes
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import decode_state, POWERED_STATES
from facade_manipulator.errors import CommissioningError, DriveIdentityError, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.resources import MACHINE_FILE, machine_file
from facade_manipulator.tools.commissioning.bus import ToolBus
from facade_manipulator.tools.commissioning.overlay import described, Overlay

OVERLAY = 'machine.yaml'
STATUSWORD = 0x6041
Settings = TypeVar('Settings')


class Context:
    """The machine, the operator and the options of a command; a test hands in bus and clock."""

    def __init__(
        self, options: argparse.Namespace,
        open_frames: Callable[[BusSettings], CanBus] = lambda one: CanBus(open_bus(one)),
        clock: Clock | None = None,
    ) -> None:
        self.options = options
        self.clock = clock or Clock()
        self._open_frames = open_frames
        self.overlay = Overlay((options.parameters or MACHINE_FILE).with_name(OVERLAY))
        self._own_file = options.parameters or machine_file()
        self.written: list[str] = []  #: into the overlay by the command
        self.state = ''  #: of the drives, if the command ended now
        self._has_agreed = options.yes

    # --- parameters

    @property
    def files(self) -> list[Path]:
        """The parameter files of the machine; later ones override earlier ones."""
        return [self._own_file, *([self.overlay.path] if self.overlay.path.exists() else [])]

    def settings(self, section: str, kind: type[Settings], **defaults: Any) -> Settings:
        """Return settings of the driver as it would read them; raises a ParameterError."""
        try:
            return settings_from(kind, read_parameters(self.files, 'driver'), section, **defaults)
        except ParameterError as error:
            raise ParameterError(f'{section} of {self._own_file} rejected: {error}') from error

    @property
    def axes(self) -> dict[str, AxisSettings]:
        """Settings of the axes by name, in the units of their drives; raises a ParameterError."""
        stroke = self.settings('geometry', Geometry).stroke
        axes = read_axes(
            lambda kind, prefix, **others: self.settings(prefix, kind, **others), stroke)
        check_axes(axes)
        return {name: load_profile(axis.profile).applied(axis)
                for name, axis in zip(AXIS_NAMES, axes, strict=True)}

    def record(self, step: str, **sections: dict[str, Any]) -> None:
        """
        Print parameters and a step, then write them into the overlay.

        Raises a ParameterError if that fails, or the user's own file overrides them.
        """
        text = described(sections) or f'{step}: done'
        print(f'{self.overlay.path} gets {text}')
        self.overlay.write(step, sections)
        self.written.append(text)
        effective = read_parameters(self.files, 'driver')
        for section, values in sections.items():
            for name, value in values.items():
                if effective[f'{section}.{name}'] != value:
                    raise ParameterError(
                        f'{section}.{name}: {value} has no effect: {self._own_file} overrides it '
                        'for one namespace; next: remove it there')

    # --- the operator

    def agree(self, action: str) -> None:
        """Print the action, and ask once; a CommissioningError for any answer but yes."""
        print(action)
        self._has_agreed = self._has_agreed or self.ask('Do this? [y/N]', '--yes') in ('y', 'yes')
        if not self._has_agreed:
            raise CommissioningError('nothing was done: the answer was not yes')

    def ask(self, question: str, option: str) -> str:
        """Return the operator's answer; a CommissioningError names the option to give instead."""
        try:
            if not self.options.yes:
                return input(f'{question} ').strip()
        except EOFError:
            pass
        raise CommissioningError(f'no answer to "{question}"; next: set {option}')

    # --- the bus

    def open(self) -> CanBus:
        """Open the bus of the machine; raises a BusError."""
        given = {name: value for name in ('interface', 'channel')
                 if (value := getattr(self.options, name))}
        return self._open_frames(replace(self.settings('bus', BusSettings), **given))

    @contextmanager
    def bus(self) -> Iterator[ToolBus]:
        """Lend the bus, on which no other master is; raises a BusError or a DriveStateError."""
        bus = ToolBus(self.open(), self.clock)
        try:
            bus.require_alone()
            yield bus
        finally:
            bus.frames.close()

    def drive(self, bus: ToolBus, name: str, eds: Path | None = None) -> SdoChannel:
        """
        Return the objects of an axis's drive.

        Raises a CommissioningError if it has power, a DriveError if none or more than one answers.
        """
        node_id = self.axes[name].node_id
        drive, answers = bus.objects(node_id, name, eds), bus.serial_numbers([node_id])[node_id]
        if len(answers) > 1:
            raise DriveIdentityError(
                f'{name} rejected: {len(answers)} drives answer as node {node_id}; next: '
                'commission assign')
        state = decode_state(drive.read_number(STATUSWORD))
        if state is None or state in POWERED_STATES:
            shown = 'a statusword of no state' if state is None else state.value
            raise CommissioningError(
                f'{name} rejected: its drive has power ({shown}); next: switch it off')
        return drive


def table(rows: Iterable[Iterable[object]]) -> None:
    """Print rows in columns; None is an empty cell."""
    cells = [['' if cell is None else str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        line = '  '.join(f'{cell:{width}}' for cell, width in zip(row, widths, strict=True))
        print(line.rstrip())
