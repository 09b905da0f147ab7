"""
Pictures of the bench: one of each scenario, one of the sweep.

Only the bench imports this module, and matplotlib with it.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

import numpy as np

from facade_manipulator.compensation import SuspensionSettings
from facade_manipulator.lab.gondola.closed_loop import LoopStep
from facade_manipulator.lab.gondola.course import Course, figures, giving_way
from facade_manipulator.lab.gondola.facade import Facade
from facade_manipulator.lab.gondola.pictures import (
    label,
    new_figure,
    plain_ticks,
    pressing,
    save,
    time_courses,
    TITLES,
    WITHOUT,
)
from facade_manipulator.lab.gondola.scenario import Scenario
from facade_manipulator.lab.gondola.wall import AXES

PUSH_BACK, YAW, BESIDE = 0.1, 5.0, 0.1  # m, degrees, m: what depth and width allow
GUIDES = ((0.0, 0.0), (60.0, 0.6), (200.0, 0.6), (600.0, 0.6))  # N/m, m


def draw_scenario(
    path: Path, title: str, steps: Sequence[LoopStep], scenario: Scenario
) -> None:
    """Draw the courses of a run into a PNG file; beside it the force, where there is a wall."""
    steps = [step for step in steps if step.sample.error is not None]
    times = np.array([step.sample.time for step in steps])
    heads, errors = (np.array([getattr(step.sample, part) for step in steps])
                     for part in ('head', 'error'))
    course = Course(times - times[0], heads, [step.rail for step in steps], heads - errors,
                    heads - errors, np.array([step.sample.settled for step in steps]))
    save(time_courses(course, figures(course), giving_way(scenario), title), path)
    if scenario.facade.present:
        forces = np.array([Facade.force_on_wall(step.sample.head, step.wrench) for step in steps])
        save(pressing(course, course.times, forces, scenario.compensator.impedance.force),
             path.with_stem(f'{path.stem}_force'))


def draw_sweep(path: Path, sweep: Sequence[dict[str, Any]]) -> None:
    """Draw the residual over the frequency as a share of the disturbance."""
    _draw_lines(
        path, 'Sines of one frequency along all axes', [item['frequency_hz'] for item in sweep],
        {title.split(' [')[0]: [100.0 * item[axis] for item in sweep]
         for axis, title in zip(AXES, TITLES, strict=True)}, 100.0,
        ('frequency [Hz]', 'residual [% of the disturbance, RMS]'), marker='o', ms=4)


def draw_forces(path: Path) -> None:
    """Draw the most that a gondola can press with against the length of its cables."""
    lengths = np.geomspace(5.0, 150.0, 100).tolist()
    _draw_lines(
        path, f'500 kg: pushed back by {1e3 * PUSH_BACK:g} mm or turned by {YAW:g}° '
        f'at {1e3 * BESIDE:g} mm beside the middle', lengths,
        {f'guide {stiffness:g} N/m at ±{lever:g} m' if stiffness else 'no guide': [
            _most_force(SuspensionSettings(mass=500.0, cable_length=length,
                                           guide_stiffness=stiffness, guide_lever=lever))
            for length in lengths] for stiffness, lever in GUIDES}, 30.0,
        ('free length of the cables [m]', 'force on the wall [N]'))


def _draw_lines(
    path: Path, title: str, x: Sequence[float], lines: dict[str, Sequence[float]], level: float,
    names: tuple[str, str], **look: Any,
) -> None:
    """Draw lines over x, by their names in the legend, and a level, all to logarithmic scales."""
    figure = new_figure(8, 5, title)
    panel = figure.add_subplot()
    for name, y in lines.items():
        panel.loglog(x, y, label=name, **look)
    plain_ticks(panel.xaxis)
    plain_ticks(panel.yaxis)
    panel.axhline(level, color=WITHOUT, ls='--', lw=1.0)
    panel.legend()
    label(panel, *names)
    save(figure, path)


def _most_force(suspension: SuspensionSettings) -> float:
    return min(PUSH_BACK / suspension.push_back(1.0),
               math.radians(YAW) / suspension.yaw(1.0, BESIDE))
