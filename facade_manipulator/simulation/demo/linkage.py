"""A run seen from above: wall, gondola, linkage, head and goal, as stills and as animation."""

from __future__ import annotations

from collections.abc import Callable
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
from facade_manipulator.kinematics import Geometry, joints, Mechanism, Pose, relative
from facade_manipulator.simulation.demo.pictures import GOAL, new_figure, WITH, WITHOUT
from facade_manipulator.simulation.demo.recording import carried, Run, SCALES
from facade_manipulator.simulation.world.scenario import Scenario

DURATION, FRAME_PERIOD = 12.0, 0.1  # s
COLOURS = 96
TRAIL = 3.0  # s
SIZE, DOTS_PER_INCH = (8.0, 4.6), 80
BRUSH = 0.08  # m, drawn between platform and head; the wall hides what is compressed
GONDOLA = np.array([(-0.6, -0.03), (0.6, -0.03), (0.6, -0.15), (-0.6, -0.15), (-0.6, -0.03)])
CROSS = np.array([(-1, 0), (1, 0), (math.nan, math.nan), (0, -1), (0, 1)]) * 0.035
DARK = '#444444'
# of the lines that move, from the furthest behind to the foremost
LOOKS: dict[str, dict[str, Any]] = {
    'gondola': {'color': '#b7cbd9', 'lw': 3, 'label': 'gondola'},
    'rail': {'color': DARK, 'lw': 5},
    'guide': {'color': '#aaaaaa', 'lw': 2},
    'links': {'color': DARK, 'lw': 3},
    'brush': {'color': '#009e73', 'lw': 6, 'zorder': 0.9, 'label': 'brush'},
    'platform': {'color': '#e69f00', 'lw': 5, 'label': 'platform'},
    'carriages': {'color': DARK, 'marker': 's', 'ms': 8, 'ls': '', 'label': 'carriages'},
    'still trail': {'color': WITHOUT, 'lw': 1},
    'still': {'color': WITHOUT, 'lw': 2, 'label': f'head without compensation, last {TRAIL:g} s'},
    'goal': {'color': GOAL, 'lw': 2, 'label': 'goal'},
    'head trail': {'color': WITH, 'lw': 1},
    'head': {'color': WITH, 'marker': 'o', 'ms': 6, 'label': f'head, last {TRAIL:g} s'},
}


def before_and_after(run: Run, geometry: Geometry, scenario: Scenario) -> Figure:
    """Draw three moments of a run, with a mechanism that stands still and with the real one."""
    figure = new_figure(13, 6, 'The head on the wall, without compensation above, with it below')
    without = np.where(run.is_counted[:, None], run.uncompensated, math.nan)
    distance = np.linalg.norm(without * (1.0, 1.0, geometry.platform_half_length), axis=1)
    moments = {'nearest to rest': np.nanargmin(distance), 'leftmost': np.nanargmin(without[:, 0]),
               'rightmost': np.nanargmax(without[:, 0])}
    still = run._replace(heads=run.references + run.uncompensated)
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    for column, (title, now) in zip(panels.T, moments.items(), strict=True):
        for panel, shown in zip(column, (still, run), strict=True):
            lines = _stage(panel, run, scenario)
            with suppress(LimitError):  # a head that stands still may be out of reach
                _move(lines, _places(shown, still, geometry, int(now)))
            x, y, theta = (SCALES * shown.errors)[now]
            panel.set_title(f'{title}: x {x:+.1f}, y {y:+.1f} mm, θ {theta:+.2f}°', fontsize=10)
            panel.label_outer()
    figure.legend(*panel.get_legend_handles_labels(), fontsize=8, ncols=8, frameon=False,
                  loc='outside lower center')
    return figure


