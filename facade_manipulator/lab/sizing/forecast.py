"""
Is a gondola compensable: what will be left on the wall, and how long its goals are in reach.

The loop of the product runs with the lengths, limits and compensator of the machine, in simulated
time and several times, each with gusts and noise of its own: one run is one outcome of many.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from facade_manipulator.compensation import CompensatorSettings
from facade_manipulator.errors import LimitError, ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab import gondola
from facade_manipulator.lab.gondola import Scenario
from facade_manipulator.motion import MotionLimits
from facade_manipulator.parameter_file import ALL_NODES, read_parameters, read_settings

SETTLED = 20.0  # s, after which nothing fades in any more
SHORTEST = 30.0  # s, of a run
FORECAST = ('scenario', 'axis', 'moves', 'left [mm, mm, °]', 'in the best run', 'in the worst',
            'goals in reach [%]')
OUTSIDE = 1e-4  # m or rad, of which a pose is held back at least where it counts as outside


class Residual(NamedTuple):
    """Root mean squares of a run from `SETTLED` on, of x, y, θ [m, m, rad]."""

    moves: np.ndarray  #: of a head on the wall that is not compensated
    left: np.ndarray  #: of the head's error on its path on the wall
    inside: float  #: share of the time in which the workspace holds nothing back


def machine_loop(path: Path, scenario: Scenario) -> gondola.ClosedLoop:
    """
    Return the loop of a scenario on the machine of a parameter file.

    What the scenario asks of the compensator goes before the file. Raises a ParameterError for
    what is no such file.
    """
    return gondola.ClosedLoop(
        read_settings([path], ALL_NODES, 'geometry', Geometry),
        scenario._replace(compensator=CompensatorSettings.of(
            read_parameters([path], 'compensator') | gondola.compensator_parameters(scenario))),
        scenario.motion(), limits=read_settings([path], 'driver', 'limits', MotionLimits))


def residual(scenario: Scenario, path: Path) -> Residual:
    """Run a scenario, as `machine_loop`; a ManipulatorError is for a goal never in reach."""
    loop = machine_loop(path, scenario)
    begin = loop.now + SETTLED
    try:
        steps = [step for step in loop.mission(max(scenario.mission.duration, SHORTEST))
                 if step.sample.time >= begin]
    except LimitError as error:  # it cannot go between processes
        raise ManipulatorError(f'a goal is out of reach: {error}') from error
    return residual_of(steps)


def residual_of(steps: Sequence[gondola.LoopStep]) -> Residual:
    """Return what cycles of a loop, of whichever drives, left."""
    course = gondola.course_of_steps(steps)
    inside = [max(map(abs, step.corrected.saturation_error)) <= OUTSIDE
              for step in steps if step.corrected]
    moves, left = (gondola.rms(values[course.counts])
                   for values in (course.uncompensated, course.errors))
    return Residual(moves, left, float(np.mean(inside)))


def rows(residuals: Iterable[Residual]) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Yield each axis with its figures of all runs in mm or degrees, and the share in percent."""
    moves, left, inside = map(np.array, zip(*residuals, strict=True))
    columns = gondola.rms(moves), gondola.rms(left), left.min(axis=0), left.max(axis=0)
    for axis, scale, values in zip(
            gondola.AXES, gondola.SCALES, np.transpose(columns), strict=True):
        yield axis, (*(scale * values).tolist(), 100.0 * float(inside.mean()))
