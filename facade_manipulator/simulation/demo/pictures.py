"""Draw pictures and an animation of a run: wall, gondola, mechanism and head from above."""

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
from facade_manipulator.simulation.demo.samples import carried, Run, SCALES, UNITS
from facade_manipulator.study.drawing import draw_mechanism, figure, GREEN, label

GREY, BLUE, PINK = '#999999', '#0072b2', '#cc79a7'
PATHS = (  # paths of a run: colour, name, marker and its size
    (GREY, 'head without compensation', 'o', 6.0), (BLUE, 'head with compensation', 'o', 6.0),
    (PINK, 'where the head should be', '+', 14.0))
WITHOUT, WITH = 0, 1
ELAPSED = 'time since the first goal [s]'
HIGHEST_FREQUENCY = 10.0  # Hz
FORCE_TIME = 0.1  # s, over which the force is averaged: the noise of a reading is 0.5 N
TOUCH = 1.0  # N, above which the averaged force is a contact
DURATION, FRAME_PERIOD, TRAIL = 12.0, 0.2, 3.0  # s, of the animation
BRUSH = 0.08  # m, drawn between platform and head; the wall hides the compressed part
# in frame rail [m, m, rad]
GONDOLA = np.array([(x, y - BRUSH, 0.0) for x, y in (
    (-0.6, -0.03), (0.6, -0.03), (0.6, -0.15), (-0.6, -0.15), (-0.6, -0.03))])


def errors(run: Run) -> Figure:
    """Draw the errors by time and by frequency, and the compensated errors magnified."""
    made = figure(16, 9, 'How far the head is from where it should be on the wall')
    learned, *_, end = run.times[run.is_counted]
    even = np.linspace(learned, end, np.count_nonzero(run.is_counted))
    names = 'x, along the wall', 'y, to the wall', 'θ, yaw'
    for i, (both, magnified, amplitudes) in enumerate(made.subplots(3, 3, sharex='col')):
        for k, panels in ((WITHOUT, [both]), (WITH, [both, magnified])):
            error, style = SCALES[i] * run.errors[k, :, i], {'color': PATHS[k][0], 'lw': 1.0}
            for panel in panels:
                panel.plot(run.times, error, label=PATHS[k][1], **style)
            at_even = np.interp(even, run.times, error)
            amplitudes.magnitude_spectrum(  # the spectrum has half the amplitude of a sine
                2.0 * (at_even - at_even.mean()), Fs=1.0 / (even[1] - even[0]), **style)
        highest = 1.5 * np.abs(error[run.is_counted]).max()
        magnified.set_ylim(-highest, highest)
        amplitudes.set(xscale='log', yscale='log', ylim=(1e-4, 1e3),
                       xlim=(1.0 / (end - learned), HIGHEST_FREQUENCY))
        for panel in (both, magnified):
            panel.axvspan(0.0, learned, color=PINK, alpha=0.12, lw=0.0,
                          label='not counted: the correction fades in and learns')
        for panel, x, title in ((both, ELAPSED, f'RMS {run.figures[i]}'),
                                (magnified, ELAPSED, 'with compensation, magnified'),
                                (amplitudes, 'frequency [Hz]', 'amplitude by frequency')):
            label(panel, x if i == 2 else '', f'{names[i]} [{UNITS[i]}]', title)
    made.legend(*both.get_legend_handles_labels(), loc='outside lower center', ncols=3)
    return made


def force(run: Run) -> Figure:
    """Draw the force on the wall."""
    made = figure(10, 4.5, 'Force with which the head presses on the wall')
    panel = made.subplots()
    count = max(round(FORCE_TIME / np.median(np.diff(run.times))), 1)
    forces = np.convolve(run.forces, np.full(count, 1.0 / count), 'valid')
    panel.plot(
        run.times[count - 1:], forces, color=BLUE, lw=1.0, label=f'mean of {FORCE_TIME:g} s')
    panel.axhline(TOUCH, color=GREY, ls=':', lw=1.0, label=f'contact above {TOUCH:g} N')
    if desired := run.scenario.compensator.get('contact.force'):
        panel.axhline(desired, color=PINK, ls='--', lw=1.0, label='desired')
    touching = forces[forces > TOUCH]
    label(panel, ELAPSED, 'force [N]',
          f'in contact for {100.0 * len(touching) / len(forces):.3g} % of the time, mean force '
          f'then {touching.sum() / max(len(touching), 1):.3g} N, highest {forces.max():.3g} N')
    panel.legend(loc='lower right', ncols=3)
    return made


