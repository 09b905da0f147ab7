"""
Pictures of the bench: one of each scenario, one of the sweep.

Only the bench imports this module, and matplotlib with it.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
import numpy as np

from facade_manipulator.compensation import SuspensionSettings
from facade_manipulator.lab.gondola.closed_loop import LoopStep
from facade_manipulator.lab.gondola.facade import Facade
from facade_manipulator.lab.gondola.pictures import (
    amplitudes,
    draw_course,
    draw_force,
    draw_gondola,
    draw_path,
    draw_spectra,
    label,
    new_figure,
    plain_ticks,
    save,
    TITLES,
    WITH,
    WITHOUT,
)
from facade_manipulator.lab.gondola.wall import AXES, SCALES

PUSH_BACK, YAW, BESIDE = 0.1, 5.0, 0.1  # m, degrees, m: what depth and width allow
GUIDES = ((0.0, 0.0), (60.0, 0.6), (200.0, 0.6), (600.0, 0.6))  # N/m, m


def draw_scenario(path: Path, name: str, steps: Sequence[LoopStep], pressed: float | None) -> None:
    """
    Draw the courses, the path on the wall and the spectra of a run into a PNG file.

    Where there is a wall, `pressed` is the desired force [N], and the force is drawn, too.
    """
    steps = [step for step in steps if step.sample.error is not None]
    times = np.array([step.sample.time for step in steps])
    times -= times[0]
    heads, errors, uncompensated = (
        np.array([getattr(step.sample, part) for step in steps])
        for part in ('head', 'error', 'uncompensated'))
    settled = np.array([step.sample.settled for step in steps])
    figure = new_figure(13, 9, name)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.6, 1.0))
    for i, title in enumerate(TITLES):
        panel = figure.add_subplot(grid[i, 0])
        draw_course(panel, times, SCALES[i] * uncompensated[:, i], SCALES[i] * errors[:, i])
        label(panel, 'time [s]' if i == 2 else '', title)
    figure.axes[0].legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8,
                          frameon=False)
    draw_path(figure.add_subplot(grid[0, 1]),
              heads[settled], errors[settled], uncompensated[settled])
    (frequencies, without), (_, error) = (
        amplitudes(1e3 * values[:, 0], times[1] - times[0], counts)
        for values, counts in ((uncompensated, np.ones_like(settled)), (errors, settled)))
    draw_spectra(figure.add_subplot(grid[1, 1]), frequencies, without, error,
                 'amplitude of x [mm]')
    _draw_hold(figure, grid[2, 1], times, steps, pressed)
    save(figure, path)


def draw_sweep(path: Path, sweep: Sequence[dict]) -> None:
    """Draw the residual over the frequency as a share of the disturbance."""
    _draw_lines(
        path, 'Sines of one frequency along all axes', [item['frequency_hz'] for item in sweep],
        {title.split(' [')[0]: [100.0 * item[axis] for item in sweep]
         for axis, title in zip(AXES, TITLES, strict=True)}, 100.0,
        ('frequency [Hz]', 'residual [% of the disturbance, RMS]'), marker='o', ms=4)


def draw_forces(path: Path) -> None:
    """Draw the most that a gondola can press with against the length of its cables."""
    lengths = np.geomspace(5.0, 150.0, 100)
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


def _draw_hold(
    figure: Figure, place: SubplotSpec, times: np.ndarray, steps: Sequence[LoopStep],
    pressed: float | None,
) -> None:
    """Draw force on the wall and gondola; without a wall, by how much its limit holds x back."""
    if pressed is None:
        saturation_error = [1e3 * step.corrected.saturation_error.x for step in steps]
        panel = figure.add_subplot(place)
        panel.plot(times, saturation_error, color=WITH, lw=1.0)
        most = 1.05 * max(1.0, *map(abs, saturation_error))
        panel.set_ylim(-most, most)
        label(panel, 'time [s]', 'held back of x [mm]')
        return
    forces = np.array([Facade.force_on_wall(step.sample.head, step.wrench) for step in steps])
    force, gondola = place.subgridspec(2, 1).subplots(sharex=True)
    draw_force(force, times, forces, pressed)
    draw_gondola(gondola, times, np.array([step.rail for step in steps]))
    force.set_xlabel('')
