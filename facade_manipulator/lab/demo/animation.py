"""The end of a demo run as an animation: wall, swaying gondola, linkage, head and goal."""

from __future__ import annotations

from collections.abc import Iterator
import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np
from PIL import Image  # matplotlib needs it too

from facade_manipulator.kinematics import compose, Geometry, joints, mechanism_of, Pose, relative
from facade_manipulator.lab.demo.course import Course
from facade_manipulator.lab.gondola import Facade, FacadeSettings, SCALES
from facade_manipulator.lab.gondola.pictures import GOAL, WITH, WITHOUT

FRAMES, FRAME_PERIOD = 120, 0.1  # 12 s as fast as they went
TRAIL = 3.0
SIZE, DOTS_PER_INCH = (8.0, 4.0), 80
COLOURS = 96
WALL, RAIL, GONDOLA, PLATFORM = '#c9c2b0', '#444444', '#d3dfe8', '#e69f00'
WALL_DISTANCE = 0.3  # m, in a scenario without a wall to touch
GONDOLA_SIZE = (0.6, 0.12, 0.03)  # m: half its length, its far and its near side behind the rail
CROSS = 0.035


def frames(course: Course, geometry: Geometry, wall: FacadeSettings) -> Iterator[Image.Image]:
    """
    Yield the last seconds of a run, of two samples at least, frame by frame in one palette.

    The wall is drawn at some distance where there is none to touch.
    """
    count = int(min(FRAMES, (course.times[-1] - course.times[0]) / FRAME_PERIOD)) or 1
    scene = Drawing(course, geometry, wall)
    palette = None
    for i in range(count):
        scene.show(course.times[-1] - (count - 1 - i) * FRAME_PERIOD)
        # A median cut would lose the goal's few pixels in the platform.
        palette = palette or scene.image().quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE)
        yield scene.image().quantize(palette=palette, dither=Image.Dither.NONE)


def save(path: Path, images: list[Image.Image]) -> None:
    """Write the frames as an endless GIF, whatever the name's ending."""
    images[0].save(path, format='GIF', save_all=True, append_images=images[1:],
                   duration=round(1e3 * FRAME_PERIOD), loop=0)


class Drawing:
    """One figure whose lines are moved from frame to frame."""

    def __init__(self, course: Course, geometry: Geometry, wall: FacadeSettings) -> None:
        self._course = course
        self._geometry = geometry
        self._figure = Figure(figsize=SIZE, dpi=DOTS_PER_INCH)
        self._canvas = FigureCanvasAgg(self._figure)
        self._panel = self._figure.add_axes((0.09, 0.13, 0.89, 0.73))
        self._without = course.uncompensated
        self._standing = course.references + self._without
        self._gondola, = self._panel.fill([], [], color=GONDOLA)
        self._lines = _lines(self._panel)
        self._text = self._figure.text(0.09, 0.955, '', va='top', family='monospace', fontsize=9)
        self._set_limits()
        _draw_wall(self._panel, wall)
        legend = self._panel.legend(loc='lower right', fontsize=8, ncols=3, framealpha=0.9)
        self._moving = (self._gondola, *self._lines.values(), legend, self._text)
        for artist in self._moving:
            artist.set_animated(True)
        self._canvas.draw()
        self._background = self._canvas.copy_from_bbox(self._figure.bbox)  # drawn once

    def show(self, time: float) -> None:
        """Move everything to where it was at a time [s]."""
        now = int(np.searchsorted(self._course.times, time).clip(0, len(self._course.times) - 1))
        trail = slice(int(np.searchsorted(self._course.times, time - TRAIL)), now + 1)
        goal = Pose(*self._course.goals[now])
        places = {
            **_mechanism(self._geometry, self._course.rails[now],
                         Pose(*self._course.heads[now])),
            'goal': _cross(goal), 'standing': _cross(Pose(*self._standing[now])),
            'head trail': self._course.heads[trail, :2],
            'standing trail': self._standing[trail, :2],
        }
        self._gondola.set_xy(1e3 * np.array(places.pop('gondola')))
        for name, points in places.items():
            self._lines[name].set_data(*(1e3 * np.asarray(points).T))
        self._text.set_text('\n'.join((
            f'{time:6.1f} s  without compensation    {_triple(self._without[now])}',
            f'          from where it should be {_triple(self._course.errors[now])}')))

    def image(self) -> Image.Image:
        """Return what is shown."""
        self._canvas.restore_region(self._background)
        for artist in self._moving:
            self._figure.draw_artist(artist)
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert('RGB')

    def _set_limits(self) -> None:
        sway = 1.1 * np.abs(self._without[:, :2]).max(axis=0)
        least, greatest = self._geometry.stroke
        half = max(GONDOLA_SIZE[0], abs(least), abs(greatest)) + sway[0] + 0.02
        self._panel.set(xlim=(-1e3 * half, 1e3 * half),
                        ylim=(-1e3 * (GONDOLA_SIZE[1] + sway[1] + 0.1), 1e3 * 0.36),
                        xlabel='x on the wall [mm]', ylabel='y [mm]')
        self._panel.set_aspect('equal', adjustable='box')


