"""
Parameters of the core objects, each defined only once, in a frozen dataclass.

A dataclass field defines name, default, unit, range and description. A parameter file, a test and
a live change all create an instance of the dataclass, so the same check applies to them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, Field, field, fields, is_dataclass, MISSING, replace
from difflib import get_close_matches
import math
from pathlib import Path
import re
from typing import Any, dataclass_transform, TypeVar

import yaml

from facade_manipulator.errors import compared, ParameterError

NODES = (
    'driver',
    'ik_service',
    'compensator',
    'disturbance_estimator',
    'gondola_simulator',
)
#: former names of parameters, each with its present name
RENAMED = {
    'approach.acceleration': 'reference.acceleration',
    'approach.jerk': 'reference.jerk',
    'approach.speed': 'reference.speed',
    'min_conditioning': 'reference.min_conditioning',
}
_KEY = 'parameter'  # key in the metadata of a dataclass field
_INTEGER = 'tag:yaml.org,2002:int'
_FLOAT = 'tag:yaml.org,2002:float'
_LEADING_ZEROS = '!leading_zeros'
Class = TypeVar('Class')


@dataclass(frozen=True)
class ParameterInfo:
    """
    Default, description, unit and range of a parameter; `live` parameters may change at run time.

    `elements` names the elements of an array whose length is fixed.
    """

    default: Any
    text: str  #: description and unit, one line for the operator
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    live: bool = False
    elements: tuple[str, ...] = ()


def parameter(description: str, *, default: Any, unit: str = '', **info: Any) -> Any:
    """
    Declare a dataclass field as a parameter; `info` contains fields of `ParameterInfo`.

    The description is one line for the operator; the unit is appended. The default is a bool, int,
    float, str or a tuple of values of one of these types.
    """
    text = f'{description} [{unit}]' if unit else description
    return field(
        default=default, metadata={_KEY: ParameterInfo(default, text, unit, **info)}
    )


def inherited(base: type, name: str, *, default: Any) -> Any:
    """Redeclare a parameter of a base class with another default."""
    info = replace(parameter_fields(base)[name], default=default)
    return field(default=default, metadata={_KEY: info})


@dataclass_transform(frozen_default=True, field_specifiers=(parameter, inherited))
def settings(cls: type[Class]) -> type[Class]:
    """
    Make a class a frozen dataclass whose instances check the ranges of their parameters.

    Rules between fields belong in the ``__post_init__`` of the class, which runs after the check.
    """
    rules = getattr(cls, '__post_init__', lambda _: None)

    def check(self: Any) -> None:
        for name, info in parameter_fields(cls).items():
            _require_in_range(name, getattr(self, name), info)
        rules(self)

    cls.__post_init__ = check  # type: ignore[attr-defined]  # some classes have no such method
    return dataclass(frozen=True)(cls)


def parameter_fields(cls: Any, only: Collection[str] = ()) -> dict[str, ParameterInfo]:
    """Return the parameters of a settings class by field name, optionally only some of them."""
    infos = {}
    for item in fields(cls):
        is_wanted = not only or item.name in only
        if is_wanted and _KEY in item.metadata:
            infos[item.name] = item.metadata[_KEY]
    return infos


def full_name(prefix: str, name: str) -> str:
    """Return the user's name of a parameter, such as ``limits.speed``."""
    return f'{prefix}.{name}' if prefix else name


# Parameters of earlier versions, and the reasons for their removal. Maximum axial clearance of
# ball screws by MISUMI's catalogue: 0.015 mm (precision, C5), 0.2 mm (rolled, C7), 0 (preloaded).
REMOVED = {
    'geometry.backlash': 'no tool measures it, and screws have at most 0.2 mm',
}


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the hint that follows an unknown name in a message."""
    if name in REMOVED:
        return f', which was removed because {REMOVED[name]}'
    found = get_close_matches(name, known, 1)
    return f", which is similar to '{found[0]}'" if found else ''


def unknown(name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown parameter, with its new name or a similar name."""
    if present := RENAMED.get(name):
        return f"no longer a parameter '{name}'; next: write {present} in section /**"
    return f"no parameter '{name}'{nearest(name, known)}; next: correct or remove it"


