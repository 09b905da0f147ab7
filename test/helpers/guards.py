"""Source of targets and its guard, as parts of a controller."""

from typing import Any

from facade_manipulator.control_loop import control_loop
from facade_manipulator.control_loop.loop_channel import LoopSetup
from facade_manipulator.drives.guard import Unguarded


def guarded_follower(setup: LoopSetup, checks: dict[str, Any]) -> tuple[Any, ...]:
    """Return the follower of a setup, and the parts of a controller with other checks."""
    follower, guard = control_loop.guarded_follower(setup)
    vars(guard).update(checks)
    return follower, follower, guard


def unguarded(source: Any) -> tuple[Any, ...]:
    """Return the parts of a controller without checks."""
    return source, Unguarded()


def spoil_measured(supervisor: Any, near: tuple[float, ...]) -> None:
    """Let a supervisor of targets see measured positions as others that are too near [m]."""
    guard = supervisor.guard
    guard.check_measured = lambda _: guard.check_targets(near)
