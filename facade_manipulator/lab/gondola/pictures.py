"""
Pictures of a run: time courses, spectra, the path on the wall and the pressing force.

Whoever imports this module imports matplotlib with it. Poses are rows of x, y, θ [m, m, rad].
"""

from __future__ import annotations

from collections.abc import Collection
import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.lab.gondola.course import Course, decibels
from facade_manipulator.lab.gondola.wall import AXES, SCALES, UNITS

TITLES = ('x, along the wall [mm]', 'y, to the wall [mm]', 'θ, yaw [°]')
WITHOUT, WITH, GOAL = '#999999', '#0072b2', '#d55e00'
DOTS_PER_INCH = 110
LOWEST, HIGHEST = 0.02, 10.0  # Hz, between which spectra are drawn
BANDS_PER_DECADE = 12
YIELDS = 'yields to the contact force: an offset from the goal is intended'
LEAST_SHARE = 0.01  # of the largest amplitude: where there is no disturbance there is no ratio


def new_figure(width: float, height: float, title: str, size: float = 12.0) -> Figure:
    """Return an empty figure of a size in inches under a title of a size in points."""
    figure = Figure(figsize=(width, height), layout='constrained')
    figure.suptitle(title, fontsize=size)
    return figure


def time_courses(course: Course, axes: dict[str, Any], giving_way: Collection[str]) -> Figure:
    """
    Draw the error on the wall over the run, with and without, and magnified.

    It is that from the head's path to the goal; with the summary's figures, but for axes that give
    way to the wall.
    """
    figure = new_figure(13, 9, 'Error of the head on the wall', 13.0)
    panels = figure.subplots(3, 2, sharex=True, width_ratios=(1.2, 1.0))
    without, errors = (np.multiply(SCALES, of) for of in (course.uncompensated, course.errors))
    for i, (pair, (axis, result)) in enumerate(zip(panels, axes.items(), strict=True)):
        pair[0].plot(course.times, without[:, i], color=WITHOUT, lw=1.0,
                     label='without compensation')
        pair[0].plot(course.times, errors[:, i], color=WITH, lw=1.0, label='with compensation')
        pair[1].plot(course.times, errors[:, i], color=WITH, lw=0.8)
        for panel in pair:
            panel.fill_between(
                course.times, 0.0, 1.0, ~course.settled, transform=panel.get_xaxis_transform(),
                color=GOAL, alpha=0.12, lw=0.0, label='on the way to the next goal (not counted)')
            label(panel, '', TITLES[i])
        most = 1.5 * np.abs(errors[course.counts, i]).max()
        pair[1].set_ylim(-most, most)
        pair[0].set_title(YIELDS if axis in giving_way else _figures(result, i), loc='left',
                          fontsize=10)
    panels[0, 0].set_title(panels[0, 0].get_title('left') + (
        ', at goals' if course.settled.any() else ', on the way to goals'), loc='left',
        fontsize=10)
    panels[0, 1].set_title('with compensation, magnified', loc='left', fontsize=10)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  frameon=False)
    for panel in panels[-1]:
        panel.set_xlabel('time since the first goal [s]')
    return figure


def spectrum(course: Course, giving_way: Collection[str]) -> Figure:
    """Draw amplitudes and attenuation against the frequency, of each axis."""
    times = np.linspace(course.times[0], course.times[-1], len(course.times))
    used = np.interp(times, course.times, course.counts) >= 1.0  # no sample across an end of them
    figure = new_figure(13, 7, 'Spectrum of the error on the wall')
    panels = figure.subplots(2, 3, sharex=True, sharey='row')
    without, errors = (np.multiply(SCALES, of) for of in (course.uncompensated, course.errors))
    for i, (axis, title) in enumerate(zip(AXES, TITLES, strict=True)):
        (frequencies, present), (_, before), (_, after) = (
            amplitudes(np.interp(times, course.times, values[:, i]), times[1] - times[0], counts)
            for values, counts in (
                (without, np.ones_like(used)), (without, used), (errors, used)))
        panels[0, i].loglog(frequencies, present, color=WITHOUT, lw=1.0,
                            label='without compensation')
        panels[0, i].loglog(frequencies, after, color=WITH, lw=1.0, label='with compensation')
        panels[0, i].set(xlim=(LOWEST, HIGHEST), ylim=(1e-4, 1e3))
        panels[0, i].legend(fontsize=8)
        label(panels[0, i], '', f'amplitude [{UNITS[i]}]')
        panels[1, i].semilogx(*attenuation(frequencies, before, after, present),
                              color=WITH, marker='o', ms=4, lw=1.0)
        panels[1, i].axhline(0.0, color=WITHOUT, ls='--', lw=1.0)
        panels[1, i].set_xlim(LOWEST, HIGHEST)
        panels[0, i].set_title(title.split(' [')[0] + (
            ': yields to the contact force' if axis in giving_way else ''), fontsize=10)
        label(panels[1, i], 'frequency [Hz]', 'attenuation [dB]')
    for panel in panels.flat:
        panel.label_outer()
    return figure


