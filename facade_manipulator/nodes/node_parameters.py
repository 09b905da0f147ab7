"""Parameters of a node: declared, checked, and read-only unless marked as live."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
import sys
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from facade_manipulator import parameters
from facade_manipulator.errors import ParameterError
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.nodes.node_settings import OF_ROS, parameter_names
from facade_manipulator.nodes.workarounds import given_parameters
from facade_manipulator.parameters import (
    NODES,
    number_text,
    ParameterInfo,
    ParameterSource,
)

Settings = TypeVar('Settings')


class NodeParameters(ParameterSource):
    """Source of parameters for a node, which declares each parameter that is read."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._given = given_parameters(node)
        super().__init__({name: plain(item) for name, item in self._given.items()})

    def read(
        self,
        cls: type[Settings],
        prefix: str = '',
        only: Collection[str] = (),
        **defaults: Any,
    ) -> Settings:
        """Declare the parameters of a group, and return them as settings."""
        infos = parameters.parameter_fields(cls, only)
        for field_name, info in infos.items():
            self._correct_empty_array(parameters.full_name(prefix, field_name), info)
        made = super().read(cls, prefix, only, **defaults)
        for field_name, info in infos.items():
            self._declare(
                parameters.full_name(prefix, field_name),
                getattr(made, field_name),
                info,
            )
        return made

    def _correct_empty_array(self, name: str, info: ParameterInfo) -> None:
        """Replace a given ``[]``, which ROS reads as a parameter without type and value."""
        item = self._given.get(name)
        is_untyped = item is not None and item.type_ is Parameter.Type.NOT_SET
        if is_untyped and isinstance(info.default, tuple):
            self._given[name] = Parameter(name, value=[])
            self.values[name] = []

    def _declare(self, name: str, value: Any, info: ParameterInfo) -> None:
        default = list(value) if isinstance(value, tuple) else value
        self._node.declare_parameter(
            name,
            default,
            ParameterDescriptor(
                description=info.text,
                additional_constraints=accepted(info),
                read_only=not info.live,
                dynamic_typing=default == [],  # rclpy takes an empty array for bytes
            ),
        )


def accepted(info: ParameterInfo) -> str:
    """Return the accepted range in words, such as ``0.1 to 5 m/s``."""
    if info.minimum is None or info.maximum is None:
        return ''
    lowest = number_text(info.minimum)
    highest = number_text(info.maximum)
    return f'{lowest} to {highest} {info.unit}'.rstrip()


def accept_changes(
    node: Node,
    cls: type[Settings],
    prefix: str,
    on_change: Callable[[Settings], None],
    check: Callable[[Settings], object] = lambda _: None,
) -> None:
    """
    Accept changes to the live parameters of a group while the node runs.

    Parameters
    ----------
    node : rclpy.node.Node
    cls : type
        Settings of the group.
    prefix : str
        Group of the parameters, such as ``'limits'``.
    on_change : callable
        Receives the new settings after an accepted change.
    check : callable, optional
        Raises a ParameterError for settings that contradict other settings.

    """
    names = [
        parameters.full_name(prefix, field_name)
        for field_name in parameters.parameter_fields(cls)
    ]

    def changed(changes: Sequence[Parameter]) -> Settings | None:
        """Return the settings with changes applied, None if other groups are changed."""
        given = {item.name: item for item in changes if item.name in names}
        if not given:
            return None
        values = {
            name: plain(given.get(name) or node.get_parameter(name)) for name in names
        }
        return ParameterSource(values).read(cls, prefix)

    def validate(changes: Sequence[Parameter]) -> SetParametersResult:
        try:
            settings = changed(changes)
            if settings is not None:
                check(settings)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(changes: Sequence[Parameter]) -> None:
        settings = changed(changes)
        if settings is not None:
            on_change(settings)

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply)


def parameter_files(args: Sequence[str] | None) -> list[Path]:
    """Return the parameter files named in arguments; None for those of this process."""
    words = pairwise(sys.argv if args is None else args)
    return [Path(value) for word, value in words if word == '--params-file']


def reject_unknown_parameters(
    nodes: Sequence[Node], args: Sequence[str] | None
) -> None:
    """
    Raise a ParameterError if a node is given a parameter that it does not have.

    ROS ignores such a parameter, and the default would stay in force unnoticed. A section for all
    nodes may contain parameters of a node in another process; a name that no node has is logged
    unless its group is known. `args` are the arguments of the process; None for `sys.argv`.
    """
    words = pairwise(sys.argv if args is None else args)
    arguments = [_argument(value) for word, value in words if word in ('-p', '--param')]
    files = parameter_files(args)
    sections = parameters.read_sections(files)
    own = {node.get_name() for node in nodes}
    for section in [*sections, *(target for target, _, _ in arguments)]:
        parameters.require_known_node(section, {*NODES, *own})
    _require_namespace(nodes, {section.strip('/') for section in sections})

    declared: set[str] = set()
    for node in nodes:
        declared.update(node.list_parameters([], 0).names)
    shared = _names_for_all(sections)
    of_any_node = declared | _names_of_all_nodes(files)
    for node in nodes:
        of_others = declared | (shared & of_any_node)
        of_others -= _names_by_node(node.get_name(), sections, arguments)
        for name in given_parameters(node):
            is_of_ros = name.partition('.')[0] in OF_ROS
            if node.has_parameter(name) or name in of_others or is_of_ros:
                continue
            message = f'{node.get_name()} has {parameters.unknown(name, declared)}'
            if name in shared and not _has_known_group(name, of_any_node):
                node.get_logger().warning(message)
            else:
                raise ParameterError(message)
    _require_effect(nodes, arguments)
    _require_equal_values(nodes)
    _require_fast_stream(nodes, files)


