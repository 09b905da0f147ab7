"""Settings dataclasses as described ROS parameters: one check for YAML, tests and live changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from facade_manipulator.errors import ParameterError
from facade_manipulator.files import checksum
from facade_manipulator.parameters import (
    check_type,
    check_value,
    METADATA_KEY,
    names_in_full,
    parameter_fields,
    parameter_names,
    ParameterInfo,
)
from facade_manipulator.ros.rclpy_internals import given_parameter

Settings = TypeVar('Settings')
UNBOUNDED = 1e308  # what a descriptor calls no bound


def declare(
    node: Node,
    settings_class: type[Settings],
    prefix: str = '',
    on_change: Callable[[Settings], None] | None = None,
    check: Callable[[Settings], object] | None = None,
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
    names = parameter_names(settings_class, prefix)
    fixed = {name: value for name, value in defaults.items() if name not in known}
    values = {
        name: _declare_one(
            node, full_name, known[name].metadata[METADATA_KEY],
            defaults.get(name, known[name].default), on_change is None)
        for full_name, name in names.items()}

    def checked(make: Callable[..., Settings], values: dict[str, Any]) -> Settings:
        with names_in_full(settings_class, prefix):
            made = make(**values)
            if check is not None:
                check(made)
        return made

    current = checked(partial(settings_class, **fixed), values)
    if on_change is not None:
        _accept_live_changes(node, names, current, on_change, checked)
    return current


def parameter_checksum(node: Node) -> str:
    """Return eight hexadecimal digits that are the same where all parameters have one value."""
    values = sorted(
        (name, repr(one.value))  # type: ignore[union-attr]  # they are Parameters
        for name, one in node.get_parameters_by_prefix('').items())
    return checksum(repr(values).encode())


def _declare_one(
    node: Node, name: str, info: ParameterInfo, default: Any, read_only: bool
) -> Any:
    descriptor = _descriptor(info, default, info.read_only or read_only)
    initial = list(default) if isinstance(default, tuple) else default
    given = given_parameter(node, name)
    if given is not None:  # rclpy would name no unit and the parameter twice
        value = _to_field(given.value)
        check_type(name, value, default)
        check_value(name, value, info)
    return _to_field(node.declare_parameter(name, initial, descriptor).value)


def _to_field(value: Any) -> Any:
    is_array = value is not None and not isinstance(value, (bool, int, float, str))
    return tuple(value) if is_array else value


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
    node: Node, names: dict[str, str], current: Any, on_change: Callable[[Any], None],
    checked: Callable[..., Any],
) -> None:
    """Check a change by constructing the dataclass, then hand the new settings to the node."""
    def candidate(parameters: list[Parameter]) -> Any:
        changed = {
            names[item.name]: _to_field(item.value)
            for item in parameters if item.name in names
        }
        return checked(partial(replace, current), changed) if changed else current

    def validate(parameters: list[Parameter]) -> SetParametersResult:
        try:
            candidate(parameters)
        except (ParameterError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def apply(parameters: list[Parameter]) -> None:
        nonlocal current
        settings = candidate(parameters)
        if settings != current:
            current = settings
            on_change(settings)

    node.add_on_set_parameters_callback(validate)
    node.add_post_set_parameters_callback(apply)
