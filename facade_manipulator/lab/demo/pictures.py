"""Pictures of a demo run: time courses, spectra, the path on the wall and the pressing force."""

from __future__ import annotations

from collections.abc import Collection

from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.lab.demo.course import Course
from facade_manipulator.lab.demo.report import decibels
from facade_manipulator.lab.gondola import AXES, SCALES, UNITS
from facade_manipulator.lab.gondola.pictures import (
    amplitudes,
    attenuation,
    draw_course,
    draw_force,
    draw_gondola,
    draw_path,
    draw_spectra,
    GOAL,
    HIGHEST,
    label,
    LOWEST,
    new_figure,
    TITLES,
    WITH,
    WITHOUT,
)

GIVES_WAY = 'gives way to the wall: its shift from the goal is meant'


def time_courses(
    course: Course, axes: dict[str, dict], giving_way: Collection[str]
) -> Figure:
    """
    Draw the error on the wall over the run, with and without, and alone on a scale of its own.

    It is that from the head's path to the goal; with the summary's figures, but for axes that give
    way to the wall.
    """
    figure = new_figure(13, 9, 'How far the head is from where it should be on the wall', 13.0)
    panels = figure.subplots(3, 2, sharex=True, width_ratios=(1.2, 1.0))
    without, errors = SCALES * course.uncompensated, SCALES * course.errors
    for i, (pair, (axis, result)) in enumerate(zip(panels, axes.items(), strict=True)):
        draw_course(pair[0], course.times, without[:, i], errors[:, i])
        pair[1].plot(course.times, errors[:, i], color=WITH, lw=0.8)
        for panel in pair:
            panel.fill_between(
                course.times, 0.0, 1.0, ~course.settled, transform=panel.get_xaxis_transform(),
                color=GOAL, alpha=0.12, lw=0.0, label='on the way to the next goal')
            label(panel, '', TITLES[i])
        most = 1.5 * np.abs(errors[course.counts, i]).max()
        pair[1].set_ylim(-most, most)
        pair[0].set_title(GIVES_WAY if axis in giving_way else _figures(result, i), loc='left',
                          fontsize=10)
    panels[0, 0].set_title(panels[0, 0].get_title('left') + (
        ', while the goal stands' if course.settled.any() else ', on the way'), loc='left',
        fontsize=10)
    panels[0, 1].set_title('the error alone, magnified', loc='left', fontsize=10)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  frameon=False)
    for panel in panels[-1]:
        panel.set_xlabel('time [s]')
    return figure


def spectrum(course: Course, giving_way: Collection[str]) -> Figure:
    """Draw amplitudes and attenuation against the frequency, of each axis."""
    times = np.linspace(course.times[0], course.times[-1], len(course.times))
    used = np.interp(times, course.times, course.counts) >= 1.0  # no sample across an end of them
    figure = new_figure(13, 7, 'The disturbance, and what remains of it')
    panels = figure.subplots(2, 3, sharex=True, sharey='row')
    without, errors = SCALES * course.uncompensated, SCALES * course.errors
    for i, (axis, title) in enumerate(zip(AXES, TITLES, strict=True)):
        (frequencies, present), (_, before), (_, after) = (
            amplitudes(np.interp(times, course.times, values[:, i]), times[1] - times[0], counts)
            for values, counts in (
                (without, np.ones_like(used)), (without, used), (errors, used)))
        draw_spectra(panels[0, i], frequencies, present, after, f'amplitude [{UNITS[i]}]')
        panels[1, i].semilogx(*attenuation(frequencies, before, after, present),
                              color=WITH, marker='o', ms=4, lw=1.0)
        panels[1, i].axhline(0.0, color=WITHOUT, ls='--', lw=1.0)
        panels[1, i].set_xlim(LOWEST, HIGHEST)
        panels[0, i].set_title(title.split(' [')[0] + (
            ': gives way, its shift is meant' if axis in giving_way else ''), fontsize=10)
        label(panels[1, i], 'frequency [Hz]', 'attenuation [dB]')
    for panel in panels.flat:
        panel.label_outer()
    return figure


def paths(course: Course) -> Figure:
    """Draw the path on the wall, and the errors alone, which are too small to see on it."""
    figure = new_figure(13, 7, 'The path of the head on the wall')
    wide, *close = figure.subplot_mosaic(
        [['wide', 'wide'], ['without', 'with']], height_ratios=(1.0, 1.1)).values()
    draw_path(wide, course.heads, course.heads - course.goals, course.carried(course.goals))
    for panel, errors, colour, title in (
            (close[0], course.uncompensated, WITHOUT, 'without compensation'),
            (close[1], course.errors, WITH, 'compensated (another scale)')):
        panel.plot(*(1e3 * np.where(course.counts[:, None], errors, np.nan)[:, :2].T),
                   color=colour, lw=0.8)
        panel.plot(0.0, 0.0, '+', color=GOAL, ms=12)
        panel.set_aspect('equal', adjustable='datalim')
        panel.set_title(f'around where it should be, {title}', fontsize=10)
        label(panel, 'error in x [mm]', 'error in y [mm]')
    return figure


def pressing(
    course: Course, times: np.ndarray, forces: np.ndarray, desired: float | None
) -> Figure:
    """Draw force on the wall, gondola and its yaw together over the run."""
    figure = new_figure(10, 7, 'The head presses on the wall')
    panel, gondola = figure.subplots(2, 1, sharex=True)
    draw_force(panel, times, forces, desired)
    draw_gondola(gondola, course.times, np.array(course.rails))
    panel.set_xlabel('')
    gondola.set_xlabel('time [s]')
    panel.legend(loc='upper right', ncols=2, frameon=False, bbox_to_anchor=(1.0, 1.12))
    panel.set_title(f'mean {forces.mean():.3g} N, greatest {forces.max():.3g} N, without contact '
                    f'for {100.0 * np.mean(forces <= 0.0):.2g} % of the time',
                    loc='left', fontsize=10)
    return figure


def _figures(result: dict[str, float], i: int) -> str:
    without, error = (SCALES[i] * result[name] for name in ('disturbance_rms', 'residual_rms'))
    return (f'RMS {without:.3g} {UNITS[i]} → {error:.3g} {UNITS[i]} '
            f'({decibels(result["attenuation_db"])})')
