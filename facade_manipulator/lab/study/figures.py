"""
Figures of the design study, numbered as in the paper where the paper has them.

Every function returns a matplotlib figure; `FIGURES` names their files. Lengths are drawn in mm
and angles in degrees, as in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
import numpy as np

from facade_manipulator.kinematics import Geometry, pose_map, PoseMap
from facade_manipulator.lab.study.drawing import (
    BLUE,
    COLOUR_MAP,
    draw_lines_of_force,
    draw_mechanism,
    figure,
    GREY,
    label,
    MILLIMETRES,
    ORANGE,
    PALE,
    THETA_LABEL,
    X_LABEL,
    Y_LABEL,
)
from facade_manipulator.lab.study.figures_accuracy import figure_accuracy
from facade_manipulator.lab.study.figures_postures import draw_extremes, figure_3, figure_5
from facade_manipulator.lab.study.gcw import case_geometry, count_poses, PAPER
from facade_manipulator.lab.study.singularities import configurations, parallel_curves
from facade_manipulator.lab.study.tables import lengths, Study
from facade_manipulator.lab.study.volume import theta_bounds, union_ends

SLICES, ROWS = 27, 70
EVEN_LENGTH = 1.0  # m: with it weak poses show near the rail as well as at the far edge


def figure_6(study: Study) -> Figure:
    """Draw the workspace of the paper's example and of the design."""
    # The constrained layout does not know the extent of 3-D axes.
    made = figure(10.0, 4.6, 'Figure 6: workspace over x, y and θ', layout=None)
    made.subplots_adjust(left=0.06, right=0.87, bottom=0.0, top=0.93, wspace=0.1)
    stroke = study.geometry.stroke
    example = Geometry(0.25, 0.45, stroke, 0.0)
    scale = Normalize(0.0, 0.45)
    for place, geometry in enumerate((example, study.geometry), start=1):
        axes = made.add_subplot(1, 2, place, projection='3d')
        _draw_slices(axes, geometry, scale)
        axes.set_title(lengths(geometry), y=0.99)
    made.colorbar(ScalarMappable(scale, COLOUR_MAP), cax=made.add_axes((0.91, 0.2, 0.015, 0.6)),
                  label='LCI, characteristic length 1 m (grey: beyond N = 0)')
    return made


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
    unit = study.need.characteristic_length
    geometries = [case_geometry(row.link_length, row.platform_half_length) for row in PAPER]
    maps = [_section_map(geometry, unit) for geometry in geometries]
    scale = Normalize(0.0, max(np.nanmax(values) for _, _, values in maps))
    for axes, geometry, section in zip(grid.flat, geometries, maps, strict=False):
        _draw_section(axes, section, scale)
        _draw_union(axes, geometry)
        ratio = count_poses(geometry).ratio
        label(axes, X_LABEL, Y_LABEL, f'l = {geometry.link_length * MILLIMETRES:.0f}, b = '
              f'{geometry.platform_half_length * MILLIMETRES:.0f} mm: ratio {ratio:.3f}')
        axes.set_yticks([0, 100, 200, 300])
        axes.label_outer()
    _legend_panel(grid.flat[5])
    made.colorbar(ScalarMappable(scale, COLOUR_MAP), ax=grid, label=_index_label(unit), shrink=0.9)
    return made


def figure_9(study: Study) -> Figure:
    """Map the conditioning index of the design over (x, y) and over (θ, y), in two units."""
    geometry = study.geometry
    made = figure(10.0, 6.2, f'Figure 9: local conditioning index, {lengths(geometry)}')
    grid = made.subplots(2, 2, width_ratios=(1.35, 1.0))
    for row, need in zip(grid, (study.need, replace(
            study.need, characteristic_length=EVEN_LENGTH, threshold=0.0)), strict=True):
        section = _section_map(geometry, need.characteristic_length)
        theta, y, of = _turn_map(geometry, need.characteristic_length)
        scale = Normalize(0.0, np.nanmax(of.conditioning))
        _draw_section(row[0], section, scale)
        label(row[0], X_LABEL, Y_LABEL, 'section θ = 0')
        row[1].pcolormesh(theta, y, of.conditioning, cmap=COLOUR_MAP, norm=scale, rasterized=True)
        if need.threshold > 0.0:
            row[1].contour(
                theta, y, of.conditioning, [need.threshold], colors=ORANGE, linewidths=1.4)
            row[1].plot([], [], color=ORANGE, label=f'LCI = {need.threshold:g}')
            row[1].legend(loc='lower right')
        label(row[1], THETA_LABEL, Y_LABEL, 'at any x')
        made.colorbar(ScalarMappable(scale, COLOUR_MAP), ax=row, shrink=0.85,
                      label=_index_label(need.characteristic_length))
    return made


def figure_11(study: Study) -> Figure:
    """Draw the extremes, and how far the design goes at every distance, with and without a gap."""
    made = figure(10.0, 6.4, f'Figure 11: ranges of the design, {lengths(study.geometry)}, '
                  f'Q = {study.geometry.stroke_length * MILLIMETRES:.0f} mm')
    panels = made.subplot_mosaic(
        [[*'aabbcc'], [*'θθθxxx']], height_ratios=(0.7, 1.0))
    left, right = panels['θ'], panels['x']
    draw_extremes([panels[letter] for letter in 'abc'], study.geometry)
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