def _elements(name: str, value: Any, info: ParameterInfo) -> Sequence[Any]:
    """Return the elements of a value; a scalar has one element."""
    if not isinstance(info.default, tuple):
        return (value,)
    if not isinstance(value, (tuple, list)):
        raise ParameterError(f'{name} = {value!r} is not a list; next: write [{value}]')
    return value


def _require_type(name: str, value: Any, info: ParameterInfo) -> None:
    """Check the type of a value; as in ROS, an integer is not accepted as a double."""
    for kind in map(type, _elements(name, info.default, info)):
        for element in _elements(name, value, info):
            if type(element) is not kind:
                raise _wrong_type(name, element, kind)


_TYPES = {
    bool: 'true or false',
    int: 'an integer',
    float: 'a double such as 1.0',
    str: 'a string',
}


def _wrong_type(name: str, element: Any, kind: type) -> ParameterError:
    """Return the error for an element of a wrong type; the caller raises it."""
    step = f'set {_TYPES[kind]}'
    if kind is float and type(element) is int:
        step = f'write {float(element)}'
    return ParameterError(
        f'{name} = {element!r}, expected {_TYPES[kind]}; next: {step}'
    )


LARGEST_EXACT = 2.0**53  # largest integer up to which a double holds all


def number_text(value: float) -> str:
    """Format a number with six digits; a large integer, such as 4294967295, with all digits."""
    if abs(value) < LARGEST_EXACT and value == int(value):
        return str(int(value))
    return f'{value:g}'


def _require_in_range(name: str, value: Any, info: ParameterInfo) -> None:
    """Check the range of a value; the error contains name, value, limit and unit."""
    unit = f' {info.unit}' if info.unit else ''
    elements = _elements(name, value, info)
    if info.elements and len(elements) != len(info.elements):
        raise ParameterError(
            f'{name} has {len(elements)} elements, expected {len(info.elements)}: '
            f'{", ".join(info.elements)}; next: write these {len(info.elements)} elements'
        )
    for element in elements:
        if info.minimum is not None and not isinstance(element, (int, float)):
            raise _wrong_type(name, element, float)
        if isinstance(element, float) and not math.isfinite(element):
            raise ParameterError(
                f'{name} = {element} is not a finite number; next: set a number'
            )
        for side, step, limit, sign in (
            ('below its minimum', 'at least', info.minimum, 1.0),
            ('above its maximum', 'at most', info.maximum, -1.0),
        ):
            if limit is not None and sign * element < sign * limit:
                value_text = number_text(element)
                limit_text = number_text(limit)
                if value_text == limit_text:
                    value_text, limit_text = compared(element, limit)
                raise ParameterError(
                    f'{name} = {value_text}{unit} is {side} {limit_text}{unit}; '
                    f'next: set {step} {limit_text}{unit}'
                )


# names that ROS accepts: relative, absolute, or private to the node
_TOPIC = re.compile(r'(~?/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*')


def require_topics(name: str, topics: Iterable[str]) -> None:
    """Raise a ParameterError if an element of a parameter is not the name of a topic in ROS."""
    for topic in topics:
        if not _TOPIC.fullmatch(topic):
            raise ParameterError(
                f'{name} contains {topic!r}, which is not the name of a topic; next: use only '
                'letters, digits and underscores, and no digit at the begin'
            )


def from_mapping(
    cls: type[Class], data: Mapping[str, Any], prefix: str = '', **defaults: Any
) -> Class:
    """
    Create a frozen dataclass from values by field name.

    Missing fields keep their defaults; `defaults` override the defaults of the class. A list
    becomes a tuple. A field that is a dataclass is made from an inner mapping. `prefix` is the
    group of the names in messages, such as ``'geometry'``.

    Raises a ParameterError for an unknown name, and for a value of a wrong type or out of range.
    """
    if not isinstance(data, Mapping):
        raise ParameterError(
            f'{prefix or "the file"} = {data!r} is not a table; next: write NAME: VALUE'
        )
    # fields that are not parameters are fixed, except in a class without parameters
    names = parameter_fields(cls) or [item.name for item in _fields_of(cls)]
    known = {item.name: item for item in _fields_of(cls) if item.name in names}
    given = {}
    for name, value in data.items():
        if name not in known:
            others = [full_name(prefix, other) for other in known]
            raise ParameterError(unknown(full_name(prefix, name), others))
        given[name] = _converted(full_name(prefix, name), value, known[name])
    try:
        return cls(**defaults | given)
    except ParameterError as error:  # its message begins with the name of a field
        raise ParameterError(full_name(prefix, str(error))) from error