def moments(run: Run) -> Figure:
    """Draw three moments of a run."""
    made = figure(16, 5.5, 'The head on the wall, seen from above')
    without = np.where(run.is_counted[:, None], run.errors[WITHOUT], math.nan)
    distance = np.linalg.norm(without * (1.0, 1.0, run.geometry.platform_half_length), axis=1)
    panels = made.subplots(1, 3, sharey=True)
    for panel, name, now in zip(panels, ('nearest to rest', 'leftmost', 'rightmost'), (
            np.nanargmin(distance), np.nanargmin(without[:, 0]), np.nanargmax(without[:, 0])),
            strict=True):
        _draw_moment(panel, run, int(now), name)
        panel.label_outer()
    made.legend(*panel.get_legend_handles_labels(), loc='outside lower center', ncols=6)
    return made


def linkage(run: Run) -> FuncAnimation:
    """Animate the last seconds of a run."""
    made = Figure(figsize=(8.0, 4.8), dpi=80, layout='constrained')
    panel = made.subplots()

    def draw(time: float) -> None:
        panel.clear()
        _draw_moment(panel, run, int(np.searchsorted(run.times, time)), f'{time:.1f} s')

    draw(0.0)
    made.legend(*panel.get_legend_handles_labels(), loc='outside lower center', ncols=3)
    made.draw_without_rendering()
    made.set_layout_engine('none')  # a new layout of each frame would take as long as drawing it
    rcParams['animation.writer'] = 'pillow'
    end = run.times[-1]
    return FuncAnimation(made, draw, np.arange(max(0.0, end - DURATION), end, FRAME_PERIOD),
                         interval=1e3 * FRAME_PERIOD)


def _draw_moment(panel: Axes, run: Run, now: int, title: str) -> None:
    """
    Draw wall, gondola, mechanism and paths at a sample.

    The axes show the gondola in the whole run. The brush is drawn between platform and head. The
    mechanism is therefore drawn behind the head by the length of the brush. A head pressed on the
    wall is drawn at the surface of the wall.
    """
    face = 1e3 * run.scenario.wall.distance
    panel.axhspan(face, face + 1e3, color='#c9c2b0', label='wall')
    corners = 1e3 * carried(run.rails[:, None], GONDOLA)
    (left, low, _), (right, _, _) = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    panel.set(xlim=(left - 50.0, right + 50.0), ylim=(low - 50.0, face + 100.0), aspect='equal')
    rail = Pose(*run.rails[now])
    on_rail = relative(rail, Pose(*run.paths[WITH, now]))
    with suppress(LimitError):  # an interpolated head may be out of reach
        draw_mechanism(
            panel, run.geometry, on_rail, rail=compose(rail, Pose(0.0, -BRUSH, 0.0)))
    brush = np.array([on_rail, on_rail._replace(y=on_rail.y - BRUSH)])
    for points, name, colour, width in (
            (brush, 'brush', GREEN, 6.0), (GONDOLA, 'gondola', '#b7cbd9', 3.0)):
        x, y, _ = 1e3 * carried(run.rails[now], points).T
        panel.plot(x, y, color=colour, lw=width, zorder=0.9, label=name)
    begin = int(np.searchsorted(run.times, run.times[now] - TRAIL))
    for (colour, name, marker, size), path in zip(PATHS, run.paths, strict=True):
        x, y, _ = 1e3 * path[begin:now + 1].T
        panel.plot(x, np.minimum(y, face), color=colour, lw=1.0, marker=marker, ms=size, mew=1.5,
                   markevery=[-1], zorder=4.0, label=f'{name}, last {TRAIL:g} s')
    texts = (f'{name} compensation x {x:+6.1f}, y {y:+6.1f} mm, θ {theta:+6.2f}°'
             for name, (x, y, theta) in zip(
                 ('error without', 'error with   '), SCALES * run.errors[:, now], strict=True))
    label(panel, 'x along the wall [mm]', 'y to the wall [mm]')
    panel.set_title('\n'.join((title, *texts)), family='monospace', fontsize=9)
