"""A demo run as pictures of wall, swaying gondola, linkage, head and goal: stills, animation."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
import math
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
import numpy as np
from PIL import Image  # matplotlib needs it too

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import compose, Geometry, joints, mechanism_of, Pose, relative
from facade_manipulator.lab.gondola.course import Course
from facade_manipulator.lab.gondola.pictures import GOAL, new_figure, WITH, WITHOUT
from facade_manipulator.lab.gondola.wall import SCALES
from facade_manipulator.simulation.world.scenario import Wall

FRAMES, FRAME_PERIOD = 120, 0.1  # 12 s as fast as they went
TRAIL = 3.0
SIZE, DOTS_PER_INCH = (8.0, 4.0), 80
COLOURS = 96
WALL_DISTANCE = 0.3  # m, in a scenario without a wall to touch
GONDOLA_SIZE = (0.6, 0.12, 0.03)  # m: half its length, its far and its near side behind the rail
CROSS = 0.035
DARK = '#444444'
# of the lines that move, from the furthest behind to the foremost
LOOKS: dict[str, dict[str, Any]] = {
    'gondola': {'color': '#b7cbd9', 'lw': 3},
    'rail': {'color': DARK, 'lw': 5},
    'standing trail': {'color': WITHOUT, 'lw': 1},
    'guide': {'color': '#aaaaaa', 'lw': 2},
    'links': {'color': DARK, 'lw': 3},
    'platform': {'color': '#e69f00', 'lw': 5},
    'carriages': {'color': DARK, 'marker': 's', 'ms': 9, 'ls': ''},
    'standing': {'color': WITHOUT, 'lw': 2, 'label': 'without compensation'},
    'goal': {'color': GOAL, 'lw': 2, 'label': 'goal'},
    'head trail': {'color': WITH, 'lw': 1},
    'head': {'color': WITH, 'marker': 'o', 'ms': 7, 'ls': '', 'label': 'head'},
}


def before_and_after(course: Course, geometry: Geometry, wall: Wall) -> Figure:
    """
    Draw three moments of a run, with a mechanism that stands still and with the real one.

    As Figures 2 and 12 of the paper: next to no disturbance along the wall, and the most of it to
    either side.
    """
    figure = new_figure(13, 5, 'The head on the wall without and with compensation')
    without = np.where(course.counts, course.uncompensated[:, 0], np.nan)
    still = course._replace(heads=course.references + course.uncompensated)
    for column, (now, title) in zip(figure.subplots(2, 3, sharex=True, sharey=True).T, (
            (np.nanargmin(np.abs(without)), 'near rest'), (np.nanargmin(without), 'leftmost'),
            (np.nanargmax(without), 'rightmost')), strict=True):
        for panel, shown, words in zip(
                column, (still, course), ('without', 'with'), strict=True):
            lines = _stage(panel, course, geometry, wall)
            with suppress(LimitError):  # who stands still at the goal may be out of reach
                _move(lines, _places(shown, still.heads, geometry, int(now)))
            x, y, theta = np.multiply(SCALES, (shown.heads - course.references)[now])
            panel.set_title(
                f'{title}, {words}: x {x:+.1f}, y {y:+.1f} mm, θ {theta:+.2f}°', fontsize=10)
            panel.label_outer()
    figure.legend(handles=[lines[name] for name in ('standing', 'goal', 'head')], fontsize=8,
                  ncols=3, loc='outside lower center', frameon=False)
    return figure


def frames(course: Course, geometry: Geometry, wall: Wall) -> Iterator[Image.Image]:
    """
    Yield the last seconds of a run frame by frame in one palette.

    The wall is drawn at some distance where there is none to touch.
    """
    figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
    canvas, panel = FigureCanvasAgg(figure), figure.add_axes((0.09, 0.13, 0.89, 0.73))
    lines = _stage(panel, course, geometry, wall)
    without, errors = course.uncompensated, course.errors
    standing = course.references + without
    text = panel.set_title('', loc='left', family='monospace', fontsize=9)
    moving = (*lines.values(), text, panel.legend(loc='lower right', fontsize=8, ncols=3))
    for artist in moving:
        artist.set_animated(True)
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)  # drawn once
    palette = None
    for time in np.arange(max(FRAME_PERIOD, course.times[-1] - FRAMES * FRAME_PERIOD),
                          course.times[-1], FRAME_PERIOD):
        now = int(np.searchsorted(course.times, time))
        _move(lines, _places(course, standing, geometry, now))
        text.set_text(
            f'{time:6.1f} s  error without compensation {_triple(without[now])}\n'
            f'          error with compensation    {_triple(errors[now])}')
        canvas.restore_region(background)
        for artist in moving:
            figure.draw_artist(artist)
        image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert('RGB')
        # A median cut would lose the goal's few pixels in the platform.
        palette = palette or image.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
        yield image.quantize(palette=palette, dither=Image.Dither.NONE)


def _stage(
    panel: Axes, course: Course, geometry: Geometry, wall: Wall
) -> dict[str, Line2D]:
    """Draw the wall on a panel wide enough for the run, and return the lines that move on it."""
    face = wall.distance if wall.is_touched else WALL_DISTANCE
    panel.axhspan(1e3 * face, 1e3 * (face + 1.0), color='#c9c2b0')
    sway = 1.1 * np.abs(course.uncompensated[:, :2]).max(axis=0) + 0.02
    half = 1e3 * (max(GONDOLA_SIZE[0], *map(abs, geometry.stroke)) + sway[0])
    panel.set(xlim=(-half, half), ylim=(-1e3 * (GONDOLA_SIZE[1] + sway[1] + 0.08), 360.0),
              xlabel='x on the wall [mm]', ylabel='y [mm]', aspect='equal')
    return {name: panel.plot([], [], **look)[0] for name, look in LOOKS.items()}


def _move(lines: dict[str, Line2D], places: dict[str, Any]) -> None:
    for name, points in places.items():
        lines[name].set_data(*(1e3 * np.asarray(points).T))


def save(path: Path, images: list[Image.Image]) -> None:
    """Write the frames as an endless GIF, whatever the name's ending."""
    images[0].save(path, format='GIF', save_all=True, append_images=images[1:],
                   duration=round(1e3 * FRAME_PERIOD), loop=0)