def _index_label(length: float) -> str:
    unit = f'{length:g} m' if length >= 1.0 else f'{length * MILLIMETRES:g} mm'
    return f'LCI (characteristic length {unit})'


def _section_map(
    geometry: Geometry, characteristic_length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y [mm] and the index over them at θ = 0, NaN out of reach."""
    least, greatest = geometry.stroke
    x = np.linspace(least, greatest, 801)
    y = np.linspace(1e-6, geometry.link_length, 601)
    of = pose_map(geometry, y, 0.0, characteristic_length)
    inside = (of.lower[:, None] <= x) & (x <= of.upper[:, None])
    return x * MILLIMETRES, y * MILLIMETRES, np.where(inside, of.conditioning[:, None], np.nan)


def _turn_map(
    geometry: Geometry, characteristic_length: float
) -> tuple[np.ndarray, np.ndarray, PoseMap]:
    """Return θ [deg], y [mm] and the maps over them, the index NaN out of the workspace."""
    y = np.linspace(1e-6, geometry.link_length, 700)
    end = np.nanmax(theta_bounds(geometry, y))
    theta = np.linspace(-1.05 * end, 1.05 * end, 701)
    of = pose_map(geometry, y[:, None], theta, characteristic_length)
    index = np.where(np.isnan(of.lower) | (of.number <= 0.0), np.nan, of.conditioning)
    return np.degrees(theta), y * MILLIMETRES, of._replace(conditioning=index)


def _draw_section(
    axes: Axes, section: tuple[np.ndarray, np.ndarray, np.ndarray], scale: Normalize
) -> None:
    axes.pcolormesh(*section, cmap=COLOUR_MAP, norm=scale, rasterized=True)
    axes.set_aspect('equal')


def _draw_union(axes: Axes, geometry: Geometry) -> None:
    """Outline what is reached at one angle or another."""
    y = np.linspace(1e-6, geometry.link_length, 400)[:-1]
    theta = theta_bounds(geometry, y)[:, None] * np.linspace(-1.0, 1.0, 201)
    lower, upper = union_ends(geometry, y[:, None], theta)
    reached = np.isfinite(lower)
    y, lower, upper = y[reached], lower[reached], upper[reached]
    axes.plot(MILLIMETRES * np.concatenate([lower, upper[::-1], lower[:1]]),
              MILLIMETRES * np.concatenate([y, y[::-1], y[:1]]), color=ORANGE, linewidth=1.2)


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


def _draw_slices(axes: Any, geometry: Geometry, scale: Normalize) -> None:
    """Draw the slices of a workspace, strip by strip of y."""
    y = np.linspace(1e-6, geometry.link_length, ROWS + 1)
    end = np.nanmax(theta_bounds(geometry, y))
    theta = np.linspace(-end, end, SLICES)
    of = pose_map(geometry, y[:, None], theta, EVEN_LENGTH)
    strips, colours = [], []
    colour_of = ScalarMappable(scale, COLOUR_MAP).to_rgba
    for row, column in np.argwhere(~np.isnan(of.lower[:-1] + of.lower[1:])):
        corners = ((of.lower[row, column], y[row]), (of.upper[row, column], y[row]),
                   (of.upper[row + 1, column], y[row + 1]),
                   (of.lower[row + 1, column], y[row + 1]))
        strips.append([(x * MILLIMETRES, at * MILLIMETRES, np.degrees(theta[column]))
                       for x, at in corners])
        beyond = of.number[row, column] <= 0.0
        colours.append(to_rgba(GREY, 0.2) if beyond
                       else (*colour_of(of.conditioning[row, column])[:3], 0.85))
    axes.add_collection3d(Poly3DCollection(strips, facecolors=colours, edgecolors='none',
                                              antialiased=False))
    _frame(axes, geometry, end)


def _frame(axes: Any, geometry: Geometry, end: float) -> None:
    reach = geometry.stroke_length * 0.5 * MILLIMETRES
    axes.set(xlim=(-reach, reach), ylim=(0.0, geometry.link_length * MILLIMETRES),
             zlim=(-np.degrees(end), np.degrees(end)), xlabel='x [mm]', ylabel='y [mm]')
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel('θ [deg]', rotation=90.0)
    for axis, count in (('x', 5), ('y', 4), ('z', 6)):
        axes.locator_params(axis=axis, nbins=count)
    axes.view_init(elev=24.0, azim=52.0)  # from the façade: what lies beyond N = 0 is behind
    axes.set_box_aspect((1.3, 1.0, 0.9), zoom=1.0)


FIGURES: dict[str, Callable[[Study], Figure]] = {
    'figure_03_motions.png': figure_3,
    'figure_05_working_modes.png': figure_5,
    'figure_06_workspace.png': figure_6,
    'figure_07_singular_configurations.png': figure_7,
    'figure_08_cases.png': figure_8,
    'figure_09_conditioning.png': figure_9,
    'figure_11_ranges.png': figure_11,
    'figure_accuracy.png': figure_accuracy,
}