def paths(course: Course) -> Figure:
    """Draw the path on the wall, and the errors alone, which are too small to see on it."""
    figure = new_figure(13, 7, 'Path of the head on the wall')
    wide, *close = figure.subplot_mosaic(
        [['wide', 'wide'], ['without', 'with']], height_ratios=(1.0, 1.1)).values()
    for places, colour, size, text in (  # as in Park et al., Figure 12
            (course.goals + course.carried(course.goals), WITHOUT, 1, 'without compensation'),
            (course.heads, WITH, 1, 'with compensation'),
            (np.unique(course.goals.round(6), axis=0), GOAL, 20, 'goals')):
        wide.scatter(1e3 * places[:, 0], 1e3 * places[:, 1], s=size, color=colour, label=text)
    wide.set_aspect('equal', adjustable='datalim')
    wide.legend(fontsize=8)
    label(wide, 'x on the wall [mm]', 'y from the rail [mm]')
    for panel, errors, colour, title in (
            (close[0], course.uncompensated, WITHOUT, 'without compensation'),
            (close[1], course.errors, WITH, 'with compensation (other scale)')):
        panel.plot(*(1e3 * np.where(course.counts[:, None], errors, np.nan)[:, :2].T),
                   color=colour, lw=0.8)
        panel.plot(0.0, 0.0, '+', color=GOAL, ms=12)
        panel.set_aspect('equal', adjustable='datalim')
        panel.set_title(f'error {title}', fontsize=10)
        label(panel, 'error in x [mm]', 'error in y [mm]')
    return figure


def pressing(
    course: Course, times: np.ndarray, forces: np.ndarray, desired: float | None
) -> Figure:
    """Draw force on the wall, gondola and its yaw together over the run."""
    figure = new_figure(10, 7, 'Force of the head on the wall')
    panel, gondola = figure.subplots(2, 1, sharex=True)
    panel.plot(times, forces, color=WITH, lw=1.0, label='force on the wall')
    if desired is not None:
        panel.axhline(desired, color=GOAL, ls='--', lw=1.0, label='desired')
    panel.set_ylim(bottom=0.0)
    label(panel, '', 'force [N]')
    rails, yaw = np.multiply(SCALES, course.rails), gondola.twinx()
    for i, colour in enumerate((WITHOUT, WITH)):
        gondola.plot(course.times, rails[:, i], color=colour, lw=1.0, label=f'gondola {AXES[i]}')
    yaw.plot(course.times, rails[:, 2], color=GOAL, lw=1.0)
    gondola.plot([], [], color=GOAL, lw=1.0, label='gondola yaw (right axis)')
    yaw.set_ylabel('yaw [°]')
    gondola.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=8,
                   frameon=False)
    label(gondola, 'time since the first goal [s]', 'gondola [mm]')
    panel.legend(loc='upper right', ncols=2, frameon=False, bbox_to_anchor=(1.0, 1.12))
    panel.set_title(f'mean {forces.mean():.3g} N, maximum {forces.max():.3g} N, without contact '
                    f'for {100.0 * np.mean(forces <= 0.0):.2g} % of the time',
                    loc='left', fontsize=10)
    return figure


def _figures(result: dict[str, float], i: int) -> str:
    without, error = (SCALES[i] * result[name] for name in ('disturbance_rms', 'residual_rms'))
    return (f'RMS {without:.3g} {UNITS[i]} → {error:.3g} {UNITS[i]} '
            f'({decibels(result["attenuation_db"])})')


def amplitudes(
    values: np.ndarray, period: float, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return frequencies above 0 [Hz] and amplitudes of samples of which only some count.

    They are a period [s] apart. An amplitude is that of a sine of its frequency, in their unit.
    """
    window = np.hanning(len(values)) * counts
    weight = max(window.sum(), np.finfo(float).tiny)
    mean = np.dot(window, values) / weight
    spectrum = 2.0 * np.abs(np.fft.rfft((values - mean) * window)) / weight
    return np.fft.rfftfreq(len(values), period)[1:], spectrum[1:]


def attenuation(
    frequencies: np.ndarray, without: np.ndarray, error: np.ndarray, present: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return frequency [Hz] and attenuation [dB] of the bands that have a disturbance.

    Amplitudes without compensation and of the error are over the same samples: what leaks into a
    neighbouring band leaks in both. Those over all samples show where there is a disturbance.
    """
    bands = np.floor(BANDS_PER_DECADE * np.log10(frequencies / LOWEST))
    rows = []
    for band in np.unique(bands[(frequencies >= LOWEST) & (frequencies <= HIGHEST)]):
        inside = bands == band
        if present[inside].max() > LEAST_SHARE * present.max():
            ratio = np.sum(without[inside] ** 2) / np.sum(error[inside] ** 2)
            rows.append((frequencies[inside].mean(), 10.0 * math.log10(ratio)))
    found = np.array(rows).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def label(panel: Axes, x: str, y: str) -> None:
    """Name both axes of a plot, units included."""
    panel.set(xlabel=x, ylabel=y)
    panel.grid(alpha=0.3)
    panel.margins(x=0.01)


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whatever the name's ending."""
    figure.savefig(path, dpi=DOTS_PER_INCH, format='png')
