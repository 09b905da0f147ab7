"""
Figures of the study, numbered as in the paper.

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
import numpy as np

from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.maps import pose_map
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.study import drawing, figures_postures
from facade_manipulator.study.drawing import COLOUR_MAP, label, plan_view
from facade_manipulator.study.paper import CASES, design, ratio_on_grid
from facade_manipulator.study.paper_tables import lengths, Study
from facade_manipulator.study.singularities import (
    configurations,
    parallel_curves,
    serial_curve,
)
from facade_manipulator.study.workspace_metrics import (
    Good,
    require_section,
    theta_bounds,
    union_ends,
)

# this unit shows weak poses near the rail as well as at the far edge
METRE = Good(0.0, 1.0)
EXAMPLE = (0.25, 0.45)  # l and b of Figures 6 and 7 [m]


def figure_6(study: Study) -> Figure:
    """Draw the workspace of the paper's example and of the design."""
    stroke = study.geometry.stroke_length
    title = f'Figure 6: workspace over x, y and θ, Q = {stroke * 1e3:g} mm'
    made = drawing.figure(10.0, 4.6, title)
    made.set_layout_engine('none')  # it ignores the extent of 3-D axes
    scale = Normalize(0.0, 0.45)
    for left, geometry in ((0.02, design(*EXAMPLE, stroke)), (0.46, study.geometry)):
        place = (left, 0.0, 0.4, 0.93)
        axes = made.add_axes(place, projection='3d', computed_zorder=False)
        _draw_slices(axes, geometry, scale)
        axes.set_title(lengths(geometry), y=0.99)
    made.colorbar(
        ScalarMappable(scale, COLOUR_MAP),
        cax=made.add_axes((0.88, 0.2, 0.015, 0.6)),
        label=f'{_index_label(1.0)}\n(grey: beyond N = 0)',
    )
    return made


def figure_7(study: Study) -> Figure:
    """Draw the singular configurations: four cases of the paper, and one missing in the paper."""
    geometry = design(*EXAMPLE, study.geometry.stroke_length)
    title = f'Figure 7: singular configurations, {lengths(geometry)}'
    made = drawing.figure(10.0, 5.0, title)
    grid = made.subplots(2, 3)
    cases = configurations(geometry).items()
    for axes, (name, pose) in zip(grid.flat, cases, strict=False):
        drawing.draw_mechanism(axes, geometry, pose, has_names=True)
        plan_view(axes, 580.0, (-170.0, 360.0), name)
        axes.label_outer()
    drawing.draw_lines_of_force(axes, geometry, pose)
    _draw_loci(grid.flat[5], geometry)
    return made


def figure_8(study: Study) -> Figure:
    """Draw the section θ = 0 for the cases of Table 2, inside the union over all θ."""
    stroke = study.geometry.stroke_length
    unit = study.good.characteristic_length
    title = f'Figure 8: workspace of the cases of Table 2, Q = {stroke * 1e3:g} mm'
    made = drawing.figure(10.0, 4.0, title)
    grid = made.subplots(2, 3, sharex=True, sharey=True)
    geometries = []
    for case in CASES:
        geometries.append(design(case.link_length, case.platform_half_length, stroke))
    maps = [_section_map(geometry, unit) for geometry in geometries]
    # links longer than b reach θ = 0 with any stroke, so that not all values are NaN
    indices = np.concatenate([values.ravel() for _, _, values in maps])
    scale = Normalize(0.0, np.nanmax(indices))

    for axes, geometry, section in zip(grid.flat, geometries, maps, strict=False):
        axes.pcolormesh(*section, cmap=COLOUR_MAP, norm=scale, rasterized=True)
        _draw_union(axes, geometry)
        ratio = ratio_on_grid(geometry, study.good)
        name = f'{lengths(geometry)}\ngood-condition ratio {ratio:.3f}'
        plan_view(axes, 540.0 * max(1.0, stroke), (0.0, 380.0), name)
        axes.label_outer()

    grid[1, 2].axis('off')
    grid[1, 2].legend(
        *axes.get_legend_handles_labels(),
        loc='center',
        fontsize=9.0,
        title='coloured: reached at θ = 0',
    )
    colours = ScalarMappable(scale, COLOUR_MAP)
    made.colorbar(colours, ax=grid, label=_index_label(unit), shrink=0.9)
    return made


