"""Parameter files: read as ROS reads them; written with comments, order and all else as it was."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import json
from pathlib import Path
import re
from typing import Any, NamedTuple, TypeVar

import yaml

from facade_manipulator.errors import file_errors, ParameterError
from facade_manipulator.files import atomic_write
from facade_manipulator.parameters import nearest, NODES, parameter_fields, settings_from

DIGITS = 7  # behind the point: 0.1 um, 0.1 urad
ALL_NODES = '**'
_OF_MECHANISM = ('driver', 'compensator', 'ik_service')
_ROS = 'ros__parameters'
_WILDCARDS = {'*': '/[^/]+', '**': '(/[^/]+)*'}
_WORDS = {form: value for words, value in (('y yes true on', True), ('n no false off', False))
          for word in words.split() for form in (word, word.capitalize(), word.upper())}
_INTEGER = re.compile('[+-]?(0x[0-9a-f]+|0[0-7]*|[1-9][0-9]*)', re.IGNORECASE)
Class = TypeVar('Class')


class Entry(NamedTuple):
    """A key and what it holds, in the text of a parameter file."""

    prefix: str  #: what stands before the key in the full names of the parameters in it
    key: yaml.Node
    content: yaml.Node
    is_flow: bool  #: whether it is between braces


class GivenParameter(NamedTuple):
    """A parameter that somebody has given."""

    section: str  #: for which nodes, such as ``/**/driver``
    name: str  #: its full name
    value: Any = None
    entries: tuple[Entry, ...] = ()  #: where it is in a file, outermost first

    @property
    def node(self) -> str:
        """Name of the node, or ``*`` or ``**``."""
        return self.section.rpartition('/')[2]


def given_parameters(path: Path) -> list[GivenParameter]:
    """Return what is in a parameter file, in order; raises a ParameterError if it is not one."""
    return _parsed(path, _text(path))


def _text(path: Path) -> str:
    with file_errors(path, 'read'):
        return path.read_text(encoding='utf-8')


def _parsed(path: Path, text: str) -> list[GivenParameter]:
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise ParameterError(f'{path} cannot be read: {error}') from error
    try:
        return list(_sections(root, '')) if root is not None else []
    except ParameterError as error:
        raise ParameterError(f'{path} is not a parameter file: {error}') from error


def _sections(node: yaml.Node, section: str) -> Iterator[GivenParameter]:
    for key, inner in _items(node, section or 'it'):
        if key.value == _ROS:
            yield from _values(inner, section, ())
        else:
            yield from _sections(inner, f'{section}/{key.value}' if section else key.value)


def _items(node: yaml.Node, what: str) -> Iterator[tuple[yaml.Node, yaml.Node]]:
    if not isinstance(node, yaml.MappingNode):
        raise ParameterError(f'{what} is not a table')
    yield from node.value


def _values(
    node: yaml.Node, section: str, outer: tuple[Entry, ...]
) -> Iterator[GivenParameter]:
    prefix = outer[-1].prefix + outer[-1].key.value + '.' if outer else ''
    for key, inner in _items(node, _ROS):
        entries = (*outer, Entry(prefix, key, inner, node.flow_style))
        if isinstance(inner, yaml.MappingNode):
            yield from _values(inner, section, entries)
        elif inner.value or inner.style:
            yield GivenParameter(section, prefix + key.value, _value(inner), entries)
        else:
            raise ParameterError(f'{prefix}{key.value} has no value')


def _value(node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return [_scalar(element) for element in node.value]
    return _scalar(node)


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

    Later files beat earlier ones, section by section. Without a namespace it is that which the
    files name. Raises a ParameterError where a file cannot be read, names an unknown node, or
    gives the node other values in one namespace than in another.
    """
    given = [one for path in paths for one in given_parameters(path)]
    for one in given:
        if one.node not in (*_WILDCARDS, *NODES):
            raise ParameterError(f"{paths[-1]}: no node is called '{one.node}'"
                                 f'{nearest(one.node, NODES)}')
    namespaces = _namespaces(given) if namespace is None else [namespace]
    values = [{one.name: one.value for one in _of_node(given, f'{name}/{node}')}
              for name in namespaces]
    if any(one != values[0] for one in values):
        raise ParameterError(
            f'{paths[-1]} gives {node} other values in each of the namespaces '
            f'{", ".join(name or "/" for name in namespaces)}: give each machine its own file')
    return values[0]


