"""Parameter files as the driver reads them, without ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.stopping_analysis import StoppingAnalysis
from facade_manipulator.drives.axis_settings import axis_defaults, AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.interfaces import DRIVER
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.nodes.settings import DriverSettings
from facade_manipulator.parameter_file import (
    check_names,
    given_in,
    given_settings,
    read_parameters,
)
from facade_manipulator.parameters import names_in_full, parameter_names

Settings = TypeVar('Settings')
#: settings of the driver beside those of the stopping analysis, by their prefix
OTHER_SETTINGS = {'': DriverSettings, 'bus': BusSettings, 'stream': StreamSettings}


class _DriverParameters:
    """Parameters of the driver in files: their known names, and messages about wrong values."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._values = read_parameters(paths, DRIVER)
        self.known: set[str] = set()
        self.wrong: list[str] = []

    def read(self, kind: type[Settings], prefix: str = '', **defaults: Any) -> Settings:
        """Return settings below a prefix, or the defaults where a value is wrong."""
        self.known.update(parameter_names(kind, prefix))
        try:
            with names_in_full(kind, prefix):
                return given_settings(kind, self._values, prefix, **defaults)
        except ParameterError as error:
            self.wrong.append(str(error))
            return kind()


def read_driver(paths: Sequence[Path]) -> StoppingAnalysis:
    """Return the stopping analysis of the driver; raises for a file that it would reject."""
    given = _DriverParameters(paths)
    for prefix, kind in OTHER_SETTINGS.items():
        given.read(kind, prefix)
    geometry = given.read(Geometry, 'geometry')
    axes = tuple(given.read(AxisSettings, name, **defaults)
                 for name, defaults in axis_defaults(geometry.stroke).items())
    analysis = StoppingAnalysis(geometry, given.read(MotionLimits, 'limits'), axes,
                                given.read(ControllerSettings, 'controller'))
    everything = [one for path in paths for one in given_in(path)]
    check_names(everything, {DRIVER: given.known}, given.wrong.append, lambda _: None)
    if given.wrong:
        raise ParameterError(f'{paths[-1]}: {"; ".join(given.wrong)}')
    return analysis
