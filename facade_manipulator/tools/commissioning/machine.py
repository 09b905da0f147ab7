"""The machine as its parameter file describes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
import os
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator import parameter_file
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.drives.axis_settings import (
    axis_defaults,
    AXIS_NAMES,
    AxisSettings,
    check_axes,
)
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.resources import or_installed

DRIVER = 'driver'
Class = TypeVar('Class')


@dataclass(frozen=True)
class Machine:
    """A parameter file; the first writing makes it of the installed one."""

    path: Path

    @property
    def source(self) -> Path:
        """The file that is read."""
        return or_installed(self.path)

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters that the file gives the driver; raises a ParameterError."""
        return parameter_file.read_parameters([self.source], DRIVER)

    def axis(self, name: str) -> AxisSettings:
        """Return the settings of an axis; raises a ParameterError for what none can have."""
        if name not in AXIS_NAMES:
            raise ParameterError(f'{name} is not one of {", ".join(AXIS_NAMES)}')
        stroke = self._read('geometry', Geometry).stroke
        return self._read(name, AxisSettings, **axis_defaults(stroke)[name])

    def _read(self, section: str, cls: type[Class], **defaults: Any) -> Class:
        return parameter_file.read_settings([self.source], DRIVER, section, cls, **defaults)

    @property
    def axes(self) -> dict[str, AxisSettings]:
        """Settings of all axes by name; raises a ParameterError, also where two have one id."""
        axes = {name: self.axis(name) for name in AXIS_NAMES}
        check_axes(tuple(axes.values()))
        return axes

    def bus(self, **changes: Any) -> BusSettings:
        """Return the bus of the file, with what is not None of `changes`."""
        given = {name: value for name, value in changes.items() if value is not None}
        return replace(self._read('bus', BusSettings), **given)

    @property
    def controller(self) -> ControllerSettings:
        """How the driver is to control the drives; raises a ParameterError."""
        return self._read('controller', ControllerSettings)

    def check_writable(self) -> None:
        """Raise a ParameterError, before drives are changed, if nothing can be written down."""
        self.axes  # noqa: B018 - reads them
        folder = self.path.resolve().parent
        if not os.access(folder, os.W_OK) or (
                self.path.exists() and not os.access(self.path, os.W_OK)):
            raise ParameterError(
                f'{self.path} cannot be written, it or {folder} is missing or protected: nothing '
                'was done; name another file with --parameters')

    def write(self, sections: Mapping[str, Mapping[str, Any]], node: str = DRIVER) -> None:
        """
        Write values of a node and keep the comments.

        Raises a ParameterError with the lines to write by hand; the file is then as it was.
        """
        lines = '; '.join(
            f'{section}.{name}: {value}' for section, values in sections.items()
            for name, value in values.items())
        try:
            parameter_file.write_parameters(self.source, self.path, node, sections)
        except ParameterError as error:
            raise ParameterError(f'{error}; write by hand under {node}: {lines}') from error

    def beside(self, suffix: str) -> Path:
        """Return the path of a file beside the parameter file."""
        return self.path.with_name(self.path.stem + suffix)
