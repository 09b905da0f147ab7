"""Pictures and animation of a run; seen from above with wall, gondola, mechanism and head."""

from __future__ import annotations

from contextlib import suppress
import math

from matplotlib import rcParams
from matplotlib.animation import FuncAnimation
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import compose, Pose, relative
from facade_manipulator.simulation.demo.recording import carried, Run, SCALES, UNITS
from facade_manipulator.study.drawing import draw_mechanism, figure, GREEN, label

AXES = ('x, along the wall', 'y, to the wall', 'θ, yaw')
GREY, BLUE, PINK = '#999999', '#0072b2', '#cc79a7'
HEADS = (GREY, 'head without compensation'), (BLUE, 'head with compensation')
REFERENCE = PINK, 'where the head should be'
ELAPSED = 'time since the first goal [s]'
HIGHEST_FREQUENCY = 10.0  # Hz
FORCE_TIME = 0.1  # s, over which the force is averaged: the noise of a reading is 0.5 N
TOUCH = 1.0  # N, above which the averaged force is a contact
DURATION, FRAME_PERIOD, TRAIL = 12.0, 0.2, 3.0  # s, of the animation
BRUSH = 0.08  # m, drawn between platform and head; the wall hides the compressed part
# in frame rail [m, m, rad]
GONDOLA = np.array([(x, y - BRUSH, 0.0) for x, y in (
    (-0.6, -0.03), (0.6, -0.03), (0.6, -0.15), (-0.6, -0.15), (-0.6, -0.03))])


def time_courses(run: Run) -> Figure:
    """Draw the error over the run, without and with compensation, and with it magnified."""
    made = figure(13, 9, 'How far the head is from where it should be on the wall')
    panels = made.subplots(3, 2, sharex=True, width_ratios=(1.2, 1.0))
    for i, (both, magnified) in enumerate(panels):
        for errors, (colour, name) in zip(SCALES[i] * run.errors()[..., i], HEADS, strict=True):
            both.plot(run.times, errors, color=colour, lw=1.0, label=name)
        magnified.plot(run.times, errors, color=colour, lw=1.0)
        highest = 1.5 * np.abs(errors[run.is_counted]).max()
        magnified.set_ylim(-highest, highest)
        for panel, title in ((both, f'RMS {run.figures()[i]}'),
                             (magnified, 'with compensation, magnified')):
            panel.axvspan(0.0, run.times[run.is_counted][0], color=PINK, alpha=0.12, lw=0.0,
                          label='not counted: the correction fades in and learns')
            label(panel, ELAPSED if i == 2 else '', f'{AXES[i]} [{UNITS[i]}]', title)
    made.legend(*both.get_legend_handles_labels(), loc='outside lower center', ncols=3)
    return made


def spectrum(run: Run) -> Figure:
    """Draw the amplitudes of the error against the frequency, of each axis."""
    made = figure(13, 4.5, 'Which frequencies of the error the compensation removes')
    times = run.times[run.is_counted]
    even = np.linspace(times[0], times[-1], len(times))
    frequencies, window = np.fft.rfftfreq(len(even), even[1] - even[0]), np.hanning(len(even))
    for i, panel in enumerate(made.subplots(1, 3)):
        for errors, (colour, name) in zip(SCALES * run.errors(), HEADS, strict=True):
            error = np.interp(even, run.times, errors[:, i])
            # amplitudes of sines of these frequencies
            amplitudes = 2.0 * np.abs(np.fft.rfft((error - error.mean()) * window)) / window.sum()
            panel.loglog(frequencies[1:], amplitudes[1:], color=colour, lw=1.0, label=name)
        panel.set(xlim=(frequencies[1], HIGHEST_FREQUENCY), ylim=(1e-4, 1e3))
        label(panel, 'frequency [Hz]', f'amplitude of the error [{UNITS[i]}]', AXES[i])
        panel.legend()
    return made


def path(run: Run) -> Figure:
    """Draw the path on the wall."""
    made = figure(13, 4.5, 'Path of the head on the wall, seen from above')
    panel = made.subplots()
    _draw_paths(panel, run, (0, 1), slice(None))
    label(panel, 'x along the wall [mm]', 'y to the wall [mm]')
    panel.set_aspect('equal', adjustable='datalim')
    panel.legend()
    return made


def force(run: Run) -> Figure:
    """Draw the force on the wall."""
    made = figure(10, 4.5, 'Force with which the head presses on the wall')
    panel = made.subplots()
    kernel = np.ones(max(round(FORCE_TIME / np.median(np.diff(run.times))), 1))
    forces = (np.convolve(run.forces, kernel, 'same')
              / np.convolve(np.ones_like(run.forces), kernel, 'same'))
    panel.plot(run.times, forces, color=BLUE, lw=1.0, label=f'mean of {FORCE_TIME:g} s')
    panel.axhline(TOUCH, color=GREY, ls=':', lw=1.0, label=f'contact above {TOUCH:g} N')
    if (desired := run.scenario.compensator.get('contact.force')) is not None:
        panel.axhline(desired, color=PINK, ls='--', lw=1.0, label='desired')
    touching = forces[forces > TOUCH]
    label(panel, ELAPSED, 'force [N]',
          f'in contact for {100.0 * len(touching) / len(forces):.3g} % of the time, mean force '
          f'then {touching.sum() / max(len(touching), 1):.3g} N, highest {forces.max():.3g} N')
    panel.legend(loc='lower right', ncols=3)
    return made


