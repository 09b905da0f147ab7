"""The geometry in a parameter file."""

from __future__ import annotations

from pathlib import Path

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.parameter_file import ALL_NODES, read_parameters
from facade_manipulator.parameters import as_fields


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
        return Geometry(**as_fields(values))
    except TypeError as error:
        raise ParameterError(f'{path}: geometry: {error}') from error