def _names_for_all(sections: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Return the parameter names in file sections that apply to all nodes."""
    names: set[str] = set()
    for section, values in sections.items():
        if not section.rpartition('/')[2].strip('*'):
            names.update(values)
    return names


def _names_by_node(
    node: str,
    sections: Mapping[str, Mapping[str, Any]],
    arguments: Sequence[tuple[str, str, Any]],
) -> set[str]:
    """Return the parameter names that files and arguments assign to a node by its name."""
    names = {name for target, name, _ in arguments if target == node}
    for section, values in sections.items():
        if section.rpartition('/')[2] == node:
            names.update(values)
    return names


def _names_of_all_nodes(files: Sequence[Path]) -> set[str]:
    """Return the parameter names of every node in the package, including other processes."""
    names: set[str] = set()
    for node in NODES:
        try:
            names |= parameter_names(node, parameters.read_parameters(files, node))
        except ParameterError:  # the process of that node reports it
            names |= parameter_names(node, {})
    return names


def _has_known_group(name: str, known: Collection[str]) -> bool:
    """Return whether a name is a former name, or belongs to the group of a known parameter."""
    groups = {other.partition('.')[0] for other in known if '.' in other}
    return name in parameters.RENAMED or name.partition('.')[0] in groups


def _require_effect(
    nodes: Sequence[Node], arguments: Sequence[tuple[str, str, Any]]
) -> None:
    """Raise a ParameterError if a section or a namespace overrides an argument."""
    for target, name, value in arguments:
        for node in nodes:
            if target not in ('', node.get_name()) or not node.has_parameter(name):
                continue
            actual = plain(node.get_parameter(name))
            if actual != value:
                raise ParameterError(
                    f'argument {name}:={value} has no effect on {node.get_name()}: the value is '
                    f'{actual}; next: change it in the parameter file'
                )


def _require_equal_values(nodes: Sequence[Node]) -> None:
    """Raise a ParameterError if nodes of this process have different values of a parameter."""
    found: dict[str, tuple[str, Any]] = {}
    for node in nodes:
        for name in node.list_parameters([], 0).names:
            value = plain(node.get_parameter(name))
            owner, first = found.setdefault(name, (node.get_name(), value))
            if value != first and name.partition('.')[0] not in OF_ROS:
                raise ParameterError(
                    f'{name} rejected: {first} of {owner} differs from {value} of '
                    f'{node.get_name()}; next: set it in section /** for all nodes'
                )


def _require_fast_stream(nodes: Sequence[Node], files: Sequence[Path]) -> None:
    """
    Raise a ParameterError if the compensator is too slow for `stream.stale_after` of the driver.

    Either process checks this if its files contain the value of the other process.
    """
    if not {'compensator', 'driver'} & {node.get_name() for node in nodes}:
        return
    rate = _known_value('compensator', 'rate', nodes, files)
    stale_after = _known_value('driver', 'stream.stale_after', nodes, files)
    if rate is not None and stale_after is not None:
        stream = StreamSettings(stale_after=stale_after)
        stream.require_rate('rate of compensator', rate)


def _known_value(
    owner: str, name: str, nodes: Sequence[Node], files: Sequence[Path]
) -> Any:
    """Return a parameter of a node in this process or of files; None if neither contains it."""
    for node in nodes:
        if node.get_name() == owner:
            return plain(node.get_parameter_or(name))
    try:
        values = parameters.read_parameters(files, owner)
        parameter_names(owner, values)
    except ParameterError:  # the process of that node reports it
        return None
    return values.get(name)


def _require_namespace(nodes: Sequence[Node], sections: Collection[str]) -> None:
    """Raise a ParameterError if a section omits the namespace of its node."""
    for node in nodes:
        if node.get_namespace() != '/' and node.get_name() in sections:
            raise ParameterError(
                f'section {node.get_name()} of a parameter file does not apply to '
                f'{node.get_fully_qualified_name()}; next: rename it to /**/{node.get_name()}'
            )


def _argument(text: str) -> tuple[str, str, Any]:
    """Split an argument such as ``driver:limits.speed:=0.3`` into node, name and value."""
    names, _, value = text.partition(':=')
    node, _, name = names.rpartition(':')
    try:
        return node, name, parameters.read_value(value)
    except ParameterError as error:
        raise ParameterError(f'argument {text} rejected: {error}') from error


def plain(item: Parameter) -> Any:
    """Return the value of a parameter; convert an array to a list."""
    value = item.value
    return (
        value
        if value is None or isinstance(value, (bool, int, float, str))
        else list(value)
    )
