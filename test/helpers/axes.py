"""Axes of a controller for tests, in the form with monitors and in the form with axes."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from types import ModuleType
from typing import Any

try:
    from facade_manipulator.drives.axis import Axis as Axis
except ImportError:
    from facade_manipulator.drives.monitor import AxisMonitor

    def made_axis(name: str, settings: Any, controller: Any, profile: Any) -> Any:
        """Return an axis without a bus."""
        return AxisMonitor(name, settings, controller, profile)
else:

    def made_axis(name: str, settings: Any, controller: Any, profile: Any) -> Any:
        """Return an axis without a bus."""
        return Axis(name, settings, profile, controller)


def axes_of(controller: Any) -> tuple[Any, ...]:
    """Return the axes of a controller."""
    return getattr(controller, 'monitors', None) or controller.axes


def bus_of(controller: Any) -> Any:
    """Return the object that has the exchange of a controller, and why its bus is lost."""
    return getattr(controller, 'bus', controller)


def settings_of(axis: Any) -> Any:
    """Return the settings of an axis."""
    return axis.settings if hasattr(axis, 'settings') else axis.axis


def feedback_of(axis: Any) -> Any:
    """Return the object that has position, counts, statusword, mode and rest of an axis."""
    return getattr(axis, 'feedback', axis)


def warning_of(axis: Any) -> str:
    """Return the warning of a drive."""
    return getattr(axis, 'errors', axis).warning


def silence_of(axis: Any, now: float) -> Any:
    """Return the cause of a stop for silence at a time [s]."""
    silence = axis.silence
    return silence(now) if callable(silence) else silence.cause(now)


def is_homed(group: Any, number: int) -> bool:
    """Return whether the homing of an axis has succeeded."""
    if hasattr(group, 'homing'):
        return bool(group.homing) and group.homing[number].is_homed
    homing = group.axes[number].homing
    return homing is not None and homing.is_homed


def commands_of(group: Any) -> tuple[Any, ...]:
    """Return the present command of each drive."""
    if hasattr(group, 'commands'):
        return group.commands
    return tuple(axis.output.command for axis in group.axes)


def command_all(group: Any, command: Any) -> None:
    """Give one command to all drives."""
    if hasattr(group, 'commands'):
        group.commands = (command,) * 3
        return
    for axis in group.axes:
        axis.output.take(command)


def targets_of(targets: Any, axes: Iterable[Any]) -> tuple[int, ...]:
    """Return the targets of the drives [counts]."""
    if hasattr(targets, 'counts'):
        return targets.counts
    return tuple(axis.output.target for axis in axes)


def module_with_turn_timeout() -> ModuleType:
    """Return the module that limits the time of the SDO answers of one drive."""
    try:
        return import_module('facade_manipulator.drives.waiting')
    except ImportError:
        return import_module('facade_manipulator.drives.requests')