def save_animation(
    run: Run, geometry: Geometry, scenario: Scenario, path: Path, check: Callable[[], None]
) -> None:
    """Write the last seconds of a run as an endless GIF; an error of `check` ends the drawing."""
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
    canvas, panel = FigureCanvasAgg(figure), figure.add_axes((0.09, 0.2, 0.89, 0.69))
    lines = _stage(panel, run, scenario)
    title = panel.set_title('', loc='left', family='monospace', fontsize=9)
    figure.legend(loc='lower center', fontsize=7, ncols=4, frameon=False)
    still = run._replace(heads=run.references + run.uncompensated)
    moving = (*lines.values(), title)
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)  # drawn once: 120 times it takes a minute
    images: list[Image.Image] = []
    for time in np.arange(max(0.0, run.times[-1] - DURATION), run.times[-1], FRAME_PERIOD):
        check()
        now = int(np.searchsorted(run.times, time))
        _move(lines, _places(run, still, geometry, now))
        without, error = ('{:+7.1f} {:+7.1f} mm {:+6.2f}°'.format(*values[now])
                          for values in (SCALES * run.uncompensated, SCALES * run.errors))
        title.set_text(f'{time:6.1f} s  error without compensation {without}\n'
                       f'          error with compensation    {error}')
        canvas.restore_region(background)
        for artist in moving:
            figure.draw_artist(artist)
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB')
        # a median cut would lose the goal's few pixels
        palette = images[0] if images else image.quantize(
            COLOURS, method=Image.Quantize.MAXCOVERAGE)
        images.append(image.quantize(palette=palette, dither=Image.Dither.NONE))
    images[0].save(path, format='GIF', save_all=True, append_images=images[1:],
                   duration=round(1e3 * FRAME_PERIOD), loop=0)


def _stage(panel: Axes, run: Run, scenario: Scenario) -> dict[str, Any]:
    """Draw the wall on a panel that shows all of the run; return the lines that move on it."""
    face = 1e3 * scenario.wall.distance
    panel.axhspan(face, face + 1e3, color='#c9c2b0', label='wall')
    corners = 1e3 * _on_wall(run.rails[:, None], GONDOLA - (0.0, BRUSH))
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    panel.set(xlim=(low[0] - 50.0, high[0] + 50.0), ylim=(low[1] - 50.0, face + 100.0),
              xlabel='x along the wall [mm]', ylabel='y to the wall [mm]', aspect='equal')
    return {name: panel.plot([], [], **look)[0] for name, look in LOOKS.items()}


def _move(lines: dict[str, Any], places: dict[str, np.ndarray]) -> None:
    for name, points in places.items():
        lines[name].set_data(*(1e3 * points.T))


def _on_wall(rails: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points of frame rail [m], shape (n, 2), on the wall."""
    return carried(rails, np.pad(points, ((0, 0), (0, 1))))[..., :2]


def _places(run: Run, still: Run, geometry: Geometry, now: int) -> dict[str, np.ndarray]:
    """
    Return the points of each line on the wall [m].

    A brush is drawn between platform and head, and all of the mechanism as far behind the head.
    """
    rail, head = run.rails[now], run.heads[now]
    on_rail = relative(Pose(*rail), Pose(*head))
    at = joints(geometry, Mechanism(geometry).platform(on_rail))
    gap = (math.nan, math.nan)
    parts = {
        'gondola': GONDOLA, 'rail': [(bound, 0.0) for bound in geometry.stroke],
        'links': [at.a1, at.b1, gap, at.a2, at.b2], 'guide': [at.a3, at.p],
        'platform': [at.b1, at.b2], 'carriages': [at.a1, at.a2, at.a3]}
    trail = slice(int(np.searchsorted(run.times, run.times[now] - TRAIL)), now + 1)
    places = {name: _on_wall(rail, np.array(points) - (0.0, BRUSH))
              for name, points in parts.items()}
    brush = _on_wall(rail, np.array([(at.p[0], at.p[1] - BRUSH), on_rail[:2]]))
    return {
        **places, 'brush': brush, 'head': head[None, :2], 'head trail': run.heads[trail, :2],
        'goal': _on_wall(run.goals[now], CROSS), 'still': _on_wall(still.heads[now], CROSS),
        'still trail': still.heads[trail, :2]}