def figure_9(study: Study) -> Figure:
    """Draw the design's conditioning index over (x, y) and (θ, y), for two units of length."""
    geometry = study.geometry
    require_section(geometry)
    made = drawing.figure(10.0, 6.2, study.title('Figure 9: conditioning'))
    grid = made.subplots(2, 2, width_ratios=(1.35, 1.0))
    for row, good in zip(grid, (study.good, METRE), strict=True):
        section = _section_map(geometry, good.characteristic_length)
        turns = _turn_map(geometry, good.characteristic_length)
        _, _, index = turns
        scale = Normalize(0.0, np.nanmax(index))

        row[0].pcolormesh(*section, cmap=COLOUR_MAP, norm=scale, rasterized=True)
        row[0].set_aspect('equal')
        label(row[0], drawing.X_LABEL, drawing.Y_LABEL, 'at θ = 0')
        row[1].pcolormesh(*turns, cmap=COLOUR_MAP, norm=scale, rasterized=True)
        title = 'at any x'
        if good.threshold > 0.0:
            level = [good.threshold]
            row[1].contour(*turns, level, colors=drawing.ORANGE, linewidths=1.4)
            title += f' (orange: 1/k = {good.threshold:g})'
        label(row[1], drawing.THETA_LABEL, drawing.Y_LABEL, title)
        made.colorbar(
            ScalarMappable(scale, COLOUR_MAP),
            ax=row,
            shrink=0.85,
            label=_index_label(good.characteristic_length),
        )
    return made


