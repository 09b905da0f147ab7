"""
Parameters of the core objects: one frozen dataclass is the single source of each.

Name, default, unit and range stand in the dataclass field. A YAML file, a test and a live change
all construct the dataclass and so meet the same check; nodes turn the fields into described ROS
parameters (`facade_manipulator.ros.parameters`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, Field, field, fields
from difflib import get_close_matches
import math
from numbers import Integral, Real
import re
from typing import Any, dataclass_transform, TypeVar

from facade_manipulator.errors import ParameterError

METADATA_KEY = 'parameter'
_KINDS = {bool: (bool, 'a bool'), int: (Integral, 'an integer'), float: (Real, 'a double'),
          str: (str, 'a string')}
Class = TypeVar('Class')


@dataclass(frozen=True)
class ParameterInfo:
    """
    What an operator sees of a parameter: description, unit, range, whether it is read-only.

    `elements` names the elements of an array whose length is fixed.
    """

    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    read_only: bool = False
    choices: tuple[str, ...] = ()
    elements: tuple[str, ...] = ()


def parameter(description: str, *, default: Any, **info: Any) -> Any:
    """
    Declare a dataclass field as a parameter; `info` are the other fields of `ParameterInfo`.

    The description is one line for the operator, without the unit; the default a bool, int, float,
    str or a tuple of one of these.
    """
    return field(default=default, metadata={METADATA_KEY: ParameterInfo(description, **info)})


def nearest(name: str, known: Iterable[str]) -> str:
    """Return what follows on an unknown name in a message: the nearest known one, if any."""
    found = get_close_matches(name, known, 1)
    return f": did you mean '{found[0]}'?" if found else ''


def inherited(base: type, name: str, *, default: Any) -> Any:
    """Declare a parameter of a base class again, with another default."""
    metadata = next(item.metadata for item in fields(base) if item.name == name)
    return field(default=default, metadata=metadata)


@dataclass_transform(frozen_default=True, field_specifiers=(parameter, inherited))
def settings(cls: type[Class]) -> type[Class]:
    """
    Make a class a frozen dataclass that checks its parameters whenever one is made.

    Rules between fields stand in the class's own ``__post_init__``, which runs after the check.
    A ParameterError is raised when an instance is made, as by `check_parameters`.
    """
    rules = getattr(cls, '__post_init__', None)

    def check(self: Any) -> None:
        check_parameters(self)
        if rules is not None:
            rules(self)

    cls.__post_init__ = check  # type: ignore[attr-defined]  # a class that has none gets one
    return dataclass(frozen=True)(cls)


def as_fields(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of a file or a node as the fields of settings have them: lists as tuples."""
    return {name: tuple(value) if isinstance(value, list) else value
            for name, value in values.items()}


def parameter_fields(cls: type) -> dict[str, Field[Any]]:
    """Return the fields of settings that are parameters by name; what else there is, is fixed."""
    return {item.name: item for item in fields(cls) if METADATA_KEY in item.metadata}


def parameter_names(cls: type, prefix: str = '') -> dict[str, str]:
    """Return the fields of settings that are parameters by their full names below a prefix."""
    return {f'{prefix}.{name}' if prefix else name: name for name in parameter_fields(cls)}


@contextmanager
def names_in_full(cls: type, prefix: str) -> Iterator[None]:
    """Let a ParameterError of what is inside name the parameters of settings as users do."""
    try:
        yield
    except ParameterError as error:
        if not prefix:
            raise
        raise ParameterError(re.sub(
            rf'(?<![\w.])({"|".join(parameter_fields(cls))})(?= = | has )', rf'{prefix}.\1',
            str(error))) from error


def settings_from(
    cls: type[Class], values: Mapping[str, Any], prefix: str = '', **defaults: Any
) -> Class:
    """
    Make settings of a node's parameters; what they do not name has its default.

    Values are by full names, `prefix` is the namespace of the settings, such as ``'geometry'``;
    `defaults` are those that differ from the dataclass's, and values of what is fixed. Raises as
    `check_parameters`.
    """
    names = parameter_names(cls, prefix)
    return cls(**defaults | as_fields({
        names[name]: value for name, value in values.items() if name in names}))


def check_parameters(instance: Any) -> None:
    """
    Check every parameter of a dataclass instance against its default's type and its range.

    Raises a ParameterError that names the parameter, its value, its bound and unit.
    """
    for name, item in parameter_fields(type(instance)).items():
        value = getattr(instance, name)
        check_type(name, value, item.default, is_given_to_ros=False)
        check_value(name, value, item.metadata[METADATA_KEY])


def check_type(name: str, value: Any, default: Any, *, is_given_to_ros: bool = True) -> None:
    """
    Check that a value is of its default's type, as `check_parameters` does.

    ROS takes no integer for a double, Python does.
    """
    if isinstance(default, tuple):
        if not isinstance(value, (tuple, list)):
            raise ParameterError(f'{name} = {value!r} is not a list')
        for element in value if default else ():
            check_type(name, element, default[0], is_given_to_ros=is_given_to_ros)
        return
    kind, word = _KINDS[type(default)]
    if not isinstance(value, kind) or isinstance(value, bool) is not isinstance(default, bool):
        raise ParameterError(f'{name} = {value!r}, expected {word}')
    if is_given_to_ros and isinstance(default, float) and isinstance(value, Integral):
        raise ParameterError(
            f'{name} = {value} is an integer, expected a double: write {value}.0')


def check_value(name: str, value: Any, info: ParameterInfo) -> None:
    """Check one value, of the right type, against its range, as `check_parameters` does."""
    if info.choices and value not in info.choices:
        raise ParameterError(f'{name} = {value!r} is not one of {", ".join(info.choices)}')
    if info.elements and len(value) != len(info.elements):
        raise ParameterError(
            f'{name} has {len(value)} elements, expected {len(info.elements)}: '
            f'{", ".join(info.elements)}')
    for element in value if isinstance(value, (tuple, list)) else (value,):
        if isinstance(element, (int, float)) and not isinstance(element, bool):
            _check_number(name, element, info)


def _check_number(name: str, value: float, info: ParameterInfo) -> None:
    unit = f' {info.unit}' if info.unit else ''
    if not math.isfinite(value):
        raise ParameterError(f'{name} = {value} is not a finite number')
    if info.minimum is not None and value < info.minimum:
        raise ParameterError(
            f'{name} = {value:g}{unit} is below its minimum {info.minimum:g}{unit}')
    if info.maximum is not None and value > info.maximum:
        raise ParameterError(
            f'{name} = {value:g}{unit} is above its maximum {info.maximum:g}{unit}')
