"""Jerk-limited trajectories of three axes, planned with ruckig."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
import math

import ruckig

from facade_manipulator.errors import ManipulatorError

AXIS_COUNT = 3
PLANNER = ruckig.Ruckig(AXIS_COUNT)
SYNCHRONIZATIONS = ruckig.Synchronization.Phase, ruckig.Synchronization.TimeIfNecessary
LESS_JERK = 1.0 - 1e-6


def plan_trajectory(
    start: Sequence[Sequence[float]],
    goal: Sequence[float] | None,
    speed: Sequence[float],
    acceleration: Sequence[float],
    jerk: Sequence[float],
    backward_speed: Sequence[float] | None = None,
) -> ruckig.Trajectory:
    """
    Return the fastest trajectory within the limits that ends at rest.

    All axes arrive together, and from rest the path is straight. If ruckig finds no such
    trajectory, which rounding can prevent, each axis takes its own time.

    Parameters
    ----------
    start : position, velocity and acceleration, each shape (3,) [m or rad; per s; per s²]
    goal : shape (3,)
        Position at the end; None to come to rest anywhere.
    speed, acceleration, jerk : shape (3,)
        Limit of each axis.
    backward_speed : shape (3,)
        Lowest velocity of each axis, by default the negative speed.

    Raises
    ------
    ManipulatorError
        Ruckig finds no trajectory, which happens for a few motions inside all limits.

    """
    plan = ruckig.InputParameter(AXIS_COUNT)
    plan.current_position, plan.current_velocity, present = start
    limited = zip(present, acceleration, strict=True)
    plan.current_acceleration = [_without_rounding(*axis) for axis in limited]
    plan.max_velocity = speed
    plan.min_velocity = backward_speed
    plan.max_acceleration = acceleration
    if goal is None:
        plan.control_interface = ruckig.ControlInterface.Velocity
    else:
        plan.target_position = goal

    trajectory = ruckig.Trajectory(AXIS_COUNT)
    for synchronization in SYNCHRONIZATIONS:
        plan.synchronization = synchronization
        # At the border between two kinds of trajectory, ruckig may find neither ("error in step
        # 1"): an example is 12 mm from rest with 0.6 m/s² and 6 m/s³. A jerk limit lower by a
        # millionth avoids this.
        for share in (1.0, LESS_JERK):
            plan.max_jerk = [share * most for most in jerk]
            with suppress(ruckig.RuckigError):
                if PLANNER.calculate(plan, trajectory) == ruckig.Result.Working:
                    return trajectory
    end = 'rest' if goal is None else f'{goal} m'
    raise ManipulatorError(
        f'no jerk-limited path from {start[0]} m to {end}; next: choose another goal'
    )


ACCELERATION_ROUNDING = 1e-9  # relative tolerance of an acceleration at its limit


def _without_rounding(value: float, limit: float) -> float:
    """
    Return the limit if rounding errors have moved an acceleration beyond it.

    Ruckig rejects such an acceleration. Ruckig accepts an acceleration far beyond the limit, which
    occurs after the limit was lowered.
    """
    if limit < abs(value) < limit * (1.0 + ACCELERATION_ROUNDING):
        return math.copysign(limit, value)
    return value
