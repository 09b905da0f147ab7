"""A parameter file with other values: comments, order and everything else stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any

from facade_manipulator.errors import CalibrationError
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry

DIGITS = 7  # behind the point: 0.1 um, 0.1 urad
ALL_NODES = '/**'


def read_geometry(path: Path) -> Geometry:
    """
    Return the geometry that a parameter file gives all nodes.

    Raises
    ------
    CalibrationError
        If it cannot be read.
    ParameterError
        If there is no such machine.

    """
    content = _load(path)
    values = (content.get(ALL_NODES) or {}).get('ros__parameters', {}).get('geometry', {})
    try:
        return Geometry(**{
            name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()})
    except TypeError as error:
        raise CalibrationError(f'{path}: geometry: {error}') from error


def write_parameters(
    source: Path, target: Path, section: str, node: str, values: Mapping[str, Any]
) -> None:
    """
    Write a copy of a parameter file with other values in one section of one node.

    Parameters
    ----------
    source, target : Path
    section : str
        Namespace of the parameters, such as ``'geometry'``.
    node : str
        Key of the file, such as ``'/**'``.
    values : mapping of str to float or sequence of float

    Raises
    ------
    CalibrationError
        If the source cannot be read or the target not be written; nothing is written then.

    """
    content = _load(source)
    place = content
    for key in (node, 'ros__parameters', section):
        if not isinstance(place.get(key), dict):
            place[key] = {}
        place = place[key]
    for name, value in values.items():
        place[name] = _plain(value)
    try:
        with atomic_write(target) as draft, draft.open('w', encoding='utf-8') as file:
            _yaml().dump(content, file)
    except OSError as error:
        raise CalibrationError(f'{target} cannot be written: {error.strerror or error}') from error


def _load(path: Path) -> Any:
    from ruamel.yaml import YAMLError

    try:
        content = _yaml().load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise CalibrationError(f'{path} cannot be read: {error}') from error
    if not isinstance(content, dict):
        raise CalibrationError(f'{path} is not a parameter file')
    return content


def _yaml() -> Any:
    """Return what reads and writes YAML with its comments; PyYAML drops them."""
    from ruamel.yaml import YAML

    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = math.inf
    return yaml


def _plain(value: Any) -> Any:
    from ruamel.yaml.comments import CommentedSeq

    if not isinstance(value, (tuple, list)):
        return round(float(value), DIGITS)
    row = CommentedSeq(round(float(element), DIGITS) for element in value)
    row.fa.set_flow_style()
    return row
