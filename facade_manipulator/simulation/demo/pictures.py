"""Pictures of a run: time courses, spectra, the path on the wall and the pressing force."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.kinematics import Pose
from facade_manipulator.simulation.demo.recording import (
    carried,
    decibels,
    figures,
    Run,
    SCALES,
    UNITS,
    yielding_axes,
)

TITLES = ('x, along the wall', 'y, to the wall', 'θ, yaw')
WITHOUT, WITH, GOAL = '#999999', '#0072b2', '#cc79a7'
BEFORE: dict[str, Any] = {'color': WITHOUT, 'lw': 1.0, 'label': 'without compensation'}
AFTER: dict[str, Any] = {'color': WITH, 'lw': 1.0, 'label': 'with compensation'}
DOTS_PER_INCH = 110
FREQUENCIES = (0.02, 10.0)  # Hz, between which spectra are drawn
BANDS_PER_DECADE = 12
LEAST_SHARE = 0.01  # of the largest amplitude, below which a band has no disturbance to compare
FORCE_TIME = 0.1  # s, over which the force is averaged: the noise of a reading is 0.5 N
TOUCH = 1.0  # N, above which the averaged force is a contact
YIELDS = 'yields to the contact force on purpose'
ELAPSED = 'time since the first goal [s]'


def new_figure(width: float, height: float, title: str) -> Figure:
    """Return an empty figure of a size in inches."""
    figure = Figure(figsize=(width, height), layout='constrained')
    figure.suptitle(title, fontsize=13)
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whatever the name's ending."""
    figure.savefig(path, dpi=DOTS_PER_INCH, format='png')


def label(panel: Axes, x: str, y: str, title: str = '') -> None:
    """Name a panel and its axes, units included."""
    panel.set(xlabel=x, ylabel=y)
    panel.set_title(title, loc='left', fontsize=10)
    panel.grid(alpha=0.3)
    panel.margins(x=0.01)


def time_courses(run: Run) -> Figure:
    """Draw the error over the run, without and with compensation, and with it magnified."""
    figure = new_figure(13, 9, 'How far the head is from where it should be on the wall')
    panels = figure.subplots(3, 2, sharex=True, width_ratios=(1.2, 1.0))
    without, errors = SCALES * run.uncompensated, SCALES * run.errors
    for i, (pair, (axis, result)) in enumerate(zip(panels, figures(run).items(), strict=True)):
        pair[0].plot(run.times, without[:, i], **BEFORE)
        for panel in pair:
            panel.plot(run.times, errors[:, i], **AFTER)
            panel.fill_between(
                run.times, 0.0, 1.0, ~run.is_counted, transform=panel.get_xaxis_transform(),
                color=GOAL, alpha=0.12, lw=0.0,
                label='not counted: learning, or on the way to a goal')
        before, after = (f'{SCALES[i] * result[key]:.3g} {UNITS[i]}'
                         for key in ('disturbance_rms', 'residual_rms'))
        title = f'RMS {before} → {after} ({decibels(result["attenuation_db"])})'
        if axis in yielding_axes(run.scenario):
            title = YIELDS
        last = ELAPSED if i == 2 else ''
        label(pair[0], last, f'{TITLES[i]} [{UNITS[i]}]', title)
        label(pair[1], last, f'{TITLES[i]} [{UNITS[i]}]', 'with compensation, magnified')
        most = 1.5 * np.abs(errors[run.is_counted, i]).max()
        pair[1].set_ylim(-most, most)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  frameon=False)
    return figure


def spectrum(run: Run) -> Figure:
    """Draw amplitudes and attenuation against the frequency, of each axis."""
    figure = new_figure(13, 7, 'Which frequencies of the error the compensation takes away')
    panels = figure.subplots(2, 3, sharex=True)
    times = np.linspace(run.times[0], run.times[-1], len(run.times))
    # no sample across an end of the counted ones
    used = np.interp(times, run.times, run.is_counted) >= 1.0
    for i, (above, below) in enumerate(panels.T):
        without, error = (np.interp(times, run.times, SCALES[i] * values[:, i])
                          for values in (run.uncompensated, run.errors))
        frequencies, present = amplitudes(without, times[1], np.ones_like(used))
        before, after = (amplitudes(values, times[1], used)[1] for values in (without, error))
        above.loglog(frequencies, present, **BEFORE)
        above.loglog(frequencies, after, **AFTER)
        above.set(xlim=FREQUENCIES, ylim=(1e-4, 1e3))
        above.legend(fontsize=8)
        yields = Pose._fields[i] in yielding_axes(run.scenario)
        label(above, '', f'amplitude [{UNITS[i]}]', TITLES[i] + (f': {YIELDS}' if yields else ''))
        below.semilogx(*attenuation(frequencies, before, after, present), color=WITH, marker='o',
                       ms=4, lw=1.0)
        below.axhline(0.0, color=WITHOUT, ls='--', lw=1.0)
        label(below, 'frequency [Hz]', 'attenuation [dB]')
    return figure


