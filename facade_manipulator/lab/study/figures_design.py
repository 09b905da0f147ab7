"""Figures of the design study beyond the paper's: singularity, accuracy, optimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
import numpy as np

from facade_manipulator.kinematics import mechanism_of, Pose, pose_map
from facade_manipulator.lab.study.accuracy import Worth, worth
from facade_manipulator.lab.study.drawing import (
    BLACK,
    BLUE,
    COLOUR_MAP,
    figure,
    GREEN,
    GREY,
    label,
    MILLIMETRES,
    ORANGE,
    PURPLE,
    THETA_LABEL,
    Y_LABEL,
)
from facade_manipulator.lab.study.gcw import case_geometry
from facade_manipulator.lab.study.optimise import OBJECTIVES
from facade_manipulator.lab.study.reach import theta_max, y_range
from facade_manipulator.lab.study.singularities import beyond_share, serial_curve
from facade_manipulator.lab.study.sweep import Sweep
from facade_manipulator.lab.study.tables import Study

ROWS, COLUMNS = 41, 21
EDGE = 0.99  # of the greatest turn: at a limit itself there may be no pose
POLYGONS = 6


def figure_singularity(study: Study) -> Figure:
    """Plot the share of the workspace beyond N = 0 along l + b, and the locus of three designs."""
    made = figure(10.0, 4.2, 'The parallel singularity that the paper misses')
    left, right = made.subplots(1, 2)
    length = np.append(0.35 - 0.2 * np.linspace(1.0, 0.0, 40) ** 2, 0.36)
    shares = [beyond_share(case_geometry(one, 0.7 - one, study.geometry.stroke_length))
              for one in length]
    left.plot(length * MILLIMETRES, 100.0 * np.array(shares), color=BLUE)
    _mark_design(left, 44.0)
    label(left, 'l [mm], with l + b = 700 mm', 'workspace beyond N = 0 [%]',
          'share of the volume over x, y and θ', grid=True)
    left.set_ylim(bottom=0.0)
    for one, colour in ((0.2, BLUE), (0.25, ORANGE), (0.3, GREEN), (0.34, PURPLE)):
        geometry = case_geometry(one, 0.7 - one)
        theta = np.linspace(-0.999, 0.999, 800) * np.arcsin(one / (0.7 - one))
        y = np.linspace(1e-6, one, 500)
        right.contour(np.degrees(theta), y * MILLIMETRES,
                      pose_map(geometry, y[:, None], theta).number, [0.0], colors=colour,
                      linewidths=1.6)
        right.plot([], [], color=colour, label=f'l = {one * MILLIMETRES:.0f} mm')
        right.plot(np.degrees(theta), serial_curve(geometry, theta) * MILLIMETRES,
                   color=colour, linewidth=0.9, linestyle=':')
    right.plot([], [], color=BLACK, label='N = 0 (det B = 0)')
    right.plot([], [], color=BLACK, linewidth=0.9, linestyle=':', label='far edge (det A = 0)')
    right.legend(loc='upper right', ncols=1)
    label(right, THETA_LABEL, Y_LABEL, 'below its curve a design stands on another branch')
    return made


def figure_optimum(study: Study) -> Figure:
    """Plot every objective along l + b = 700 mm, its greatest value marked."""
    made = figure(10.0, 6.0, 'Merit of the designs with l + b = 700 mm, '
                  f'Q = {study.geometry.stroke_length * MILLIMETRES:.0f} mm')
    need = replace(study.need, stroke_length=study.geometry.stroke_length,
                   carriage_gap=study.geometry.carriage_gap)
    length, measured = np.linspace(0.15, 0.4, 251), Sweep(need)
    grid = made.subplots(2, 2, sharex=True)
    for axes, merit in zip(grid.flat, OBJECTIVES.values(), strict=True):
        values = merit.evaluate(np.stack([length, 0.7 - length]), measured)
        best = int(np.argmax(values))
        axes.plot(length * MILLIMETRES, values, color=BLUE)
        peak = length[best] * MILLIMETRES, values[best]
        axes.plot(*peak, 'o', color=ORANGE)
        axes.annotate(f'l = {peak[0]:.0f} mm', peak, xytext=(-8, -4), textcoords='offset points',
                      ha='right', color=ORANGE)
        _mark_design(axes, 0.02 * values.max() + 0.98 * values.min())
        unit = f' [{merit.unit.replace("m2", "m²")}]' if merit.unit else ''
        label(axes, 'l [mm]' if axes in grid[1] else '', 'value' + unit,
              merit.description.replace('theta', 'θ'), grid=True)
    return made


def _mark_design(axes: Axes, height: float) -> None:
    """Draw the paper's design as a line over l."""
    axes.axvline(352.0, color=GREY, linewidth=1.0, linestyle='--')
    axes.annotate('352/348', (352.0, height), xytext=(-4, 0), textcoords='offset points',
                  ha='right', color=GREY)


