"""
Figures of the design study, numbered as in the paper where the paper has them.

Every function returns a matplotlib figure; `FIGURES` names their files. Lengths are drawn in mm
and angles in degrees, as in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.kinematics import Geometry
from facade_manipulator.workspace.drawing import (
    BLACK,
    BLUE,
    COLOUR_MAP,
    draw_lines_of_force,
    draw_mechanism,
    figure,
    GREEN,
    GREY,
    label,
    lengths,
    MILLIMETRES,
    ORANGE,
    PALE,
    PURPLE,
    Study,
)
from facade_manipulator.workspace.figure_accuracy import figure_accuracy
from facade_manipulator.workspace.figure_workspace import figure_6
from facade_manipulator.workspace.gcw import count_poses
from facade_manipulator.workspace.maps import branch_map, pose_map, PoseMap
from facade_manipulator.workspace.objectives import OBJECTIVES, Requirements
from facade_manipulator.workspace.singularities import (
    beyond_share,
    configurations,
    parallel_curves,
    serial_curve,
)
from facade_manipulator.workspace.table2 import case_geometry, PAPER
from facade_manipulator.workspace.volume import theta_bounds

X_LABEL, Y_LABEL, THETA_LABEL = 'x along the rail [mm]', 'y from the rail [mm]', 'θ [deg]'


def figure_7(study: Study) -> Figure:
    """Draw the singular configurations: the paper's four cases and the one it misses."""
    made = figure(10.0, 6.0, 'Figure 7: singular configurations (l = 250 mm, b = 450 mm)')
    grid = made.subplots(2, 3)
    cases = configurations()
    for axes, case in zip(grid.flat, cases, strict=False):
        draw_mechanism(axes, case.geometry, case.pose)
        label(axes, X_LABEL, Y_LABEL if axes in grid[:, 0] else '', f'{case.name}\n{case.note}')
    draw_lines_of_force(grid.flat[4], cases[4].geometry, cases[4].pose)
    _draw_parallel_locus(grid.flat[5])
    return made


def figure_8(study: Study) -> Figure:
    """Map the section θ = 0 of the paper's cases, with the union over θ about it."""
    made = figure(10.0, 3.7, 'Figure 8: the cases of Table 2, section θ = 0 and union over θ')
    grid = made.subplots(2, 3, sharex=True, sharey=True)
    maps = [_section_map(case_geometry(row.link_length, row.platform_half_length), study)
            for row in PAPER]
    scale = Normalize(0.0, max(np.nanmax(values) for _, _, values in maps))
    for axes, row, section in zip(grid.flat, PAPER, maps, strict=False):
        geometry = case_geometry(row.link_length, row.platform_half_length)
        _draw_section(axes, section, scale)
        _draw_union(axes, geometry)
        ratio = count_poses(geometry).ratio
        label(axes, X_LABEL, Y_LABEL, f'l = {row.link_length * MILLIMETRES:.0f}, b = '
              f'{row.platform_half_length * MILLIMETRES:.0f} mm: ratio {ratio:.3f}')
        axes.set_yticks([0, 100, 200, 300])
        axes.label_outer()
    _legend_panel(grid.flat[5])
    made.colorbar(ScalarMappable(scale, COLOUR_MAP), ax=grid, label=_index_label(study),
                  shrink=0.9)
    return made