def amplitudes(
    values: np.ndarray, period: float, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return frequencies above 0 [Hz] and amplitudes of samples of which only some count.

    They are a period [s] apart. An amplitude is that of a sine of its frequency, in their unit.
    """
    window = np.hanning(len(values)) * counts
    weight = max(window.sum(), np.finfo(float).tiny)
    centred = (values - np.dot(window, values) / weight) * window
    return (np.fft.rfftfreq(len(values), period)[1:],
            2.0 * np.abs(np.fft.rfft(centred))[1:] / weight)


def attenuation(
    frequencies: np.ndarray, without: np.ndarray, error: np.ndarray, present: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return frequency [Hz] and attenuation [dB] of the bands that have a disturbance.

    Amplitudes without compensation and of the error are over the same samples: what leaks into a
    neighbouring band leaks in both. Those over all samples show where there is a disturbance.
    """
    low, high = FREQUENCIES
    bands = np.floor(BANDS_PER_DECADE * np.log10(frequencies / low))
    bands[frequencies > high] = -1.0
    found = [inside for inside in (bands == band for band in np.unique(bands[bands >= 0.0]))
             if present[inside].max() > LEAST_SHARE * present.max() and without[inside].any()]
    return (np.array([frequencies[inside].mean() for inside in found]),
            np.array([10.0 * np.log10(np.sum(without[inside] ** 2) / np.sum(error[inside] ** 2))
                      for inside in found]))


def paths(run: Run) -> Figure:
    """Draw the path on the wall and, as they are too small to see on it, the errors."""
    figure = new_figure(13, 7, 'Path of the head on the wall, seen from above')
    wide, left, right = figure.subplot_mosaic(
        [['wide', 'wide'], ['without', 'with']], height_ratios=(1.0, 1.1)).values()
    goals = np.unique(run.goals.round(6), axis=0)
    for places, colour, size, text in (  # as in Park et al., Figure 12
            (carried(run.rails, run.goals), WITHOUT, 1, 'head without compensation'),
            (run.heads, WITH, 1, 'head with compensation'), (goals, GOAL, 20, 'goals')):
        x, y, _ = 1e3 * places.T
        wide.scatter(x, y, s=size, color=colour, label=text)
    label(wide, 'x along the wall [mm]', 'y to the wall [mm]')
    wide.legend(fontsize=8)
    for panel, errors, colour, title in (
            (left, run.uncompensated, WITHOUT, 'error without compensation'),
            (right, run.errors, WITH, 'error with compensation (other scale)')):
        counted = np.where(run.is_counted[:, None], 1e3 * errors, np.nan)
        panel.plot(*counted[:, :2].T, color=colour, lw=0.8)
        panel.plot(0.0, 0.0, '+', color=GOAL, ms=12)
        label(panel, 'error in x [mm]', 'error in y [mm]', title)
    for panel in (wide, left, right):
        panel.set_aspect('equal', adjustable='datalim')
    return figure


def force(run: Run) -> Figure:
    """Draw the force on the wall, and the gondola's motion below it."""
    figure = new_figure(10, 7, 'Force with which the head presses on the wall')
    panel, below = figure.subplots(2, 1, sharex=True)
    count = max(round(FORCE_TIME / np.median(np.diff(run.times))), 1)
    total, samples = (np.convolve(values, np.ones(count), 'same')
                      for values in (run.forces, np.ones_like(run.forces)))
    forces = total / samples
    panel.plot(run.times, forces, color=WITH, lw=1.0, label=f'mean of {FORCE_TIME:g} s')
    if (desired := run.scenario.compensator.get('contact.force')) is not None:
        panel.axhline(desired, color=GOAL, ls='--', lw=1.0, label='desired')
    panel.axhline(TOUCH, color=WITHOUT, ls=':', lw=1.0, label=f'contact above {TOUCH:g} N')
    touches = forces > TOUCH
    mean = forces[touches].mean() if touches.any() else 0.0
    label(panel, '', 'force [N]', f'in contact for {100.0 * touches.mean():.3g} % of the time, '
          f'mean force then {mean:.3g} N, highest {forces.max():.3g} N')
    yaw = below.twinx()
    for i, (axes, colour, side) in enumerate((
            (below, WITHOUT, ''), (below, WITH, ''), (yaw, GOAL, ' (right axis)'))):
        axes.plot(run.times, SCALES[i] * run.rails[:, i], color=colour, lw=1.0)
        below.plot([], [], color=colour, lw=1.0, label=TITLES[i] + side)
    yaw.set_ylabel('gondola, yaw [°]')
    label(below, ELAPSED, 'gondola [mm]', 'motion of the gondola')
    for axes in (panel, below):
        axes.legend(loc='lower right', ncols=3, fontsize=8)
    return figure
