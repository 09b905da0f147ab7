"""Parameter files: read as ROS reads them; written with comments, order and all else as it was."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import math
from pathlib import Path
import re
from typing import Any, NamedTuple, TypeVar

import yaml

from facade_manipulator.errors import file_errors, ParameterError
from facade_manipulator.files import atomic_write
from facade_manipulator.parameters import nearest, parameter_fields, settings_from

DIGITS = 7  # behind the point: 0.1 um, 0.1 urad
ALL_NODES = '**'
NODE_NAMES = ('compensator', 'driver', 'gondola_simulator', 'ik_service', 'recorder')
_OF_MECHANISM = ('driver', 'compensator', 'ik_service')
_ROS = 'ros__parameters'
_WILDCARDS = {'*': '/[^/]+', '**': '(/[^/]+)*'}
_WORDS = {form: value for words, value in (('y yes true on', True), ('n no false off', False))
          for word in words.split() for form in (word, word.capitalize(), word.upper())}
_INTEGER = re.compile('[+-]?(0x[0-9a-f]+|0[0-7]*|[1-9][0-9]*)', re.IGNORECASE)
Class = TypeVar('Class')


class FileParameter(NamedTuple):
    """A parameter in a file: for which nodes (as ``/**/driver``), its full name, its value."""

    section: str
    name: str
    value: Any

    @property
    def node(self) -> str:
        """Name of the node, or ``*`` or ``**``."""
        return self.section.rpartition('/')[2]


def given_parameters(path: Path) -> list[FileParameter]:
    """Return what is in a parameter file, in order; raises a ParameterError if it is not one."""
    try:
        root = yaml.compose(path.read_text(encoding='utf-8'), Loader=yaml.SafeLoader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(f'{path} cannot be read: {error}') from error
    try:
        return list(_sections(root, '')) if root is not None else []
    except ParameterError as error:
        raise ParameterError(f'{path} is not a parameter file: {error}') from error


def _sections(node: yaml.Node, section: str) -> Iterator[FileParameter]:
    for key, inner in _items(node, section or 'it'):
        if key == _ROS:
            yield from (FileParameter(section, *one) for one in _values(inner, ''))
        else:
            yield from _sections(inner, _joined(section, key))


def _joined(section: str, key: object) -> str:
    return f'{section}/{key}' if section else str(key)


def _items(node: yaml.Node, what: str) -> Iterator[tuple[str, yaml.Node]]:
    if not isinstance(node, yaml.MappingNode):
        raise ParameterError(f'{what} is not a table')
    yield from ((key.value, inner) for key, inner in node.value)


def _values(node: yaml.Node, prefix: str) -> Iterator[tuple[str, Any]]:
    for key, inner in _items(node, _ROS):
        name = prefix + key
        if isinstance(inner, yaml.MappingNode):
            yield from _values(inner, f'{name}.')
        elif isinstance(inner, yaml.SequenceNode):
            yield name, [_scalar(element) for element in inner.value]
        elif inner.value or inner.style:
            yield name, _scalar(inner)
        else:
            raise ParameterError(f'{name} has no value')


def _scalar(node: yaml.Node) -> Any:
    """Return a value as rcl reads it, which differs from every library of YAML."""
    text = str(node.value)
    if node.style or text in _WORDS:
        return text if node.style else _WORDS[text]
    if _INTEGER.fullmatch(text):
        digits = text.lstrip('+-')
        number = int(digits, 16 if digits[1:2] in ('x', 'X') else 8 if digits[0] == '0' else 10)
        return -number if text[0] == '-' else number
    try:
        return text if '_' in text else float(re.sub(r'^([+-]?)\.(?=inf|nan)', r'\1', text))
    except ValueError:
        return text


def read_parameters(
    paths: Sequence[Path], node: str, namespace: str | None = None
) -> dict[str, Any]:
    """
    Return what parameter files give a node by full name, with the matching and order of rcl.

    Parameters
    ----------
    paths : sequence of Path
        Later ones beat earlier ones, section by section.
    node : str
        Such as ``'driver'``.
    namespace : str, optional
        Of the node; that which the files name, if not given.

    Raises
    ------
    ParameterError
        A file cannot be read, names an unknown node, or gives the node other values in
        one namespace than in another.

    """
    given = [one for path in paths for one in given_parameters(path)]
    for one in given:
        if one.node not in (*_WILDCARDS, *NODE_NAMES):
            raise ParameterError(f"{paths[-1]}: no node is called '{one.node}'"
                                 f'{nearest(one.node, NODE_NAMES)}')
    namespaces = _namespaces(given) if namespace is None else [namespace]
    values = [_merged(given, f'{name}/{node}') for name in namespaces]
    if any(one != values[0] for one in values):
        raise ParameterError(
            f'{paths[-1]} gives {node} other values in each of the namespaces '
            f'{", ".join(name or "/" for name in namespaces)}: give each machine its own file')
    return values[0]


def _merged(given: Iterable[FileParameter], name: str) -> dict[str, Any]:
    """Sections beat those that begin before them in the files; within one the last value wins."""
    given = list(given)
    order = list(dict.fromkeys(one.section for one in given))
    return {one.name: one.value for one in sorted(given, key=lambda one: order.index(one.section))
            if _matches(one.section, name)}


def _matches(section: str, name: str) -> bool:
    tokens = section.removeprefix('/').split('/')
    return re.fullmatch(''.join(_WILDCARDS.get(token) or re.escape(f'/{token}')
                                for token in tokens), name) is not None


def _namespaces(given: Iterable[FileParameter]) -> list[str]:
    """Return the namespaces that sections name; that without a name if there are none."""
    sections = {f'/{one.section.removeprefix("/")}' for one in given}
    named = {section.partition('/**')[0] if '**' in section else section.rpartition('/')[0]
             for section in sections if not section.startswith('/**')}
    return sorted(named) or ['']


def read_settings(
    paths: Sequence[Path], node: str, section: str, cls: type[Class],
    namespace: str | None = None, **defaults: Any,
) -> Class:
    """
    Return settings from a section of what parameter files give a node, or `ALL_NODES` alike.

    Raises a ParameterError as `read_parameters`, for an unknown name, for a value out of range and
    where the nodes would have different ones.
    """
    nodes = _OF_MECHANISM if node == ALL_NODES else (node,)
    given = [read_parameters(paths, one, namespace) for one in nodes]
    try:
        values = [{name: value for name, value in one.items() if _is_of(name, section, cls)}
                  for one in given]
        if any(one != values[0] for one in values):
            raise ParameterError(f'not the same for {", ".join(nodes)}: give it once, under /**')
        return settings_from(cls, values[0], section, **defaults)
    except (TypeError, ParameterError) as error:
        raise ParameterError(f'{paths[-1]}: {section}: {error}') from error


def _is_of(full_name: str, section: str, cls: type) -> bool:
    """Return whether a name is of a section; raises a ParameterError if it looks like that."""
    group, _, name = full_name.partition('.')
    known = parameter_fields(cls)
    if group == section and name not in known:
        raise ParameterError(f'there is no parameter {full_name}{nearest(name, known)}'
                             if name else 'it is not a table')
    if group != section and name in known and nearest(group, [section]):
        raise ParameterError(f'there is no parameter {full_name}{nearest(group, [section])}')
    return group == section


def write_parameters(
    source: Path, target: Path, node: str, sections: Mapping[str, Mapping[str, Any]]
) -> None:
    """
    Write a copy of a parameter file with other values where it gives them, else in a new line.

    Parameters
    ----------
    source, target : Path
    node : str
        A node, or `ALL_NODES`.
    sections : mapping
        Values by name, by namespace of the parameters, such as ``'geometry'``.

    Raises
    ------
    ParameterError
        If the source cannot be read or the target not be written; nothing is written then.

    """
    nodes = _OF_MECHANISM if node == ALL_NODES else (node,)
    namespace = _namespaces(given_parameters(source))[0]
    content = _load(source)
    for section, values in sections.items():
        for name, value in values.items():
            for one in nodes:
                _put(content, node, f'{namespace}/{one}', (section, name), _plain(value))
    with (file_errors(target), atomic_write(target) as draft):
        with draft.open('w', encoding='utf-8') as file:
            _yaml().dump(content, file)
        for one in nodes:
            _require_written(draft, one, sections)


def _require_written(
    draft: Path, node: str, sections: Mapping[str, Mapping[str, Any]]
) -> None:
    found = read_parameters([draft], node)
    for section, values in sections.items():
        for name, value in values.items():
            full_name = f'{section}.{name}'
            if found.get(full_name) != _plain(value):
                raise ParameterError(
                    f'{node} would read {full_name} = {found.get(full_name)} instead of {value!r}')


def _put(
    content: Any, node: str, node_name: str, full_name: tuple[str, str], value: Any
) -> None:
    """Write a value where a node has it, or else where its neighbours are."""
    section, name = full_name
    tables = [(key, table) for key, table in _tables(content, '') if _matches(key, node_name)]
    for _, table in reversed(tables):
        if place := _place(table, f'{section}.{name}'):
            place[0][place[1]] = value
            return
    homes = [table for _, table in tables if isinstance(table.get(section), dict)] or [
        table for key, table in tables if key.rpartition('/')[2] == node]
    if not homes:
        key = '/**' if node == ALL_NODES else f'/**/{node}'
        homes = [content.setdefault(key, {}).setdefault(_ROS, {})]
    homes[-1].setdefault(section, {})[name] = value


def _tables(content: Any, section: str) -> Iterator[tuple[str, Any]]:
    for key, inner in content.items():
        if key == _ROS:
            yield section, inner
        else:
            yield from _tables(inner, _joined(section, key))


def _place(table: Any, name: str) -> tuple[Any, str] | None:
    """Return the table and the key, dotted or not, under which a parameter is; the last if two."""
    for key in reversed(table):
        if key == name:
            return table, key
        rest = name.removeprefix(f'{key}.')
        if rest != name and (found := _place(table[key], rest)):
            return found
    return None


def _load(path: Path) -> Any:
    """Return the content of a file that can be read, with its comments."""
    from ruamel.yaml import YAMLError

    try:
        return _yaml().load(path.read_text(encoding='utf-8')) or {}
    except YAMLError as error:  # as of a name that is there twice, which ROS accepts
        raise ParameterError(f'{path} cannot be changed: {error}') from error


def _yaml() -> Any:
    """Return what reads and writes YAML with its comments; PyYAML drops them."""
    from ruamel.yaml import YAML

    made: Any = YAML()  # whose width is said to be an int
    made.preserve_quotes = True
    made.width = math.inf
    return made


def _plain(value: Any) -> Any:
    from ruamel.yaml.comments import CommentedSeq

    if isinstance(value, (int, str)):
        return value
    if not isinstance(value, (tuple, list)):
        return round(float(value), DIGITS)
    row = CommentedSeq(round(float(element), DIGITS) for element in value)
    row.fa.set_flow_style()
    return row
