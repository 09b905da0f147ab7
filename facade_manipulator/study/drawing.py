"""
Style, colours and plan view of the mechanism, shared by all figures.

Only the figures import this module, because it imports matplotlib, which no node needs.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.kinematics import compose, Geometry, joints, Pose, ZERO_POSE
from facade_manipulator.kinematics.planar import MM

# of even lightness, distinct for colour-blind readers and in grey
COLOUR_MAP = 'viridis'
# Okabe and Ito's colours, which colour-blind readers can distinguish
BLUE = '#0072B2'
ORANGE = '#D55E00'
GREEN = '#009E73'
BLACK = '#000000'
GREY = '#777777'
PALE = '#D9D9D9'
MACHINE_MODE = '+-'  # signs of the roots in eqs 7 and 8
GHOST = 0.3  # opacity of postures behind the named one
X_LABEL = 'x along the rail [mm]'
Y_LABEL = 'y from the rail [mm]'
THETA_LABEL = 'angle θ [deg]'

STYLE = {
    'font.size': 9.0,
    'axes.titlesize': 9.5,
    'axes.labelsize': 9.0,
    'legend.fontsize': 8.0,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.grid': False,
    'axes.linewidth': 0.8,
    'lines.linewidth': 1.6,
    'legend.frameon': False,
    'figure.dpi': 150,
    'savefig.dpi': 150,
    'font.family': 'DejaVu Sans',
}


def figure(width: float, height: float, title: str) -> Figure:
    """Return an empty figure with a size in inches and a title."""
    made = Figure(figsize=(width, height), layout='constrained')
    made.suptitle(title, fontsize=11.0, fontweight='bold')
    return made


def label(axes: Axes, x: str, y: str, title: str = '') -> None:
    """Set the title of a plot, and the names and units of both axes."""
    axes.set(xlabel=x, ylabel=y, title=title)


def plan_view(axes: Axes, x: float, y: tuple[float, float], title: str) -> None:
    """Prepare a plan view of the mechanism from -x to x [mm] with equal axis scales."""
    axes.set(xlim=(-x, x), ylim=y, aspect='equal')
    label(axes, X_LABEL, Y_LABEL, title)


def joints_in_mode(
    geometry: Geometry, pose: Pose, mode: str = MACHINE_MODE
) -> dict[str, np.ndarray]:
    """Return the joint positions [m] by name, in a working mode of eqs 7-8."""
    # the far edge itself is out of reach
    inside = pose._replace(y=(1.0 - 1e-12) * pose.y)
    at = {}
    for name, point in joints(geometry, inside)._asdict().items():
        at[name] = np.array(point)
    for side, sign, own in zip('12', mode, MACHINE_MODE, strict=True):
        if sign != own:  # the other root: the carriage beyond its joint
            at[f'a{side}'][0] += 2.0 * (at[f'b{side}'] - at[f'a{side}'])[0]
    return at


LINKS = (  # ends, colour and width of the lines of the mechanism
    ('a1', 'b1', BLUE, 2.4),
    ('a2', 'b2', BLUE, 2.4),
    ('b1', 'b2', ORANGE, 4.0),
    ('a3', 'p', GREY, 1.2),
)


def draw_mechanism(
    axes: Axes,
    geometry: Geometry,
    pose: Pose,
    mode: str = MACHINE_MODE,
    alpha: float = 1.0,
    rail: Pose = ZERO_POSE,
    has_names: bool = False,
) -> None:
    """Draw rail, carriages, links and platform at a pose [mm], on a rail at a pose."""
    on_rail = joints_in_mode(geometry, pose, mode)
    carriages = [on_rail[name][0] for name in ('a1', 'a2', 'a3')]
    ends = [*geometry.stroke, *carriages]
    start = _placed(rail, (min(ends), 0.0))
    end = _placed(rail, (max(ends), 0.0))
    at = {name: _placed(rail, point) for name, point in on_rail.items()}

    style = {'linewidth': 5.0, 'solid_capstyle': 'butt', 'zorder': 1}
    _draw_line(axes, start, end, PALE, **style)
    for first, second, colour, width in LINKS:
        style = {'linewidth': width, 'solid_capstyle': 'round', 'zorder': 2}
        _draw_line(axes, at[first], at[second], colour, alpha=alpha, **style)
    for name, place in at.items():
        marker = 's' if name.startswith('a') else 'o'
        axes.plot(*place, marker, color=BLACK, alpha=alpha, markersize=4.5, zorder=3)
        if has_names:
            _draw_name(axes, name, place)


def _placed(rail: Pose, point: Iterable[float]) -> np.ndarray:
    """Transform a point from the rail's frame [m] to the drawing's frame [mm]."""
    x, y = point
    place = compose(rail, Pose(x, y, 0.0))
    return MM * np.array(place[:2])


def _draw_line(
    axes: Axes, start: np.ndarray, end: np.ndarray, colour: str, **style: Any
) -> None:
    """Draw a line between two points [mm]."""
    x, y = zip(start, end, strict=True)
    axes.plot(x, y, color=colour, **style)


NAMES = {  # offset [points] and alignment of labels, which do not overlap where all carriages meet
    'a1': (-1, -14, 'right'),
    'a3': (0, -24, 'center'),
    'a2': (2, -14, 'left'),
    'b1': (-5, 5, 'right'),
    'p': (0, 5, 'center'),
    'b2': (5, 5, 'left'),
}


def _draw_name(axes: Axes, name: str, place: np.ndarray) -> None:
    """Draw the name of a joint next to its position [mm]."""
    right, up, alignment = NAMES[name]
    is_behind_rail = place[1] < 0.0 < up
    axes.annotate(
        name.upper(),
        tuple(place),
        (right, -12 if is_behind_rail else up),
        textcoords='offset points',
        ha=alignment,
        fontsize=8.0,
    )


def draw_lines_of_force(axes: Axes, geometry: Geometry, pose: Pose) -> None:
    """Draw the lines of both links, and the parallel to the rail through P; they meet at N = 0."""
    at = joints_in_mode(geometry, pose)
    direction = at['b1'] - at['a1']
    meeting = at['a1'] + pose.y / at['b1'][1] * direction
    end = meeting * MM
    style = {'linewidth': 1.0, 'linestyle': '--', 'zorder': 1}
    for name in ('a1', 'a2', 'p'):
        _draw_line(axes, at[name] * MM, end, GREEN, **style)
    axes.plot(*end, 'o', color=GREEN, markersize=5.0, zorder=3)
