"""
Pictures of the bench: one of each scenario, one of the sweep.

Only the bench imports this module, and matplotlib with it.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.closed_loop import Step
from facade_manipulator.simulation.facade import Facade

TITLES = ('x, along the wall [mm]', 'y, to the wall [mm]', 'θ, yaw [°]')
SCALES = np.array([1e3, 1e3, 180.0 / math.pi])
WITHOUT, WITH, GOAL = '#999999', '#0072b2', '#d55e00'
DOTS_PER_INCH = 110


def draw_scenario(path: Path, name: str, steps: Sequence[Step], pressed: float | None) -> None:
    """
    Draw the courses, the path on the wall, the spectra and, if pressed, the force of a run.

    Parameters
    ----------
    path : pathlib.Path
        PNG file to write.
    name : str
        Of the scenario.
    steps : sequence of Step
    pressed : float or None
        Desired force on the wall [N], None without a wall.

    """
    steps = [step for step in steps if step.sample.error is not None]
    times = np.array([step.sample.time for step in steps])
    times -= times[0]
    errors, uncompensated = (
        SCALES * np.array([getattr(step.sample, part) for step in steps])
        for part in ('error', 'uncompensated'))
    figure = Figure(figsize=(13, 9), layout='constrained')
    grid = figure.add_gridspec(3, 2, width_ratios=(1.6, 1.0))
    for i, title in enumerate(TITLES):
        panel = figure.add_subplot(grid[i, 0])
        panel.plot(times, uncompensated[:, i], color=WITHOUT, lw=1.0, label='not compensated')
        panel.plot(times, errors[:, i], color=WITH, lw=1.0, label='error on the wall')
        _label(panel, 'time [s]' if i == 2 else '', title)
    figure.axes[0].legend(loc='upper right', ncols=2, fontsize=8)
    _draw_path(figure.add_subplot(grid[0, 1]), steps)
    _draw_spectra(figure.add_subplot(grid[1, 1]), steps)
    _draw_force(figure.add_subplot(grid[2, 1]), times, steps, pressed)
    figure.suptitle(name)
    _save(figure, path)


def draw_sweep(path: Path, sweep: Sequence[dict]) -> None:
    """Draw the residual over the frequency as a share of the disturbance."""
    figure = Figure(figsize=(8, 5), layout='constrained')
    panel = figure.add_subplot()
    frequencies = [item['frequency_hz'] for item in sweep]
    for axis, label in zip(Pose._fields, TITLES, strict=True):
        panel.loglog(frequencies, [100.0 * item[axis] for item in sweep], marker='o', ms=4,
                     label=label.split(' [')[0])
    panel.axhline(100.0, color=WITHOUT, ls='--', lw=1.0)
    panel.legend()
    _label(panel, 'frequency [Hz]', 'residual [% of the disturbance, RMS]')
    figure.suptitle('Sines of one frequency along all axes')
    _save(figure, path)


def _draw_path(panel: Axes, steps: Sequence[Step]) -> None:
    """Draw the path of the head on the wall, as in Park et al., Figure 12."""
    settled = [step.sample for step in steps if step.sample.settled]
    goals = np.array([np.subtract(sample.head, sample.error) for sample in settled])
    heads = np.array([sample.head for sample in settled])
    standing = goals + np.array([sample.uncompensated for sample in settled])
    for places, colour, size, label in (
            (standing, WITHOUT, 1, 'not compensated'), (heads, WITH, 1, 'head'),
            (np.unique(goals.round(6), axis=0), GOAL, 30, 'goals')):
        panel.scatter(1e3 * places[:, 0], 1e3 * places[:, 1], s=size, color=colour, label=label)
    panel.set_aspect('equal', adjustable='datalim')
    panel.legend(fontsize=8, markerscale=1.5)
    _label(panel, 'x on the wall [mm]', 'y [mm]')


def _draw_spectra(panel: Axes, steps: Sequence[Step]) -> None:
    """Draw the amplitude spectra of x: not compensated, and what remains."""
    period = steps[1].sample.time - steps[0].sample.time
    for part, colour, label in (
            ('uncompensated', WITHOUT, 'not compensated'), ('error', WITH, 'error on the wall')):
        values = np.array([
            getattr(step.sample, part).x if step.sample.settled else 0.0 for step in steps])
        window = np.hanning(len(values))
        amplitudes = 2.0 * np.abs(np.fft.rfft(values * window)) / window.sum()
        frequencies = np.fft.rfftfreq(len(values), period)
        panel.loglog(frequencies[1:], 1e3 * amplitudes[1:], color=colour, lw=1.0, label=label)
    panel.set_xlim(0.02, 10.0)
    panel.set_ylim(1e-4, 300.0)
    panel.legend(fontsize=8)
    _label(panel, 'frequency [Hz]', 'amplitude of x [mm]')


def _draw_force(
    panel: Axes, times: np.ndarray, steps: Sequence[Step], pressed: float | None
) -> None:
    """Draw the force on the wall; without a wall, by how much the border holds x back."""
    if pressed is None:
        excess = [1e3 * step.corrected.excess.x for step in steps]
        panel.plot(times, excess, color=WITH, lw=1.0)
        _label(panel, 'time [s]', 'x held back at the border [mm]')
        return
    forces = [Facade.force_on_wall(step.sample.head, step.wrench) for step in steps]
    panel.plot(times, forces, color=WITH, lw=1.0)
    panel.axhline(pressed, color=GOAL, ls='--', lw=1.0)
    _label(panel, 'time [s]', 'force on the wall [N]')


def _label(panel: Axes, x: str, y: str) -> None:
    panel.set_xlabel(x)
    panel.set_ylabel(y)
    panel.grid(alpha=0.3)
    panel.margins(x=0.01)


def _save(figure: Figure, path: Path) -> None:
    with matplotlib.rc_context():
        figure.savefig(path, dpi=DOTS_PER_INCH)
