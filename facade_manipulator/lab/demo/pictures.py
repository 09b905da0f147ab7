"""Pictures of a demo run: time courses, spectra, the path on the wall and the pressing force."""

from __future__ import annotations

from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.lab.demo.record import TimeCourse
from facade_manipulator.lab.gondola import SCALES, UNITS
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

TOO_SHORT = 'too short for figures: no goal stood long enough'


def time_courses(course: TimeCourse, axes: dict[str, dict]) -> Figure:
    """
    Draw the error on the wall over the run, with and without, and alone on a scale of its own.

    It is that from the head's path to the goal; with the summary's figures.
    """
    figure = new_figure(13, 9, 'How far the head is from where it should be on the wall', 13.0)
    panels = figure.subplots(3, 2, sharex=True, width_ratios=(1.2, 1.0))
    without, errors = course.carried(course.references), course.heads - course.references
    for i, (pair, result) in enumerate(zip(panels, axes.values(), strict=True)):
        draw_course(pair[0], course.times, SCALES[i] * without[:, i], SCALES[i] * errors[:, i])
        pair[1].plot(course.times, SCALES[i] * errors[:, i], color=WITH, lw=0.8)
        for panel in pair:
            panel.fill_between(
                course.times, 0.0, 1.0, ~course.settled, transform=panel.get_xaxis_transform(),
                color=GOAL, alpha=0.12, lw=0.0, label='on the way to the next goal')
            label(panel, '', TITLES[i])
        if course.settled.any():
            most = 1.5 * SCALES[i] * np.abs(errors[course.settled, i]).max()
            pair[1].set_ylim(-most, most)
        pair[0].set_title(_figures(result, i), loc='left', fontsize=10)
    panels[0, 1].set_title('the error alone, magnified', loc='left', fontsize=10)
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  frameon=False)
    for panel in panels[-1]:
        panel.set_xlabel('time since the first goal [s]')
    return figure


def spectrum(course: TimeCourse) -> Figure:
    """Draw amplitudes and attenuation against the frequency, of each axis."""
    times = np.linspace(course.times[0], course.times[-1], len(course.times))
    settled = np.interp(times, course.times, course.settled) > 0.5
    swaying = course.carried(course.goals.mean(axis=0))  # a goal's step makes it no jump
    figure = new_figure(13, 7, 'The disturbance, and what remains of it while goals stand')
    panels = figure.subplots(2, 3, sharex=True, sharey='row')
    for i, title in enumerate(TITLES):
        (frequencies, present), (_, without), (_, error) = (
            amplitudes(np.interp(times, course.times, SCALES[i] * values[:, i]),
                       times[1] - times[0], counts)
            for values, counts in (
                (swaying, np.ones_like(settled)), (swaying, settled), (course.errors, settled)))
        if settled.any():
            draw_spectra(panels[0, i], frequencies, present, error, f'amplitude [{UNITS[i]}]')
            panels[1, i].semilogx(*attenuation(frequencies, without, error, present),
                                  color=WITH, marker='o', ms=4, lw=1.0)
        panels[1, i].axhline(0.0, color=WITHOUT, ls='--', lw=1.0)
        panels[1, i].set_xlim(LOWEST, HIGHEST)
        panels[0, i].set_title(title.split(' [')[0] if settled.any() else TOO_SHORT, fontsize=10)
        label(panels[1, i], 'frequency [Hz]', 'attenuation [dB]')
    for panel in panels.flat:
        panel.label_outer()
    return figure


def paths(course: TimeCourse) -> Figure:
    """Draw the path on the wall, and the errors alone, which are too small to see on it."""
    figure = new_figure(13, 7, 'The path of the head on the wall')
    wide, *close = figure.subplot_mosaic(
        [['wide', 'wide'], ['without', 'with']], height_ratios=(1.0, 1.1)).values()
    wide.plot(*(1e3 * course.heads[:, :2].T), color=WITH, lw=0.5, alpha=0.5,
              label='head, on its way')
    counts = course.settled
    draw_path(wide, course.heads[counts], course.errors[counts], course.uncompensated[counts])
    wide.set_title('on the wall' if counts.any() else TOO_SHORT, fontsize=10)
    for panel, errors, colour, title in (
            (close[0], course.uncompensated, WITHOUT, 'around the goal, without compensation'),
            (close[1], course.errors, WITH, 'around the goal, compensated (another scale)')):
        panel.plot(*(1e3 * np.where(counts[:, None], errors, np.nan)[:, :2].T), color=colour,
                   lw=0.8)
        panel.plot(0.0, 0.0, '+', color=GOAL, ms=12)
        panel.set_aspect('equal', adjustable='datalim')
        panel.set_title(title, fontsize=10)
        label(panel, 'error in x [mm]', 'error in y [mm]')
    return figure


def pressing(
    course: TimeCourse, times: np.ndarray, forces: np.ndarray, desired: float | None
) -> Figure:
    """Draw force on the wall, gondola and its yaw together over the newest minutes of the run."""
    figure = new_figure(10, 7, 'The head presses on the wall')
    panel, gondola = figure.subplots(2, 1, sharex=True)
    draw_force(panel, times, forces, desired)
    draw_gondola(gondola, course.times, np.array(course.rails()))
    panel.set_xlabel('')
    gondola.set_xlabel('time since the first goal [s]')
    panel.legend(loc='upper right', ncols=2, frameon=False, bbox_to_anchor=(1.0, 1.12))
    panel.set_title(f'mean {forces.mean():.3g} N, greatest {forces.max():.3g} N, without contact '
                    f'for {100.0 * np.mean(forces <= 0.0):.2g} % of the time',
                    loc='left', fontsize=10)
    return figure


def _figures(result: dict[str, float | None], i: int) -> str:
    if result['attenuation_db'] is None:
        return TOO_SHORT
    without, error = (SCALES[i] * result[name] for name in ('disturbance_rms', 'residual_rms'))
    return (f'RMS {without:.3g} {UNITS[i]} → {error:.3g} {UNITS[i]} '
            f'({result["attenuation_db"]:.1f} dB), while the goal stands')
