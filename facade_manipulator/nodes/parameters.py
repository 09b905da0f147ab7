"""Settings dataclasses as ROS parameters: described, checked, and read-only unless marked live."""

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
from facade_manipulator.nodes.settings import OF_ROS
from facade_manipulator.nodes.workarounds import given_parameters

Settings = TypeVar('Settings')


def declare(
    node: Node,
    cls: type[Settings],
    prefix: str = '',
    on_change: Callable[[Settings], None] = lambda _: None,
    check: Callable[[Settings], object] = lambda _: None,
    *,
    only: Collection[str] = (),
    **defaults: Any,
) -> Settings:
    """
    Declare the fields of a settings dataclass and return the settings of the node.

    Parameters
    ----------
    node : rclpy.node.Node
    cls : type
        Dataclass made by `facade_manipulator.parameters.settings`.
    prefix : str
        Group of the parameters, such as ``'geometry'``.
    on_change : callable, optional
        Receives the new settings after an accepted change of a live parameter.
    check : callable, optional
        Raises a ParameterError for settings that contradict other settings, at start and before
        a live change.
    only : collection of str, optional
        Fields in this group; by default all.
    **defaults
        Values that differ from the defaults of the dataclass.

    Raises
    ------
    ParameterError
        A value has the wrong type, is out of its range or contradicts another value.

    """

    def make(values: dict[str, Any]) -> Settings:
        source = parameters.ParameterSource(values)
        made = source.read(cls, prefix, only, **defaults)
        check(made)
        return made

    declared = {
        parameters.full_name(prefix, name): info
        for name, info in parameters.parameter_fields(cls, only).items()
    }
    given = given_parameters(node)
    _give_values_to_empty_arrays(given, declared)
    made = make({name: _plain(item) for name, item in given.items()})
    infos = {
        name: (getattr(made, name.removeprefix(f'{prefix}.')), info)
        for name, info in declared.items()
    }
    for name, (value, info) in infos.items():
        default = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(
            name,
            default,
            ParameterDescriptor(
                description=info.text,
                additional_constraints=accepted(info),
                read_only=not info.live,
                dynamic_typing=default == [],  # rclpy takes an empty array for bytes
            ),
        )
    if any(info.live for _, info in infos.values()):
        _accept_live_changes(node, infos.keys(), make, on_change)
    return made


def _give_values_to_empty_arrays(
    given: dict[str, Parameter], declared: Mapping[str, parameters.ParameterInfo]
) -> None:
    """Change the given parameters: ROS reads ``[]`` as a parameter without type and value."""
    for name, info in declared.items():
        item = given.get(name)
        is_untyped = item is not None and item.type_ is Parameter.Type.NOT_SET
        if is_untyped and isinstance(info.default, tuple):
            given[name] = Parameter(name, value=[])


def accepted(info: parameters.ParameterInfo) -> str:
    """Return the accepted values in words, such as ``0.1 to 5 m/s``."""
    if info.minimum is None or info.maximum is None:
        return ''
    return f'{info.minimum:g} to {info.maximum:g} {info.unit}'.rstrip()


def _accept_live_changes(
    node: Node,
    names: Collection[str],
    make: Callable[[dict[str, Any]], Settings],
    on_change: Callable[[Settings], None],
) -> None:
    """Check a change of some parameters by making the settings, then pass the new settings."""

    def made_with(changes: Sequence[Parameter]) -> Settings:
        changed = {item.name: item for item in changes}
        return make(
            {
                name: _plain(changed.get(name) or node.get_parameter(name))
                for name in names
            }
        )

    def validate(changes: Sequence[Parameter]) -> SetParametersResult:
        try:
            made_with(changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(changes: Sequence[Parameter]) -> None:
        if any(item.name in names for item in changes):
            on_change(made_with(changes))

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply)


def parameter_files(args: Sequence[str] | None = None) -> list[Path]:
    """Return the parameter files in arguments, by default those of the process."""
    words = pairwise(sys.argv if args is None else args)
    return [Path(value) for word, value in words if word == '--params-file']


def reject_unknown_parameters(
    nodes: Sequence[Node], args: Sequence[str] | None = None
) -> None:
    """
    Raise a ParameterError for a parameter that no node of this process has declared.

    ROS ignores such a parameter, and the default would stay in force unnoticed. A section for all
    nodes may contain groups for another process; an unknown name there is logged. `args` are the
    arguments of the process, by default `sys.argv`.
    """
    words = pairwise(sys.argv if args is None else args)
    arguments = [_argument(value) for word, value in words if word in ('-p', '--param')]
    files = parameters.read_sections(parameter_files(args))
    own = {node.get_name(): node for node in nodes}
    known = {name for node in nodes for name in node.list_parameters([], 0).names}
    groups = {name.partition('.')[0] for name in known}
    _require_namespace(nodes, {section.strip('/') for section in files})
    for section, name in [
        *((section, name) for section, values in files.items() for name in values),
        *(argument[:2] for argument in arguments),
    ]:
        target = parameters.require_known_node(section, {*parameters.NODES, *own})
        group = name.partition('.')[0]
        if group in OF_ROS or (
            own[target].has_parameter(name)
            if target in own
            else name in known or target in parameters.NODES
        ):
            continue
        message = (
            f"{' and '.join(own)} has no parameter '{name}'"
            f'{parameters.nearest(name, known)}; next: correct or remove it'
        )
        if target in own or not section or group in groups:
            raise ParameterError(message)
        if group != 'geometry':  # other processes have it
            nodes[0].get_logger().warning(message)
    # a section of a file and a namespace override an argument
    for target, name, value in arguments:
        for node in nodes:
            if (
                target in ('', node.get_name())
                and node.has_parameter(name)
                and (actual := _plain(node.get_parameter(name))) != value
            ):
                raise ParameterError(
                    f'argument {name}:={value} has no effect on {node.get_name()}: the value is '
                    f'{actual}; next: change it in the parameter file'
                )


def _require_namespace(nodes: Sequence[Node], sections: Collection[str]) -> None:
    """Raise a ParameterError for a section of a node's name without the node's namespace."""
    for node in nodes:
        if node.get_namespace() != '/' and node.get_name() in sections:
            raise ParameterError(
                f'section {node.get_name()} of a parameter file does not apply to '
                f'{node.get_fully_qualified_name()}; next: rename it to /**/{node.get_name()}'
            )


def _argument(text: str) -> tuple[str, str, Any]:
    """Return node, name and value of an argument such as ``driver:limits.speed:=0.3``."""
    names, _, value = text.partition(':=')
    node, _, name = names.rpartition(':')
    try:
        return node, name, parameters.read_value(value)
    except ParameterError as error:
        raise ParameterError(f'argument {text} rejected: {error}') from error


def _plain(item: Parameter) -> Any:
    """Return the value of a parameter, an array as a list."""
    value = item.value
    return (
        value
        if value is None or isinstance(value, (bool, int, float, str))
        else list(value)
    )