def figure_9(study: Study) -> Figure:
    """Map the conditioning index of the design over (x, y) and over (θ, y), in two units."""
    geometry = study.geometry
    made = figure(10.0, 6.2, f'Figure 9: local conditioning index, {lengths(geometry)}')
    grid = made.subplots(2, 2, width_ratios=(1.35, 1.0))
    for row, unit in zip(grid, (study, study._replace(
            characteristic_length=1.0, threshold=0.0)), strict=True):
        section = _section_map(geometry, unit)
        theta, y, of = _turn_map(geometry, unit.characteristic_length)
        scale = Normalize(0.0, np.nanmax(of.index))
        _draw_section(row[0], section, scale)
        label(row[0], X_LABEL, Y_LABEL, 'section θ = 0')
        row[1].pcolormesh(theta, y, of.index, cmap=COLOUR_MAP, norm=scale, rasterized=True)
        if unit.threshold > 0.0:
            row[1].contour(theta, y, of.index, [unit.threshold], colors=ORANGE, linewidths=1.4)
            row[1].plot([], [], color=ORANGE, label=f'LCI = {unit.threshold:g}')
            row[1].legend(loc='lower right')
        label(row[1], THETA_LABEL, Y_LABEL, 'at any x')
        made.colorbar(ScalarMappable(scale, COLOUR_MAP), ax=row, label=_index_label(unit),
                      shrink=0.85)
    return made


def figure_11(study: Study) -> Figure:
    """Plot how far the design turns and travels at every distance, with and without a gap."""
    made = figure(10.0, 4.2, f'Figure 11: ranges of the design, {lengths(study.geometry)}, '
                  f'Q = {study.geometry.stroke_length * MILLIMETRES:.0f} mm')
    left, right = made.subplots(1, 2)
    y = np.linspace(1e-6, study.geometry.link_length, 2000)[:-1]
    for gap, colour, width in (
            (0.0, BLUE, 3.2), (study.geometry.carriage_gap or 0.02, ORANGE, 1.4)):
        geometry = replace(study.geometry, carriage_gap=gap, carriage_length=0.0)
        look = {'color': colour, 'linewidth': width, 'label': f'gap {gap * MILLIMETRES:.0f} mm'}
        left.plot(y * MILLIMETRES, np.degrees(theta_bounds(geometry, y)), **look)
        right.plot(y * MILLIMETRES, pose_map(geometry, y, 0.0).upper * MILLIMETRES, **look)
    label(left, Y_LABEL, '|θ| max [deg]', 'rotation', grid=True)
    label(right, Y_LABEL, '|x| max at θ = 0 [mm]', 'travel along the rail', grid=True)
    for axes in (left, right):
        axes.set_xlim(0.0, study.geometry.link_length * MILLIMETRES)
        axes.set_ylim(bottom=0.0)
        axes.legend()
    return made


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
        right.contour(np.degrees(theta), y * MILLIMETRES, branch_map(geometry, y[:, None], theta),
                      [0.0], colors=colour, linewidths=1.6)
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
    need = Requirements(
        stroke_length=study.geometry.stroke_length, threshold=study.threshold,
        carriage_gap=study.geometry.carriage_gap,
        characteristic_length=study.characteristic_length)
    length = np.linspace(0.15, 0.4, 251)
    grid = made.subplots(2, 2, sharex=True)
    for axes, merit in zip(grid.flat, OBJECTIVES.values(), strict=True):
        values = merit.evaluate(length, 0.7 - length, need)
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


FIGURES: dict[str, Callable[[Study], Figure]] = {
    'figure_06_workspace.png': figure_6,
    'figure_07_singular_configurations.png': figure_7,
    'figure_08_cases.png': figure_8,
    'figure_09_conditioning.png': figure_9,
    'figure_11_ranges.png': figure_11,
    'figure_parallel_singularity.png': figure_singularity,
    'figure_accuracy.png': figure_accuracy,
    'figure_optimum.png': figure_optimum,
}


def _mark_design(axes: Axes, height: float) -> None:
    """Draw the paper's design as a line over l."""
    axes.axvline(352.0, color=GREY, linewidth=1.0, linestyle='--')
    axes.annotate('352/348', (352.0, height), xytext=(-4, 0), textcoords='offset points',
                  ha='right', color=GREY)


def _index_label(study: Study) -> str:
    length = study.characteristic_length
    unit = f'{length:g} m' if length >= 1.0 else f'{length * MILLIMETRES:g} mm'
    return f'LCI (characteristic length {unit})'