def _mechanism(geometry: Geometry, rail: Pose, head: Pose) -> dict[str, list]:
    """Return the ends of everything that the gondola carries, on the wall [m]."""
    on_rail = relative(rail, head)
    at = joints(geometry, mechanism_of(geometry).platform(on_rail))
    half, far, near = GONDOLA_SIZE
    ends = {
        'gondola': [(-half, -near), (half, -near), (half, -far), (-half, -far)],
        'rail': [(bound, 0.0) for bound in geometry.stroke],
        'links': [at.a1, at.b1, (math.nan, math.nan), at.a2, at.b2],
        'guide': [at.a3, at.p], 'platform': [at.b1, at.b2],
        'carriages': [at.a1, at.a2, at.a3], 'head': [on_rail[:2]],
    }
    return {name: [compose(rail, Pose(*point, 0.0))[:2] for point in points]
            for name, points in ends.items()}


def _cross(pose: Pose) -> list:
    along, out = (
        [compose(pose, Pose(*(sign * CROSS * step for step in way), 0.0))[:2]
         for sign in (-1.0, 1.0)] for way in ((1.0, 0.0), (0.0, 1.0)))
    return [*along, (math.nan, math.nan), *out]


def _lines(panel: Axes) -> dict:
    """Return the lines that move, from the furthest behind to the foremost."""
    looks = {
        'rail': {'color': RAIL, 'lw': 5},
        'standing trail': {'color': WITHOUT, 'lw': 1},
        'guide': {'color': '#aaaaaa', 'lw': 2},
        'links': {'color': RAIL, 'lw': 3},
        'platform': {'color': PLATFORM, 'lw': 5},
        'carriages': {'color': RAIL, 'marker': 's', 'ms': 9, 'ls': ''},
        'standing': {'color': WITHOUT, 'lw': 2, 'label': 'without compensation'},
        'goal': {'color': GOAL, 'lw': 2, 'label': 'goal'},
        'head trail': {'color': WITH, 'lw': 1},
        'head': {'color': WITH, 'marker': 'o', 'ms': 7, 'ls': '', 'label': 'head'},
    }
    return {name: panel.plot([], [], **look)[0] for name, look in looks.items()}


def _draw_wall(panel: Axes, wall: FacadeSettings) -> None:
    places = np.linspace(-1.5, 1.5, 1000)
    facade = Facade(wall)
    faces = np.array([facade.distance(x) if wall.present else WALL_DISTANCE for x in places])
    panel.fill_between(1e3 * places, 1e3 * faces, 1e3 * (faces.max() + 1.0), color=WALL)


def _triple(pose: np.ndarray) -> str:
    x, y, theta = np.multiply(SCALES, pose)
    return f'{x:+7.1f} {y:+7.1f} mm {theta:+6.2f}°'
