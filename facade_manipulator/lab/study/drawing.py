"""
What every figure of the study shares: style, colours, labels, the mechanism in plan view.

Only the figures import this module, and matplotlib is imported with it: the nodes never load it.
"""

from __future__ import annotations

from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.kinematics import Geometry, joints, Pose

COLOUR_MAP = 'viridis'  # even in lightness, safe for the colour-blind, and in grey
# Okabe and Ito's colours, distinct to every eye.
BLUE, ORANGE, GREEN = '#0072B2', '#D55E00', '#009E73'
BLACK, GREY, PALE = '#000000', '#777777', '#D9D9D9'
MILLIMETRES = 1e3
MACHINE_MODE = '+-'  # signs of the roots in eqs 7 and 8
X_LABEL, Y_LABEL, THETA_LABEL = 'x along the rail [mm]', 'y from the rail [mm]', 'θ [deg]'

STYLE = {
    'font.size': 9.0, 'axes.titlesize': 9.5, 'axes.labelsize': 9.0, 'legend.fontsize': 8.0,
    'axes.spines.top': False, 'axes.spines.right': False, 'axes.grid': False,
    'axes.linewidth': 0.8, 'lines.linewidth': 1.6, 'legend.frameon': False,
    'figure.dpi': 150, 'savefig.dpi': 150, 'font.family': 'DejaVu Sans',
}


def figure(
    width: float, height: float, title: str, layout: Literal['constrained'] | None = 'constrained'
) -> Figure:
    """Return an empty figure of a size in inches under a title."""
    made = Figure(figsize=(width, height), layout=layout)
    made.suptitle(title, fontsize=11.0, fontweight='bold')
    return made


def label(axes: Axes, x: str, y: str, title: str = '', grid: bool = False) -> None:
    """Name both axes of a plot, units included, and give it a title, and a grid."""
    axes.set(xlabel=x, ylabel=y, title=title)
    if grid:
        axes.grid(color=PALE, linewidth=0.6)


def draw_mechanism(
    axes: Axes, geometry: Geometry, pose: Pose, mode: str = MACHINE_MODE, alpha: float = 1.0
) -> None:
    """Draw rail, carriages, links and platform of a pose in mm, in a working mode of eqs 7-8."""
    at = joints_in_mode(geometry, pose, mode)
    ends = [*geometry.stroke, *(at[name][0] for name in ('a1', 'a2', 'a3'))]
    axes.plot([MILLIMETRES * min(ends), MILLIMETRES * max(ends)], [0.0, 0.0],
              color=PALE, linewidth=5.0, solid_capstyle='butt', zorder=1)
    for start, end, colour, width in (
            ('a1', 'b1', BLUE, 2.4), ('a2', 'b2', BLUE, 2.4), ('b1', 'b2', ORANGE, 4.0),
            ('a3', 'p', GREY, 1.2)):
        axes.plot(*zip(at[start] * MILLIMETRES, at[end] * MILLIMETRES, strict=True),
                  color=colour, linewidth=width, alpha=alpha, solid_capstyle='round', zorder=2)
    for name, place in at.items():
        on_rail = name.startswith('a')
        axes.plot(*(place * MILLIMETRES), 's' if on_rail else 'o', color=BLACK, alpha=alpha,
                  markersize=4.5, zorder=3)
        if alpha == 1.0:
            axes.annotate(
                name.upper(), tuple(place * MILLIMETRES), ha='center', fontsize=8.0,
                xytext=(0, -15 if on_rail or place[1] < 0.0 else 8), textcoords='offset points')
    axes.set_aspect('equal', adjustable='datalim')


def draw_lines_of_force(axes: Axes, geometry: Geometry, pose: Pose) -> None:
    """Draw the lines of both links and the rail's parallel through P, which meet where N = 0."""
    at = joints_in_mode(geometry, pose)
    for joint, carriage in ((at['b1'], at['a1']), (at['b2'], at['a2'])):
        share = (pose.y - carriage[1]) / (joint[1] - carriage[1])
        meeting = carriage + share * (joint - carriage)
        axes.plot(*zip(carriage * MILLIMETRES, meeting * MILLIMETRES, strict=True),
                  color=GREEN, linewidth=1.0, linestyle='--', zorder=1)
    axes.plot([pose.x * MILLIMETRES, meeting[0] * MILLIMETRES], [pose.y * MILLIMETRES] * 2,
              color=GREEN, linewidth=1.0, linestyle='--', zorder=1)
    axes.plot(*(meeting * MILLIMETRES), 'o', color=GREEN, markersize=5.0, zorder=3)


def joints_in_mode(
    geometry: Geometry, pose: Pose, mode: str = MACHINE_MODE
) -> dict[str, np.ndarray]:
    """Return the joints by name; the far edge from so near that no line moves by 1 µm."""
    inside = pose._replace(y=(1.0 - 1e-12) * pose.y)
    at = {name: np.array(point)
          for name, point in joints(geometry, inside)._asdict().items()}
    for side, sign, own in zip('12', mode, MACHINE_MODE, strict=True):
        if sign != own:  # the other root: the carriage beyond its joint
            at[f'a{side}'][0] += 2.0 * (at[f'b{side}'] - at[f'a{side}'])[0]
    return at
