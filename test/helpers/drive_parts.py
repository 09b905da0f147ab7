"""Targets and drive types that a test of the drives makes up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import yaml

from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.resources import config_path

PERIOD = 0.01  # s


class Source:
    """Targets that move at a constant speed from where they were reset."""

    def __init__(self) -> None:
        self.speed = 0.0
        self.distort = None
        self.positions = None
        self.held = False

    @property
    def at_rest(self) -> bool:
        return self.held or self.speed == 0.0

    def reset(self, positions) -> None:
        self.positions, self.held = positions, False

    def hold(self) -> None:
        self.held = True

    def wait(self, seconds: float) -> None:
        """Go on at once."""

    def sample(self, latch_time: float):
        if not self.held:
            self.positions = tuple(q + self.speed * PERIOD for q in self.positions)
        return self.distort(self.positions) if self.distort else self.positions


def axes_with(directory: Path, base: str = 'simulated', **changes) -> tuple[AxisSettings, ...]:
    """Return axes whose drive type is one of the package's with changes."""
    data = yaml.safe_load(config_path(f'drives/{base}.yaml').read_text())
    data |= {'eds': str(config_path(f"drives/{data['eds']}")), **changes}
    path = directory / 'mine.yaml'
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return tuple(replace(axis, profile=str(path)) for axis in DEFAULT_AXES)
