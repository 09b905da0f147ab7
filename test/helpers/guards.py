"""Source of targets and its guard, as parts of a controller."""

from dataclasses import replace
from typing import Any

from facade_manipulator.control_loop import control_loop
from facade_manipulator.control_loop.channel import LoopSetup
from facade_manipulator.drives import targets


def guarded_follower(setup: LoopSetup, checks: dict[str, Any]) -> tuple[Any, ...]:
    """Return the follower of a setup, and the parts of a controller with other checks."""
    if hasattr(control_loop, 'checked_follower'):
        follower, checked = control_loop.checked_follower(setup)
        return follower, replace(checked, **checks)
    follower, guard = control_loop.guarded_follower(setup)
    vars(guard).update(checks)
    return follower, follower, guard


def unguarded(source: Any) -> tuple[Any, ...]:
    """Return the parts of a controller without checks."""
    if hasattr(targets, 'MechanismChecks'):
        return (targets.MechanismChecks(source),)
    from facade_manipulator.drives.guard import Unguarded

    return source, Unguarded()


def spoil_measured(supervisor: Any, near: tuple[float, ...]) -> None:
    """Let a supervisor of targets see measured positions as others that are too near [m]."""
    if hasattr(supervisor, 'mechanism'):
        checks = supervisor.mechanism
        supervisor.mechanism = replace(
            checks, check_actual=lambda _: checks.check_targets(near)
        )
    else:
        guard = supervisor.guard
        guard.check_measured = lambda _: guard.check_targets(near)
