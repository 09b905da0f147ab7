"""A parameter file with other values: comments, order and everything else stay as they are."""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any, TypeVar

from facade_manipulator.errors import file_errors, ParameterError
from facade_manipulator.files import atomic_write
from facade_manipulator.parameters import as_fields, parameter_fields

DIGITS = 7  # behind the point: 0.1 um, 0.1 urad
ALL_NODES = '/**'
Class = TypeVar('Class')


def read_parameters(path: Path, node: str) -> dict[str, Any]:
    """
    Return what a parameter file gives a node, by section and name; empty for nothing.

    Raises a ParameterError if it cannot be read, or is no parameter file.
    """
    parameters = (_load(path).get(node) or {}).get('ros__parameters') or {}
    if not isinstance(parameters, dict):
        raise ParameterError(f'{path}: ros__parameters of {node} is {parameters!r}, not a table')
    return parameters


def read_section(path: Path, node: str, section: str) -> dict[str, Any]:
    """Return a section of `read_parameters`; raises a ParameterError if it is no table."""
    values = read_parameters(path, node).get(section) or {}
    if not isinstance(values, dict):
        raise ParameterError(f'{path}: {section} = {values!r} is not a table')
    return values


def read_settings(
    path: Path, node: str, section: str, cls: type[Class], **defaults: Any
) -> Class:
    """
    Return settings from a section of what a parameter file gives a node.

    Raises a ParameterError as `read_section`, for an unknown name and for a value out of range.
    """
    values = read_section(path, node, section)
    unknown = values.keys() - parameter_fields(cls).keys()
    if unknown:
        raise ParameterError(f'{path}: {section} has no parameter {min(map(str, unknown))}')
    try:
        return cls(**defaults | as_fields(values))
    except (TypeError, ParameterError) as error:
        raise ParameterError(f'{path}: {section}: {error}') from error


def write_parameters(
    source: Path, target: Path, node: str, sections: Mapping[str, Mapping[str, Any]]
) -> None:
    """
    Write a copy of a parameter file with other values in some sections of one node.

    Parameters
    ----------
    source, target : Path
    node : str
        Key of the file, such as ``'/**'``.
    sections : mapping
        Values by name, by namespace of the parameters, such as ``'geometry'``.

    Raises
    ------
    ParameterError
        If the source cannot be read or the target not be written; nothing is written then.

    """
    content = _load(source)
    for section, values in sections.items():
        place = content
        for key in (node, 'ros__parameters', section):
            if not isinstance(place.get(key), dict):
                place[key] = {}
            place = place[key]
        for name, value in values.items():
            place[name] = _plain(value)
    with (file_errors(target), atomic_write(target) as draft,
          draft.open('w', encoding='utf-8') as file):
        _yaml().dump(content, file)


def _load(path: Path) -> Any:
    from ruamel.yaml import YAMLError

    try:
        content = _yaml().load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        raise ParameterError(f'{path} cannot be read: {error}') from error
    if not isinstance(content, dict):
        raise ParameterError(f'{path} is not a parameter file')
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

    if isinstance(value, (int, str)):
        return value
    if not isinstance(value, (tuple, list)):
        return round(float(value), DIGITS)
    row = CommentedSeq(round(float(element), DIGITS) for element in value)
    row.fa.set_flow_style()
    return row