def _places(
    course: Course, standing: np.ndarray, geometry: Geometry, now: int
) -> dict[str, Any]:
    """Return the points of each line on the wall [m]."""
    rail, head = course.rails[now], Pose(*course.heads[now])
    on_rail = relative(rail, head)
    at = joints(geometry, mechanism_of(geometry).platform(on_rail))
    half, far, near = GONDOLA_SIZE
    corners = [(-half, -near), (half, -near), (half, -far), (-half, -far), (-half, -near)]
    carried = {
        'gondola': corners, 'rail': [(bound, 0.0) for bound in geometry.stroke],
        'links': [at.a1, at.b1, (math.nan, math.nan), at.a2, at.b2],
        'guide': [at.a3, at.p], 'platform': [at.b1, at.b2],
        'carriages': [at.a1, at.a2, at.a3], 'head': [on_rail[:2]],
    }
    trail = slice(int(np.searchsorted(course.times, course.times[now] - TRAIL)), now + 1)
    return {
        **{name: [compose(rail, Pose(*point, 0.0))[:2] for point in points]
           for name, points in carried.items()},
        'goal': _cross(Pose(*course.goals[now])), 'standing': _cross(Pose(*standing[now])),
        'head trail': course.heads[trail, :2], 'standing trail': standing[trail, :2],
    }


def _cross(pose: Pose) -> list[Any]:
    along, out = (
        [compose(pose, Pose(x, y, 0.0))[:2] for x, y in ends]
        for ends in (((-CROSS, 0.0), (CROSS, 0.0)), ((0.0, -CROSS), (0.0, CROSS))))
    return [*along, (math.nan, math.nan), *out]


def _triple(pose: np.ndarray) -> str:
    x, y, theta = np.multiply(SCALES, pose)
    return f'{x:+7.1f} {y:+7.1f} mm {theta:+6.2f}°'