def figure_accuracy(study: Study) -> Figure:
    """Draw three maps over y and θ, and the polygons of velocity and force at θ = 0."""
    made = figure(10.0, 7.5, 'Accuracy, stiffness, force and speed of the head')
    grid = made.subplots(2, 2)
    lower, upper = y_range(study.geometry)
    heights = np.linspace(lower, upper, ROWS + 2)[1:-1]
    head = mechanism_of(study.geometry).head
    poses = [[worth(study.geometry, at.y, at.theta, study.train) for theta in np.linspace(
        -EDGE, EDGE, COLUMNS) * theta_max(study.geometry, y) for at in [head(Pose(0.0, y, theta))]]
        for y in heights.tolist()]
    for axes, title, value in (
            (grid[0, 0], 'position error, 1 sigma [mm]',
             lambda at: np.hypot(*at.errors[:2]) * MILLIMETRES),
            (grid[0, 1], 'log10 of the stiffness along y [N/m]',
             lambda at: np.log10(at.stiffness[1])),
            (grid[1, 0], 'pressing force held for long [N]', lambda at: at.pressing)):
        _draw_map(axes, poses, value)
        label(axes, 'theta [deg]', Y_LABEL, title)
    _draw_polygons(grid[1, 1], [row[COLUMNS // 2] for row in poses[::ROWS // POLYGONS]])
    return made


def _draw_map(
    axes: Axes, poses: list[list[Worth]], value: Callable[[Worth], float]
) -> None:
    theta, y, values = (np.array([[of(at) for at in row] for row in poses]) for of in (
        lambda at: np.degrees(at.theta), lambda at: at.y * MILLIMETRES, value))
    mesh = axes.pcolormesh(theta, y, values, cmap=COLOUR_MAP, shading='gouraud',
                           vmax=np.percentile(values, 97.0))
    axes.figure.colorbar(mesh, ax=axes)


def _draw_polygons(axes: Axes, poses: list[Worth]) -> None:
    """Draw both polygons of poses at θ = 0, one above the other."""
    speed, force = (max(np.abs(getattr(at, name).corners).max() for at in poses)
                    for name in ('speeds', 'forces'))
    for at in poses:
        for name, colour, most, x in (
                ('speeds', BLUE, speed, 0.0), ('forces', ORANGE, force, 150.0)):
            corners = 30.0 / most * np.array(getattr(at, name).corners)
            axes.add_patch(Polygon(corners + (x, at.y * MILLIMETRES), fill=False, color=colour))
    axes.set(xlim=(-80.0, 230.0), ylim=(0.0, max(at.y for at in poses) * MILLIMETRES + 40.0))
    axes.set_aspect('equal', adjustable='box')
    axes.set_xticks([0.0, 150.0], [f'velocity up to\n{speed:.2g} m/s',
                                   f'force up to\n{force:.3g} N'])
    label(axes, '', Y_LABEL, 'what the drives allow at theta = 0, x to the right')