def _fields_of(cls: Any) -> tuple[Field[Any], ...]:
    """Return the fields of a class that a type checker does not recognise as a dataclass."""
    return fields(cls)


def _converted(name: str, value: Any, item: Field[Any]) -> Any:
    """Return a field's value, checked against its parameter or its default."""
    info = item.metadata.get(_KEY)
    if info is not None:
        _require_type(name, value, info)
    else:
        default = item.default
        if default is MISSING and item.default_factory is not MISSING:
            default = item.default_factory()
        if is_dataclass(default) and not isinstance(default, type):
            return from_mapping(type(default), value, name, **vars(default))
        _require_like(name, value, default)
    return tuple(value) if isinstance(value, list) else value


def _require_like(name: str, value: Any, default: Any) -> None:
    """
    Check a scenario value against the type of its default; an integer is accepted as a double.

    Each element is like the first of the default. An empty default permits any elements, and no
    length is checked.
    """
    possible: dict[type, tuple[type, ...]] = {float: (float, int), tuple: (tuple, list)}
    if type(value) not in possible.get(type(default), (type(default),)):
        raise ParameterError(
            f'{name} = {value!r}, expected a value such as {default!r}; next: correct it'
        )
    if isinstance(default, tuple) and default:
        for element in value:
            _require_like(name, element, default[0])


class ParameterSource:
    """
    Parameters by full name, from which each settings class reads its groups.

    Attributes
    ----------
    values : dict
        Given values by full name.
    names : set of str
        Full names of the parameters that were read, given or not.

    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = dict(values)
        self.names: set[str] = set()

    def read(
        self,
        cls: type[Class],
        prefix: str = '',
        only: Collection[str] = (),
        **defaults: Any,
    ) -> Class:
        """
        Return the settings of a group; the arguments are as for `from_mapping`.

        `only` are the fields in this group, by default all.
        """
        data = {}
        for field_name in parameter_fields(cls, only):
            name = full_name(prefix, field_name)
            self.names.add(name)
            if name in self.values:
                data[field_name] = self.values[name]
        return from_mapping(cls, data, prefix, **defaults)


_CHANGED = (_INTEGER, _FLOAT, 'tag:yaml.org,2002:timestamp')


def _kept_resolvers() -> dict[str, list[tuple[str, re.Pattern[str]]]]:
    """Return the resolvers of `yaml.SafeLoader` that ROS also uses, by first letter."""
    kept = {}
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items():
        kept[first] = [one for one in resolvers if one[0] not in _CHANGED]
    return kept


def _shortened(text: str) -> str:
    """Return the begin of a text for a message."""
    return text if len(text) <= 40 else f'{text[:40]}…'


class _Loader(yaml.SafeLoader):
    """YAML loader with the types of ROS: 1e-3 is a number; 1_000, 1:30 and dates are strings."""

    # the parent shares its table of resolvers with each loader of the process
    yaml_implicit_resolvers = _kept_resolvers()

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Return the value of a node; raise a ParameterError if its type does not have it."""
        try:
            return super().construct_object(node, deep)
        except (ParameterError, yaml.YAMLError):
            raise
        except (
            ArithmeticError,
            AttributeError,
            LookupError,
            TypeError,
            ValueError,
        ) as error:
            raise ParameterError(
                f'line {node.start_mark.line + 1}: {_shortened(str(node.value))} is not a value '
                f'of the type {node.tag.rpartition(":")[2]}; next: correct this value'
            ) from error