def _turn_map(
    geometry: Geometry, characteristic_length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return θ [deg], y [mm] and their index; NaN if out of reach or beyond N = 0."""
    y = np.linspace(1e-6, geometry.link_length, 700)
    end = 1.05 * np.nanmax(theta_bounds(geometry, y))
    theta = np.linspace(-end, end, 701)
    at = pose_map(geometry, y[:, None], theta, characteristic_length)
    is_outside = np.isnan(at.lower) | (at.number <= 0.0)
    index = np.where(is_outside, np.nan, at.conditioning)
    return np.degrees(theta), y * MM, index


MACHINE_GAP = 0.02  # m


def figure_11(study: Study) -> Figure:
    """Draw extremes and ranges over the distance from the rail, with and without carriage gap."""
    made = drawing.figure(10.0, 5.8, study.title('Figure 11: ranges'))
    panels = made.subplot_mosaic([[*'aabbcc'], [*'θθθxxx']], height_ratios=(0.62, 1.0))
    left = panels['θ']
    right = panels['x']
    figures_postures.draw_extremes([panels[letter] for letter in 'abc'], study.geometry)

    length = study.geometry.link_length
    y = np.linspace(1e-6, length, 2000)[:-1]
    machine_gap = study.geometry.carriage_gap or MACHINE_GAP
    for gap, colour, style in (
        (0.0, drawing.BLUE, '-'),
        (machine_gap, drawing.ORANGE, '--'),
    ):
        geometry = replace(study.geometry, carriage_gap=gap)
        theta = np.degrees(theta_bounds(geometry, y))
        x = pose_map(geometry, y, 0.0).upper * MM
        words = f'{gap * MM:.0f} mm between carriages'
        look = {'color': colour, 'linestyle': style, 'label': words}
        left.plot(y * MM, theta, **look)
        right.plot(y * MM, x, **look)

    label(left, drawing.Y_LABEL, 'maximum angle |θ| [deg]', 'd) rotation')
    travel = 'maximum |x| at θ = 0 [mm]'
    label(right, drawing.Y_LABEL, travel, 'e) travel along the rail')
    for axes in (left, right):
        axes.set(xlim=(0.0, length * MM), ylim=(0.0, None))
        axes.grid(color=drawing.PALE, linewidth=0.6)
        axes.legend(loc='lower left' if axes is right else 'upper left')
    return made


def _index_label(length: float) -> str:
    unit = {0.001: 'mm', 1.0: 'm'}.get(length, f'{length:g} m')
    return f'conditioning index 1/k,\nlengths in {unit}'


def _section_map(
    geometry: Geometry, characteristic_length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y [mm] and their index at θ = 0; NaN if out of reach."""
    x = np.linspace(*geometry.stroke, 801)
    y = np.linspace(1e-6, geometry.link_length, 601)
    at = pose_map(geometry, y, 0.0, characteristic_length)
    inside = (at.lower[:, None] <= x) & (x <= at.upper[:, None])
    index = np.where(inside, at.conditioning[:, None], np.nan)
    return x * MM, y * MM, index


def _draw_union(axes: Axes, geometry: Geometry) -> None:
    """Draw the outline of all points that the head reaches at some angle."""
    y = np.linspace(1e-6, geometry.link_length, 400)[:-1]
    theta = theta_bounds(geometry, y)[:, None] * np.linspace(-1.0, 1.0, 201)
    lower, upper = union_ends(geometry, y[:, None], theta)
    reached = np.isfinite(lower)
    y = y[reached]
    lower = lower[reached]
    upper = upper[reached]
    # up along the lower ends, down along the upper ends, and back to the first point
    along = np.concatenate([lower, upper[::-1], lower[:1]])
    across = np.concatenate([y, y[::-1], y[:1]])
    axes.plot(
        MM * along,
        MM * across,
        color=drawing.ORANGE,
        linewidth=1.2,
        label='outline: reached at any angle θ',
    )


def _draw_loci(axes: Axes, geometry: Geometry) -> None:
    """Draw the loci where one of both determinants is zero, over (θ, y)."""
    theta = np.radians(np.linspace(-34.0, 34.0, 681))
    angle = np.degrees(theta)
    serial = serial_curve(geometry, theta) * MM
    axes.plot(angle, serial, color=drawing.BLUE, label='det A = 0')
    lower, upper = parallel_curves(geometry, theta)
    colour = drawing.ORANGE
    axes.plot(angle, lower * MM, color=colour, label='det B = 0')
    axes.plot(angle, upper * MM, color=colour)
    axes.annotate('N > 0', (0.0, 130.0), ha='center')
    axes.annotate('N < 0', (20.0, 20.0), ha='center')
    axes.set_ylim(bottom=0.0)
    axes.legend()
    label(axes, drawing.THETA_LABEL, drawing.Y_LABEL, 'singular loci at any x')


SLICES = 27  # of θ in Figure 6
ROWS = 70  # of y in Figure 6


def _draw_slices(axes: Any, geometry: Geometry, scale: Normalize) -> None:
    """Draw slices of a workspace at several angles, coloured by conditioning."""
    y = np.linspace(1e-6, geometry.link_length, ROWS)[:, None]
    end = np.nanmax(theta_bounds(geometry, y))
    # upwards, so that each covers the lower ones
    for theta in np.linspace(-end, end, SLICES):
        at = pose_map(geometry, y, theta, METRE.characteristic_length)
        colours = ScalarMappable(scale, COLOUR_MAP).to_rgba(at.conditioning, alpha=0.85)
        colours[at.number <= 0.0] = to_rgba(drawing.GREY, 0.2)
        x = np.hstack([at.lower, at.upper])
        height = np.full_like(x, np.degrees(theta))
        across = np.broadcast_to(y, x.shape)
        axes.plot_surface(
            x * MM,
            across * MM,
            height,
            facecolors=np.repeat(colours, 2, axis=1),
            shade=False,
            rcount=ROWS,
            antialiased=False,
        )

    reach = 0.5 * geometry.stroke_length * MM
    far = geometry.link_length * MM
    turn = np.degrees(end)
    axes.set(xlim=(-reach, reach), ylim=(0.0, far), zlim=(-turn, turn))
    axes.set(xlabel='x [mm]', ylabel='y [mm]')
    axes.zaxis.set_rotate_label(False)
    axes.set_zlabel('θ [deg]', rotation=90.0)
    for axis, count in (('x', 5), ('y', 4), ('z', 6)):
        axes.locator_params(axis=axis, nbins=count)
    # seen from the façade: poses beyond N = 0 are behind
    axes.view_init(elev=24.0, azim=52.0)
    axes.set_box_aspect((1.3, 1.0, 0.9), zoom=0.9)


FIGURES: dict[str, Callable[[Study], Figure]] = {
    'figure_03_motions.png': figures_postures.figure_3,
    'figure_05_working_modes.png': figures_postures.figure_5,
    'figure_06_workspace.png': figure_6,
    'figure_07_singular_configurations.png': figure_7,
    'figure_08_cases.png': figure_8,
    'figure_09_conditioning.png': figure_9,
    'figure_11_ranges.png': figure_11,
    'figure_12_compensation.png': figures_postures.figure_12,
}
