"""What the head is worth over the workspace: maps and polygons."""

from __future__ import annotations

from collections.abc import Callable

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
import numpy as np

from facade_manipulator.kinematics import mechanism_of, Pose
from facade_manipulator.lab.study import drawing
from facade_manipulator.lab.study.accuracy import Worth, worth
from facade_manipulator.lab.study.reach import theta_max, y_range
from facade_manipulator.lab.study.tables import Study

ROWS, COLUMNS = 41, 21
EDGE = 0.99  # of the greatest turn: at a limit itself there may be no pose
POLYGONS = 6


def figure_accuracy(study: Study) -> Figure:
    """Draw three maps over y and θ, and the polygons of velocity and force at θ = 0."""
    made = drawing.figure(10.0, 7.5, 'Accuracy, stiffness, force and speed of the head')
    grid = made.subplots(2, 2)
    lower, upper = y_range(study.geometry)
    heights = np.linspace(lower, upper, ROWS + 2)[1:-1]
    head = mechanism_of(study.geometry).head
    poses = [[worth(study.geometry, at.y, at.theta, study.train) for theta in np.linspace(
        -EDGE, EDGE, COLUMNS) * theta_max(study.geometry, y) for at in [head(Pose(0.0, y, theta))]]
        for y in heights.tolist()]
    for axes, title, value in (
            (grid[0, 0], 'position error, 1 sigma [mm]',
             lambda at: np.hypot(*at.errors[:2]) * drawing.MILLIMETRES),
            (grid[0, 1], 'log10 of the stiffness along y [N/m]',
             lambda at: np.log10(at.stiffness[1])),
            (grid[1, 0], 'pressing force held for long [N]', lambda at: at.pressing)):
        _draw_map(axes, poses, value)
        drawing.label(axes, 'theta [deg]', drawing.Y_LABEL, title)
    _draw_polygons(grid[1, 1], [row[COLUMNS // 2] for row in poses[::ROWS // POLYGONS]])
    return made


def _draw_map(
    axes: Axes, poses: list[list[Worth]], value: Callable[[Worth], float]
) -> None:
    theta, y, values = (np.array([[of(at) for at in row] for row in poses]) for of in (
        lambda at: np.degrees(at.theta), lambda at: at.y * drawing.MILLIMETRES, value))
    mesh = axes.pcolormesh(theta, y, values, cmap=drawing.COLOUR_MAP, shading='gouraud',
                           vmax=np.percentile(values, 97.0))
    axes.figure.colorbar(mesh, ax=axes)


def _draw_polygons(axes: Axes, poses: list[Worth]) -> None:
    """Draw both polygons of poses at θ = 0, one above the other."""
    speed, force = (max(np.abs(getattr(at, name).corners).max() for at in poses)
                    for name in ('speeds', 'forces'))
    for at in poses:
        for name, colour, most, x in (
                ('speeds', drawing.BLUE, speed, 0.0), ('forces', drawing.ORANGE, force, 150.0)):
            corners = 30.0 / most * np.array(getattr(at, name).corners)
            corners += x, at.y * drawing.MILLIMETRES
            axes.add_patch(Polygon(corners, fill=False, color=colour))
    farthest = max(at.y for at in poses) * drawing.MILLIMETRES
    axes.set(xlim=(-80.0, 230.0), ylim=(0.0, farthest + 40.0))
    axes.set_aspect('equal', adjustable='box')
    axes.set_xticks([0.0, 150.0], [f'velocity up to\n{speed:.2g} m/s',
                                   f'force up to\n{force:.3g} N'])
    drawing.label(axes, '', drawing.Y_LABEL, 'what the drives allow at theta = 0, x to the right')
