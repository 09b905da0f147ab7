"""
What the pictures of the bench and of the demo share: the head on the wall, with and without.

Whoever imports this module imports matplotlib with it. Poses are rows of x, y, θ [m, m, rad].
"""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
import numpy as np

TITLES = ('x, along the wall [mm]', 'y, to the wall [mm]', 'θ, yaw [°]')
WITHOUT, WITH, GOAL = '#999999', '#0072b2', '#d55e00'
DOTS_PER_INCH = 110
LOWEST, HIGHEST = 0.02, 10.0  # Hz, between which spectra are drawn
BANDS_PER_DECADE = 12
LEAST_SHARE = 0.01  # of the largest amplitude: where there is no disturbance there is no ratio


def new_figure(width: float, height: float, title: str, size: float = 12.0) -> Figure:
    """Return an empty figure of a size in inches under a title of a size in points."""
    figure = Figure(figsize=(width, height), layout='constrained')
    figure.suptitle(title, fontsize=size)
    return figure


def draw_course(panel: Axes, times: np.ndarray, without: np.ndarray, error: np.ndarray) -> None:
    """Draw one axis of the disturbance and of the error against the time [s]."""
    panel.plot(times, without, color=WITHOUT, lw=1.0, label='without compensation')
    panel.plot(times, error, color=WITH, lw=1.0, label='error on the wall')


def draw_path(
    panel: Axes, heads: np.ndarray, errors: np.ndarray, uncompensated: np.ndarray
) -> None:
    """Draw the path of the head on the wall, as in Park et al., Figure 12."""
    goals = heads - errors
    for places, colour, size, label_text in (
            (goals + uncompensated, WITHOUT, 1, 'without compensation'),
            (heads, WITH, 1, 'head'),
            (np.unique(goals.round(6), axis=0), GOAL, 20, 'goals')):
        panel.scatter(1e3 * places[:, 0], 1e3 * places[:, 1], s=size, color=colour,
                      label=label_text)
    panel.set_aspect('equal', adjustable='datalim')
    panel.legend(fontsize=8)
    label(panel, 'x on the wall [mm]', 'y [mm]')


def amplitudes(
    values: np.ndarray, period: float, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the amplitude spectrum of samples of which only some count.

    Parameters
    ----------
    values : numpy.ndarray, shape (n,)
        One every `period` [s].
    period : float
    counts : numpy.ndarray of bool, shape (n,)

    Returns
    -------
    frequencies : numpy.ndarray, shape (n // 2,)
        Above 0 [Hz].
    amplitudes : numpy.ndarray, shape (n // 2,)
        As of a sine of that frequency, in the unit of the values.

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
    Return the attenuation in the bands that have a disturbance.

    Parameters
    ----------
    frequencies : numpy.ndarray, shape (n,)
        [Hz].
    without, error : numpy.ndarray, shape (n,)
        Amplitudes over the same samples: what leaks into a neighbouring band leaks in both.
    present : numpy.ndarray, shape (n,)
        Amplitudes of the disturbance over all samples, which show where there is any.

    Returns
    -------
    frequencies : numpy.ndarray, shape (m,)
        [Hz].
    attenuation : numpy.ndarray, shape (m,)
        [dB].

    """
    bands = np.floor(BANDS_PER_DECADE * np.log10(frequencies / LOWEST))
    rows = []
    for band in np.unique(bands[(frequencies >= LOWEST) & (frequencies <= HIGHEST)]):
        inside = bands == band
        if present[inside].max() > LEAST_SHARE * present.max():
            ratio = np.sum(without[inside] ** 2) / np.sum(error[inside] ** 2)
            rows.append((frequencies[inside].mean(), 10.0 * math.log10(ratio)))
    return tuple(np.array(rows).reshape(-1, 2).T)


def draw_spectra(
    panel: Axes, frequencies: np.ndarray, without: np.ndarray, error: np.ndarray, what: str
) -> None:
    """Draw the amplitude spectra of one axis: the disturbance, and what remains of it."""
    for spectrum, colour, text in (
            (without, WITHOUT, 'without compensation'), (error, WITH, 'error on the wall')):
        panel.loglog(frequencies, spectrum, color=colour, lw=1.0, label=text)
    panel.set(xlim=(LOWEST, HIGHEST), ylim=(1e-4, 1e3))
    panel.legend(fontsize=8)
    label(panel, 'frequency [Hz]', what)


def draw_force(
    panel: Axes, times: np.ndarray, forces: np.ndarray, desired: float | None
) -> None:
    """Draw the force on the wall [N] and, if there is one, the desired."""
    panel.plot(times, forces, color=WITH, lw=1.0, label='force on the wall')
    if desired is not None:
        panel.axhline(desired, color=GOAL, ls='--', lw=1.0, label='desired')
    panel.set_ylim(bottom=0.0)
    label(panel, 'time [s]', 'force [N]')


def draw_gondola(panel: Axes, times: np.ndarray, rails: np.ndarray) -> None:
    """Draw the rail's x and y [mm] and, on an axis of its own, its yaw [°], from rows of poses."""
    for i, colour in enumerate((WITHOUT, WITH)):
        panel.plot(times, 1e3 * rails[:, i], color=colour, lw=1.0, label='gondola ' + 'xy'[i])
    yaw = panel.twinx()
    yaw.plot(times, np.degrees(rails[:, 2]), color=GOAL, lw=1.0)
    panel.plot([], [], color=GOAL, lw=1.0, label='its yaw (right)')
    yaw.set_ylabel('yaw [°]')
    panel.legend(loc='lower right', bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=8,
                 frameon=False)
    label(panel, 'time [s]', 'gondola [mm]')


def label(panel: Axes, x: str, y: str) -> None:
    """Name both axes of a plot, units included."""
    panel.set(xlabel=x, ylabel=y)
    panel.grid(alpha=0.3)
    panel.margins(x=0.01)


def plain_ticks(axis: Axis) -> None:
    """Show 0.1, 0.3, 1 and so on along a logarithmic axis, less over many decades, not 10⁻¹."""
    lowest, highest = axis.get_view_interval()
    axis.set(major_locator=LogLocator(subs=(1.0, 3.0) if highest < 1e4 * lowest else (1.0,)),
             major_formatter='{x:g}', minor_locator=NullLocator())


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whatever the name's ending."""
    figure.savefig(path, dpi=DOTS_PER_INCH, format='png')
