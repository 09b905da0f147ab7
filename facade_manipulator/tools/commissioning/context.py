"""What every command works with: the machine, the operator, the options and the bus."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from facade_manipulator.tools.commissioning.bus import ToolBus
from facade_manipulator.tools.commissioning.machine import Machine
from facade_manipulator.tools.commissioning.operator import Operator


@dataclass(frozen=True)
class Context:
    """A command's machine, operator and options."""

    machine: Machine
    operator: Operator
    options: argparse.Namespace

    def offer(self, section: str, **values: Any) -> None:
        """Show the line to write into the parameter file, ask, and write it."""
        lines = ', '.join(f'{section}.{name}: {value}' for name, value in values.items())
        self.operator.agree(f'{self.machine.path} gets {lines}')
        self.machine.write({section: values})

    @contextmanager
    def bus(self) -> Iterator[ToolBus]:
        """Lend the bus, on which no driver runs; raises a BusError or DriveStateError."""
        options = self.options
        settings = self.machine.bus(
            interface=options.interface, channel=options.channel, bitrate=options.bitrate)
        with ToolBus(settings) as bus:
            bus.require_alone()
            yield bus
