"""The geometry in a parameter file."""

from __future__ import annotations

from pathlib import Path

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameter_file import ALL_NODES, read_parameters


def read_geometry(path: Path) -> Geometry:
    """
    Return the geometry that a parameter file gives all nodes.

    Raises
    ------
    ParameterError
        If it cannot be read, or there is no such machine.

    """
    values = read_parameters(path, ALL_NODES).get('geometry') or {}
    try:
        return Geometry(**{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()})
    except TypeError as error:
        raise ParameterError(f'{path}: geometry: {error}') from error