def _section_map(
    geometry: Geometry, study: Study
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y [mm] and the index over them at θ = 0, NaN out of reach."""
    least, greatest = geometry.stroke
    x = np.linspace(least, greatest, 801)
    y = np.linspace(1e-6, geometry.link_length, 601)
    of = pose_map(geometry, y, 0.0, study.characteristic_length)
    inside = (of.lower[:, None] <= x) & (x <= of.upper[:, None])
    return x * MILLIMETRES, y * MILLIMETRES, np.where(inside, of.index[:, None], np.nan)


def _turn_map(
    geometry: Geometry, characteristic_length: float
) -> tuple[np.ndarray, np.ndarray, PoseMap]:
    """Return θ [deg], y [mm] and the maps over them, the index NaN out of the workspace."""
    y = np.linspace(1e-6, geometry.link_length, 700)
    end = np.nanmax(theta_bounds(geometry, y))
    theta = np.linspace(-1.05 * end, 1.05 * end, 701)
    of = pose_map(geometry, y[:, None], theta, characteristic_length)
    index = np.where(np.isnan(of.lower) | (of.number <= 0.0), np.nan, of.index)
    return np.degrees(theta), y * MILLIMETRES, of._replace(index=index)


def _draw_section(
    axes: Axes, section: tuple[np.ndarray, np.ndarray, np.ndarray], scale: Normalize
) -> None:
    axes.pcolormesh(*section, cmap=COLOUR_MAP, norm=scale, rasterized=True)
    axes.set_aspect('equal')


def _draw_union(axes: Axes, geometry: Geometry) -> None:
    """Outline what is reached at one angle or another."""
    y = np.linspace(1e-6, geometry.link_length, 400)[:-1]
    theta = theta_bounds(geometry, y)[:, None] * np.linspace(-1.0, 1.0, 201)
    of = pose_map(geometry, y[:, None], theta)
    with np.errstate(invalid='ignore'):
        lower = np.nanmin(np.where(np.isnan(of.lower), np.inf, of.lower), axis=1)
        upper = np.nanmax(np.where(np.isnan(of.upper), -np.inf, of.upper), axis=1)
    reached = np.isfinite(lower)
    outline_x = np.concatenate([lower[reached], upper[reached][::-1], lower[reached][:1]])
    outline_y = np.concatenate([y[reached], y[reached][::-1], y[reached][:1]])
    axes.plot(outline_x * MILLIMETRES, outline_y * MILLIMETRES, color=ORANGE, linewidth=1.2)


def _legend_panel(axes: Axes) -> None:
    axes.axis('off')
    axes.plot([], [], color=ORANGE, label='union over θ')
    axes.plot([], [], 's', color='#3B528B', label='section θ = 0, coloured by its index')
    axes.legend(loc='center', fontsize=9.0)


def _draw_parallel_locus(axes: Axes) -> None:
    """Draw case e of Figure 7 as a curve over (θ, y), in the workspace it cuts."""
    geometry = configurations()[-1].geometry
    theta, y, of = _turn_map(geometry, 1.0)
    region = np.where(np.isnan(of.lower), np.nan, np.where(of.number > 0.0, 0.75, 0.15))
    axes.contourf(theta, y, np.nan_to_num(region, nan=-1.0), [0.0, 0.5, 1.0],
                  colors=[PALE, '#5DC863'])
    angles = np.radians(theta)
    for curve in parallel_curves(geometry, angles):
        axes.plot(theta, curve * MILLIMETRES, color=ORANGE)
    axes.annotate('N > 0', (0.0, 150.0), ha='center')
    axes.annotate('N < 0', (theta[-1] * 0.45, 22.0), ha='center')
    label(axes, THETA_LABEL, Y_LABEL, 'the locus N = 0 (orange)\nin the workspace of this design')