def before_after(run: Run) -> Figure:
    """Draw three moments of a run, with a mechanism that stands still and with the real one."""
    made = figure(13, 7, 'The head on the wall, without compensation above, with it below')
    without = np.where(run.is_counted[:, None], run.errors()[0], math.nan)
    distance = np.linalg.norm(without * (1.0, 1.0, run.geometry.platform_half_length), axis=1)
    moments = {'nearest to rest': np.nanargmin(distance), 'leftmost': np.nanargmin(without[:, 0]),
               'rightmost': np.nanargmax(without[:, 0])}
    panels = made.subplots(2, 3, sharex=True, sharey=True)
    for column, (name, now) in zip(panels.T, moments.items(), strict=True):
        for i, panel in enumerate(column):
            _draw_moment(panel, run, (i,), int(now))
            panel.set_title(f'{name}: {_error_text(run, i, int(now))}')
            panel.label_outer()
    handles = {name: handle for panel in panels[:, 0] for handle, name in zip(
        *panel.get_legend_handles_labels(), strict=True)}
    made.legend(handles.values(), handles.keys(), loc='outside lower center', ncols=6)
    return made


def linkage(run: Run) -> FuncAnimation:
    """Animate the last seconds of a run."""
    made = Figure(figsize=(8.0, 4.6), dpi=80, layout='constrained')
    panel = made.subplots()

    def draw(time: float) -> None:
        now = int(np.searchsorted(run.times, time))
        panel.clear()
        _draw_moment(panel, run, (0, 1), now)
        panel.set_title(
            f'{time:6.1f} s   error without compensation {_error_text(run, 0, now)}\n'
            f'           error with compensation    {_error_text(run, 1, now)}',
            loc='left', family='monospace', fontsize=9)

    draw(0.0)
    made.legend(*panel.get_legend_handles_labels(), loc='outside lower center', ncols=3)
    made.draw_without_rendering()
    made.set_layout_engine('none')  # a new layout of each frame would take as long as drawing it
    begin, end = max(0.0, run.times[-1] - DURATION), run.times[-1]
    rcParams['animation.writer'] = 'pillow'
    return FuncAnimation(
        made, draw, np.arange(begin, end, FRAME_PERIOD), interval=1e3 * FRAME_PERIOD)


def _draw_moment(panel: Axes, run: Run, shown: tuple[int, ...], now: int) -> None:
    """
    Draw wall, gondola and heads at a sample, and the mechanism of the last head shown.

    The axes show the gondola of all the run. The brush is drawn between platform and head, and all
    of the mechanism as far behind the head. A head pressed on the wall is drawn at its surface.
    """
    face = 1e3 * run.scenario.wall.distance
    panel.axhspan(face, face + 1e3, color='#c9c2b0', label='wall')
    corners = 1e3 * carried(run.rails[:, None], GONDOLA)
    (left, low, _), (right, _, _) = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    panel.set(xlim=(left - 50.0, right + 50.0), ylim=(low - 50.0, face + 100.0), aspect='equal')
    label(panel, 'x along the wall [mm]', 'y to the wall [mm]')
    rail = Pose(*run.rails[now])
    on_rail = relative(rail, Pose(*run.poses()[shown[-1]][now]))
    with suppress(LimitError):  # a head at rest may be out of reach
        draw_mechanism(
            panel, run.geometry, on_rail, rail=compose(rail, Pose(0.0, -BRUSH, 0.0)))
    brush = np.array([on_rail, on_rail._replace(y=on_rail.y - BRUSH)])
    for points, name, colour, width in (
            (brush, 'brush', GREEN, 6.0), (GONDOLA, 'gondola', '#b7cbd9', 3.0)):
        x, y, _ = 1e3 * carried(run.rails[now], points).T
        panel.plot(x, y, color=colour, lw=width, zorder=0.9, label=name)
    begin = int(np.searchsorted(run.times, run.times[now] - TRAIL))
    _draw_paths(panel, run, shown, slice(begin, now + 1), f', last {TRAIL:g} s', face)


def _draw_paths(
    panel: Axes, run: Run, shown: tuple[int, ...], samples: slice, suffix: str = '',
    face: float = math.inf,
) -> None:
    """Draw the paths of heads in front of a face [mm], and that of the reference over them."""
    heads = [(*HEADS[i], run.poses()[i], 'o', 6.0) for i in shown]
    for colour, name, poses, marker, size in (*heads, (*REFERENCE, run.references, '+', 14.0)):
        x, y, _ = 1e3 * poses[samples].T
        panel.plot(x, np.minimum(y, face), color=colour, lw=1.0, marker=marker, ms=size, mew=1.5,
                   markevery=[-1], zorder=4.0, label=name + suffix)


def _error_text(run: Run, shown: int, now: int) -> str:
    x, y, theta = SCALES * run.errors()[shown, now]
    return f'x {x:+6.1f}, y {y:+6.1f} mm, θ {theta:+6.2f}°'