def _reject_leading_zeros(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> None:
    """Reject leading zeros: ROS reads 00012345 as the octal number 5349, and 00089 as 89.0."""
    decimal = int(node.value.replace('_', ''))
    raise ParameterError(
        f'line {node.start_mark.line + 1}: {node.value} has leading zeros, which make a number '
        f"octal; next: write {decimal} for the decimal number, or '{node.value}' for a "
        'text'
    )


_Loader.add_implicit_resolver(
    _LEADING_ZEROS, re.compile(r'[-+]?0[0-9_]+$'), list('-+0')
)
_Loader.add_constructor(_LEADING_ZEROS, _reject_leading_zeros)
_Loader.add_constructor(_INTEGER, lambda _, node: int(node.value, 0))
_Loader.add_implicit_resolver(
    _INTEGER,
    re.compile(r'[-+]?(0|[1-9]\d*|0[xX][\da-fA-F]+)$'),
    list('-+0123456789'),
)
_Loader.add_implicit_resolver(
    _FLOAT,
    re.compile(
        r'([-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\d+[eE][-+]?\d+'
        r'|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))$'
    ),
    list('-+.0123456789'),
)


def read_value(text: str | bytes) -> Any:
    """
    Return the value of a YAML text with the type that ROS would choose.

    Raises a ParameterError for a text that is not valid, and for a number with leading zeros.
    """
    try:
        return yaml.load(text, _Loader)  # noqa: S506  # the loader is a SafeLoader
    except yaml.MarkedYAMLError as error:
        line = f'line {error.problem_mark.line + 1}: ' if error.problem_mark else ''
        raise ParameterError(
            f'{line}{error.problem}; next: correct this line'
        ) from error
    except RecursionError as error:
        raise ParameterError(
            'its values are nested too deeply; next: remove brackets or indentation'
        ) from error
    except yaml.YAMLError as error:
        text = ' '.join(str(error).split())
        raise ParameterError(f'{text}; next: save the file as UTF-8') from error


def read_sections(paths: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """
    Return the parameters in files by section, such as ``**/driver``, then by full name.

    In a section later files override earlier files. Raises a ParameterError for a file that
    cannot be read.
    """
    sections: dict[str, dict[str, Any]] = {}
    for path in paths:
        try:
            content = read_value(path.read_bytes())
            leaves = [*_leaves(content or {})]
        except ParameterError as error:
            raise ParameterError(f'{path} cannot be read: {error}') from error
        except RecursionError as error:
            raise ParameterError(
                f'{path} cannot be read: a table contains itself; next: remove its alias'
            ) from error
        for place, value in leaves:
            section, is_parameter, name = place.partition('/ros__parameters/')
            if not is_parameter or value is None:
                raise ParameterError(
                    f'{path} is not a parameter file: {place} is not a value below '
                    'ros__parameters; next: write NODE, ros__parameters and the values'
                )
            sections.setdefault(section.strip('/'), {})[name.replace('/', '.')] = value
    return sections


def _leaves(content: Any, place: str = '') -> Iterator[tuple[str, Any]]:
    """Yield each value with its place, such as ``/driver/ros__parameters/limits/speed``."""
    if not isinstance(content, dict):
        yield place, content
        return
    for key, inner in content.items():
        yield from _leaves(inner, f'{place}/{key}')


def require_known_node(section: str, known: Iterable[str]) -> str:
    """
    Return the node to which a section of a parameter file applies; ``''`` for all nodes.

    Raises a ParameterError for an unknown node.
    """
    node = section.rpartition('/')[2]
    if node.strip('*') and node not in known:
        raise ParameterError(
            f"section {section} rejected: no node is called '{node}'"
            f'{nearest(node, known)}; next: correct the name of the section'
        )
    return node.strip('*')


def read_parameters(paths: Sequence[Path], node: str) -> dict[str, Any]:
    """
    Return the parameters that files assign to a node by full name, merged as in ROS.

    A section overrides earlier sections; within a section a later file overrides an earlier file.
    Raises a ParameterError for a file that cannot be read, for a section of an unknown node, and
    for sections of the node on several machines.
    """
    sections = {}
    for section, given in read_sections(paths).items():
        if require_known_node(section, NODES) in (node, ''):
            sections[section] = given
    machines = {
        section.rpartition('/')[0] for section in sections if '*' not in section
    }
    if len(machines) > 1:
        raise ParameterError(
            f'{paths[-1]} contains sections of several machines: '
            f'{", ".join(sections)}; next: give each machine its own file'
        )

    merged: dict[str, Any] = {}
    for given in sections.values():
        merged |= given
    return merged
