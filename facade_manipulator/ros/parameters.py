"""Settings dataclasses as described ROS parameters: one check for YAML, tests and live changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
import re
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import (
    check_value,
    METADATA_KEY,
    nearest,
    parameter_fields,
    ParameterInfo,
)
from facade_manipulator.ros.old_parameters import advice, REMOVED, RENAMED

Settings = TypeVar('Settings')
UNBOUNDED = 1e308


def declare(
    node: Node,
    settings_class: type[Settings],
    prefix: str = '',
    on_change: Callable[[Settings], None] | None = None,
    check: Callable[[Settings], object] = lambda settings: None,
    **defaults: Any,
) -> Settings:
    """
    Declare every field of a settings dataclass and return the instance the node starts with.

    Parameters
    ----------
    node : rclpy.node.Node
    settings_class : type
        Frozen dataclass whose fields were made by `facade_manipulator.parameters.parameter`.
    prefix : str
        Namespace of the parameters, such as ``'geometry'``.
    on_change : callable, optional
        Called with the new settings after an accepted live change. Without it every parameter
        of the set is read-only.
    check : callable, optional
        Raises a ParameterError for settings that contradict something outside their set, at
        start and before a live change.
    **defaults
        Defaults of this node where they differ from the dataclass's, and values of what is fixed.

    Raises
    ------
    ParameterError
        A value is of the wrong type, out of its range or contradicts another one.

    """
    known = parameter_fields(settings_class)
    items = {f'{prefix}.{name}' if prefix else name: item for name, item in known.items()}
    fixed = {name: value for name, value in defaults.items() if name not in known}
    values = {
        item.name: _declare_one(
            node, name, item.metadata[METADATA_KEY], defaults.get(item.name, item.default),
            on_change is None)
        for name, item in items.items()}
    names = {name: item.name for name, item in items.items()}
    make = _maker(partial(settings_class, **fixed), prefix, check)
    current = [make(values)]
    if on_change is not None:
        _accept_live_changes(node, names, current, on_change, make)
    return current[0]


def _maker(
    settings_class: Callable[..., Settings], prefix: str, check: Callable[[Settings], object]
) -> Callable[[dict[str, Any]], Settings]:
    """Return what makes checked settings; its errors name parameters as the operator does."""
    def make(values: dict[str, Any]) -> Settings:
        try:
            made = settings_class(**values)
            check(made)
        except ParameterError as error:
            if not prefix:
                raise
            names = '|'.join(map(re.escape, values))
            raise ParameterError(re.sub(
                rf'(?<![\w.])({names})(?= = | has )', rf'{prefix}.\1', str(error))) from error
        return made

    return make


class NoParameterError(ParameterNotDeclaredException):
    """A parameter that there is not, with what there is in its place."""

    def __init__(self, name: str, advice: str) -> None:
        Exception.__init__(self, f'parameter {name} {advice}')


def accept_old_names(
    node: Node, renamed: Mapping[str, str] = RENAMED, removed: Mapping[str, str] = REMOVED
) -> None:
    """
    Accept the parameter names of the release before, with a warning; call it before `declare`.

    A renamed parameter of a file or an override, and one that is set while the node runs, has its
    effect under the present name; one that is removed has none.

    Parameters
    ----------
    node : rclpy.node.Node
    renamed : mapping of str to str
        Present names by old ones.
    removed : mapping of str to str
        What holds in place of a parameter, such as ``'is fixed at 1 s now'``, by its old name.

    Notes
    -----
    Overrides are in a private attribute of rclpy's node (tried on 7.1.6). Without it old names in
    files are ignored, as every unknown name is; `ros2 param set` works all the same.

    """
    overrides = getattr(node, '_parameter_overrides', {})
    for name in sorted(overrides):
        new, instead = renamed.get(name), advice(name, removed)
        if new is not None:
            node.get_logger().warning(_renamed(name, new))
            overrides.setdefault(new, Parameter(new, value=overrides[name].value))
        elif instead:
            node.get_logger().warning(
                f'parameter {name} has no effect: it {instead}; delete it from the file')

    def present(parameters: list[Parameter]) -> list[Parameter]:
        return [_present(node, parameter, renamed, removed) for parameter in parameters]

    node.add_pre_set_parameters_callback(present)


def _present(
    node: Node, parameter: Parameter, renamed: Mapping[str, str], removed: Mapping[str, str]
) -> Parameter:
    """Return a parameter under its present name."""
    name = parameter.name
    if node.has_parameter(name):
        return parameter
    if instead := advice(name, removed):
        raise NoParameterError(name, instead)
    new = renamed.get(name)
    if new is None:  # of which rclpy says []
        known = node.list_parameters([], 0).names
        raise NoParameterError(name, f'is none of this node{nearest(name, known)}')
    node.get_logger().warning(_renamed(name, new))
    return Parameter(new, value=parameter.value)


def _renamed(name: str, new: str) -> str:
    return (f'parameter {name} is called {new} now; the old name works in this release only: '
            'use the new one')


def _declare_one(
    node: Node, name: str, info: ParameterInfo, default: Any, read_only: bool
) -> Any:
    descriptor = _descriptor(info, default, info.read_only or read_only)
    initial = list(default) if isinstance(default, tuple) else default
    given = getattr(node, '_parameter_overrides', {}).get(name)
    if given is not None:
        _require_valid(given, Parameter(name, value=initial).type_, info)
    try:
        value = node.declare_parameter(name, initial, descriptor).value
    except (
        InvalidParameterTypeException,
        InvalidParameterValueException,
        ParameterUninitializedException,
    ) as error:
        raise ParameterError(f'{name}: {error}') from error
    return _to_field(value)


def _require_valid(given: Parameter, expected: Parameter.Type, info: ParameterInfo) -> None:
    """Say what is wrong before rclpy does, which names no unit and the parameter twice."""
    if given.type_ == expected:
        check_value(given.name, given.value, info)
    elif (given.type_, expected) == (Parameter.Type.INTEGER, Parameter.Type.DOUBLE):
        raise ParameterError(
            f'{given.name} = {given.value} is an integer, expected a double: '
            f'write {given.value}.0')
    else:
        raise ParameterError(
            f'{given.name} = {given.value!r} is of type {given.type_.name.lower()}, expected '
            f'{expected.name.lower()}')


def _to_field(value: Any) -> Any:
    return value if isinstance(value, (bool, int, float, str)) else tuple(value)


def _descriptor(info: ParameterInfo, default: Any, read_only: bool) -> ParameterDescriptor:
    unit = f' [{info.unit}]' if info.unit else ''
    descriptor = ParameterDescriptor(description=info.description + unit, read_only=read_only)
    if info.minimum is None and info.maximum is None or isinstance(default, (tuple, bool)):
        descriptor.additional_constraints = _constraints(info)
        return descriptor
    low = -UNBOUNDED if info.minimum is None else info.minimum
    high = UNBOUNDED if info.maximum is None else info.maximum
    if isinstance(default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high))]
    else:
        descriptor.integer_range = [IntegerRange(
            from_value=int(max(low, -2**63)), to_value=int(min(high, 2**63 - 1)))]
    return descriptor


def _constraints(info: ParameterInfo) -> str:
    """Return in words what a descriptor has no field for: choices, ranges of arrays."""
    if info.choices:
        return 'one of ' + ', '.join(info.choices)
    bounds = [f'{len(info.elements)} elements'] if info.elements else []
    bounds += [
        f'{word} {bound:g} {info.unit}'.rstrip()
        for word, bound in (('at least', info.minimum), ('at most', info.maximum))
        if bound is not None
    ]
    return ', '.join(bounds)


def _accept_live_changes(
    node: Node, names: dict[str, str], current: list, on_change: Callable, make: Callable
) -> None:
    """Check a change by constructing the dataclass, then hand the new settings to the node."""
    def candidate(parameters):
        changed = {
            names[item.name]: _to_field(item.value)
            for item in parameters if item.name in names
        }
        unchanged = {name: getattr(current[0], name) for name in names.values()}
        return make({**unchanged, **changed}) if changed else current[0]

    def validate(parameters):
        try:
            candidate(parameters)
        except (ParameterError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(parameters):
        settings = candidate(parameters)
        if settings != current[0]:
            current[0] = settings
            on_change(settings)

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply)