def _of_node(given: Iterable[GivenParameter], name: str) -> list[GivenParameter]:
    """Return a node's: sections beat those that begin before them, and in one the last value."""
    given = list(given)
    order = list(dict.fromkeys(one.section for one in given))
    return [one for one in sorted(given, key=lambda one: order.index(one.section))
            if _matches(one.section, name)]


def _matches(section: str, name: str) -> bool:
    tokens = section.removeprefix('/').split('/')
    return re.fullmatch(''.join(_WILDCARDS.get(token) or re.escape(f'/{token}')
                                for token in tokens), name) is not None


def _namespaces(given: Iterable[GivenParameter]) -> list[str]:
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

    Raises a ParameterError as `read_parameters` and `settings_from`, for an unknown name and
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
    except ParameterError as error:
        raise ParameterError(f'{paths[-1]}: {section}: {error}') from error


def _is_of(full_name: str, section: str, cls: type) -> bool:
    """Return whether a name is of a section; raises a ParameterError if it looks like that."""
    group, _, name = full_name.partition('.')
    known = parameter_fields(cls)
    if not section:
        return full_name in known
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

    They are those of a node or of `ALL_NODES`, by namespace of the parameters, such as
    ``'geometry'``, and by name. Raises a ParameterError if the source cannot be read, the target
    not be written, or a node would read anything else from it; nothing is written then.
    """
    nodes = _OF_MECHANISM if node == ALL_NODES else (node,)
    namespace = _namespaces(given_parameters(source))[0]
    changed = {f'{section}.{name}': _plain(value) for section, values in sections.items()
               for name, value in values.items()}
    text = _text(source)
    for name, value in changed.items():
        for one in nodes:
            given = _of_node(_parsed(source, text), f'{namespace}/{one}')
            text = _changed(text, given, node, name, value)
    with file_errors(target), atomic_write(target) as draft:
        draft.write_text(text, 'utf-8')
        for one in nodes:
            wanted = read_parameters([source], one) | changed
            if (found := read_parameters([draft], one)) != wanted:
                raise ParameterError(f'{one} would read {found} instead of {wanted}')


def _changed(
    text: str, given: list[GivenParameter], node: str, full_name: str, value: Any
) -> str:
    """Return a text in which a parameter has a value: in its place, or beside its neighbours."""
    shown = json.dumps(value, ensure_ascii=False)  # which is YAML, and no word of ROS's
    for one in reversed(given):
        if one.name == full_name:
            place = one.entries[-1].content
            return text[:place.start_mark.index] + shown + text[_end(place):]
    section = full_name.partition('.')[0] + '.'
    homes = [one for one in given if one.name.startswith(section)] or [
        one for one in given if one.node == node]
    if not homes:
        key = '/**' if node == ALL_NODES else f'/**/{node}'
        return f'{text.rstrip()}\n\n{key}:\n  {_ROS}:\n    {full_name}: {shown}\n'.lstrip()
    place = [one for one in homes[-1].entries if full_name.startswith(one.prefix)][-1]
    line = f'{full_name.removeprefix(place.prefix)}: {shown}'
    end = _end(place.content)
    if place.is_flow:
        return f'{text[:end]}, {line}{text[end:]}'
    behind, newline, rest = text[end:].partition('\n')
    indent = ' ' * place.key.start_mark.column
    return f'{text[:end]}{behind}\n{indent}{line}{newline}{rest}'


def _end(node: yaml.Node) -> int:
    """Return where a node ends in the text; the mark of a block stands behind what follows it."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        node = last[-1] if isinstance(last, tuple) else last
    return node.end_mark.index


def _plain(value: Any) -> Any:
    if isinstance(value, (int, str)):
        return value
    if isinstance(value, (tuple, list)):
        return [_plain(float(element)) for element in value]
    return round(float(value), DIGITS)
