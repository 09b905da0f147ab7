"""A run seen from above: wall, gondola, linkage, head and goal, as stills and as animation."""

from __future__ import annotations

from contextlib import suppress
import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from PIL import Image

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import compose, Pose, relative
from facade_manipulator.simulation.demo.pictures import GOAL, new_figure, WITH, WITHOUT
from facade_manipulator.simulation.demo.recording import carried, Run, SCALES
from facade_manipulator.study.drawing import draw_mechanism

DURATION, FRAME_PERIOD = 12.0, 0.1  # s
COLOURS = 96
TRAIL = 3.0  # s
SIZE, DOTS_PER_INCH = (8.0, 4.6), 80
BRUSH = 0.08  # m, drawn between platform and head; the wall hides what is compressed
GONDOLA = np.array([(-0.6, -0.03), (0.6, -0.03), (0.6, -0.15), (-0.6, -0.15), (-0.6, -0.03)])
CROSS = np.array([(-1, 0), (1, 0), (math.nan, math.nan), (0, -1), (0, 1)]) * 0.035
LEGEND: dict[str, Any] = {'fontsize': 8, 'frameon': False, 'loc': 'outside lower center'}


def before_and_after(run: Run) -> Figure:
    """Draw three moments of a run, with a mechanism that stands still and with the real one."""
    figure = new_figure(13, 6, 'The head on the wall, without compensation above, with it below')
    without = np.where(run.is_counted[:, None], run.uncompensated, math.nan)
    distance = np.linalg.norm(without * (1.0, 1.0, run.geometry.platform_half_length), axis=1)
    moments = {'nearest to rest': np.nanargmin(distance), 'leftmost': np.nanargmin(without[:, 0]),
               'rightmost': np.nanargmax(without[:, 0])}
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    for column, (title, now) in zip(panels.T, moments.items(), strict=True):
        for panel, shown in zip(column, (run._replace(heads=run.still), run), strict=True):
            _draw_wall(panel, run)
            _draw_moment(panel, shown, int(now))
            x, y, theta = (SCALES * shown.errors)[now]
            panel.set_title(f'{title}: x {x:+.1f}, y {y:+.1f} mm, θ {theta:+.2f}°', fontsize=10)
            panel.label_outer()
    figure.legend(*panel.get_legend_handles_labels(), ncols=8, **LEGEND)
    return figure


def save_animation(run: Run, path: Path) -> None:
    """Write the last seconds of a run as an endless GIF."""
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH, layout='constrained')
    canvas, panel = FigureCanvasAgg(figure), figure.subplots()
    _draw_wall(panel, run)
    _draw_moment(panel, run, 0)
    figure.legend(ncols=4, **LEGEND)
    title = panel.set_title('\n', loc='left', family='monospace', fontsize=9)
    canvas.draw()  # lays the figure out
    figure.set_layout_engine('none')
    _remove_lines(panel)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)  # drawn once: 120 times it takes a minute
    images: list[Image.Image] = []
    for time in np.arange(max(0.0, run.times[-1] - DURATION), run.times[-1], FRAME_PERIOD):
        now = int(np.searchsorted(run.times, time))
        without, error = ('{:+7.1f} {:+7.1f} mm {:+6.2f}°'.format(*values[now])
                          for values in (SCALES * run.uncompensated, SCALES * run.errors))
        title.set_text(f'{time:6.1f} s  error without compensation {without}\n'
                       f'          error with compensation    {error}')
        _draw_moment(panel, run, now)
        canvas.restore_region(background)
        for artist in (*sorted(panel.lines, key=lambda line: line.zorder), title):
            figure.draw_artist(artist)
        _remove_lines(panel)
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB')
        # a median cut would lose the goal's few pixels
        palette = images[0] if images else image.quantize(
            COLOURS, method=Image.Quantize.MAXCOVERAGE)
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    images[0].save(path, format='GIF', save_all=True, append_images=images[1:],
                   duration=round(1e3 * FRAME_PERIOD), loop=0)


def _draw_wall(panel: Axes, run: Run) -> None:
    """Draw the wall on a panel that shows the gondola during all of the run."""
    face = 1e3 * run.scenario.wall.distance
    panel.axhspan(face, face + 1e3, color='#c9c2b0', label='wall')
    corners = _on_wall(run.rails[:, None], GONDOLA - (0.0, BRUSH))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    panel.set(xlim=(low[0] - 50.0, high[0] + 50.0), ylim=(low[1] - 50.0, face + 100.0),
              xlabel='x along the wall [mm]', ylabel='y to the wall [mm]', aspect='equal')


def _draw_moment(panel: Axes, run: Run, now: int) -> None:
    """
    Draw the mechanism and the heads at a sample.

    The brush is drawn between platform and head, and all of the mechanism as far behind the head.
    """
    trail = slice(int(np.searchsorted(run.times, run.times[now] - TRAIL)), now + 1)
    rail, head = Pose(*run.rails[now]), Pose(*run.heads[now])
    on_rail = relative(rail, head)
    lines: list[tuple[np.ndarray, dict[str, Any]]] = [
        (_on_wall(run.rails[now], GONDOLA - (0.0, BRUSH)),
         {'color': '#b7cbd9', 'lw': 3, 'label': 'gondola'}),
        (_on_wall(run.rails[now], np.array([(on_rail.x, on_rail.y - BRUSH), on_rail[:2]])),
         {'color': '#009e73', 'lw': 6, 'zorder': 0.9, 'label': 'brush'}),
        (1e3 * run.still[trail, :2], {'color': WITHOUT, 'lw': 1, 'zorder': 4}),
        (_on_wall(run.still[now], CROSS),
         {'color': WITHOUT, 'lw': 2, 'zorder': 4,
          'label': f'head without compensation, last {TRAIL:g} s'}),
        (_on_wall(run.goals[now], CROSS),
         {'color': GOAL, 'lw': 2, 'zorder': 4, 'label': 'goal'}),
        (1e3 * run.heads[trail, :2], {'color': WITH, 'lw': 1, 'zorder': 5}),
        (1e3 * run.heads[[now], :2],
         {'color': WITH, 'marker': 'o', 'ms': 6, 'zorder': 5,
          'label': f'head, last {TRAIL:g} s'})]
    for points, look in lines:
        panel.plot(*points.T, **look)
    with suppress(LimitError):  # a head that stands still may be out of reach
        draw_mechanism(
            panel, run.geometry, on_rail, rail=compose(rail, Pose(0.0, -BRUSH, 0.0)))


def _remove_lines(panel: Axes) -> None:
    for line in list(panel.lines):
        line.remove()


def _on_wall(rails: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points of frame rail [m], shape (n, 2), on the wall [mm]."""
    return 1e3 * carried(rails, np.pad(points, ((0, 0), (0, 1))))[..., :2]
