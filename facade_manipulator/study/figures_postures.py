"""Figures of the mechanism in the paper: motions, modes, extremes and compensation."""

from __future__ import annotations

from math import degrees, radians

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator import kinematics
from facade_manipulator.errors import LimitError, ParameterError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.kinematics.maps import pose_map
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.study import drawing
from facade_manipulator.study.drawing import draw_mechanism, GHOST, plan_view
from facade_manipulator.study.paper_tables import Study
from facade_manipulator.study.workspace_metrics import (
    require_section,
    section_bounds,
    theta_peak,
)

PART = 0.6  # share of the distance to a limit at which Figure 3 shows a motion


def figure_3(study: Study) -> Figure:
    """Draw the carriage motions that move the head along x and y and rotate it."""
    made = drawing.figure(10.0, 2.5, study.title('Figure 3 b: motions of the head'))
    turned, far, aside = extremes(study.geometry)
    rest = Pose(0.0, turned.y, 0.0)
    reach = PART * float(np.nan_to_num(pose_map(study.geometry, rest.y, 0.0).upper[0]))
    turn = PART * turned.theta
    along = [rest._replace(x=-reach), rest._replace(x=reach)]
    across = []
    for y in (aside.y, far.y):
        across.append(rest._replace(y=(1.0 - PART) * rest.y + PART * y))
    about = [rest._replace(theta=-turn), rest._replace(theta=turn)]

    grid = made.subplots(1, 3, sharey=True)
    motions = (
        ('along x: all carriages move together', along, False),
        ('along y: A1 and A2 move apart or together', across, False),
        ('about z: A1 and A2 move the same way', about, True),
    )
    for axes, (title, moves, has_names) in zip(grid, motions, strict=True):
        _draw_postures(axes, study.geometry, rest, *moves, has_names=has_names)
        plan_view(axes, 680.0, (-190.0, 370.0), title)
        axes.label_outer()
    return made


MODES = ('++', '-+', '+-', '--')  # in the order of Figure 5


def figure_5(study: Study) -> Figure:
    """Draw the working modes for one pose, with the rail length that each mode needs."""
    made = drawing.figure(10.0, 4.6, study.title('Figure 5: working modes'))
    turned, *_ = extremes(study.geometry)
    pose = Pose(0.0, turned.y, 0.5 * turned.theta)
    grid = made.subplots(2, 2, sharex=True, sharey=True)
    for axes, mode, letter in zip(grid.flat, MODES, 'abcd', strict=True):
        draw_mechanism(axes, study.geometry, pose, mode, has_names=True)
        at = drawing.joints_in_mode(study.geometry, pose, mode)
        room = MM * np.ptp([at[name][0] for name in ('a1', 'a2', 'a3')])
        signs = mode.replace('-', '−')
        title = f'{letter}) “{signs}”: the carriages take {room:.0f} mm of the rail'
        plan_view(axes, 750.0, (-160.0, 370.0), title)
        axes.label_outer()
    return made


SWAY = {  # poses of the rail in Figure 12 [m, m, rad]
    'gondola to the left': Pose(-0.12, 0.02, radians(2.0)),
    'gondola in its place': kinematics.ZERO_POSE,
    'gondola to the right': Pose(0.12, -0.02, radians(-2.0)),
}
HOME_POSITIONS = kinematics.Carriages(-0.1, 0.1, 0.0)  # m: Table 4, corrected
HEAD_TO_WALL = 40.0  # mm, as drawn


def figure_12(study: Study) -> Figure:
    """Draw the compensation: the head remains in place on the wall while the rail moves."""
    title = 'Figures 2 and 12: with and without (pale) compensation'
    made = drawing.figure(10.0, 2.6, title)
    home = _swaying_home(study.geometry)
    wall = home.y * MM + HEAD_TO_WALL
    grid = made.subplots(1, 3, sharey=True)
    for axes, (title, rail) in zip(grid, SWAY.items(), strict=True):
        draw_mechanism(axes, study.geometry, home, alpha=GHOST, rail=rail)
        draw_mechanism(axes, study.geometry, kinematics.relative(rail, home), rail=rail)
        axes.axhspan(wall, wall + 60.0, color=drawing.GREY, linewidth=0.0)
        axes.axvline(0.0, color=drawing.GREEN, linewidth=1.0, linestyle='--', zorder=1)
        lost = kinematics.compose(rail, home)
        title += (
            f'\nwithout: x {lost.x * 1e3:+.0f} mm, y {(lost.y - home.y) * 1e3:+.0f} mm, '
            f'θ {degrees(lost.theta):+.0f}°'
        )
        plan_view(axes, 680.0, (-90.0, 350.0), title)
        drawing.label(axes, 'x along the wall [mm]', 'y towards the wall [mm]', title)
        axes.label_outer()
    return made


def _swaying_home(geometry: Geometry) -> Pose:
    """Return the home pose of the head; raise a ParameterError if it cannot be compensated."""
    try:
        home = kinematics.forward_kinematics(geometry, HOME_POSITIONS)
        for rail in SWAY.values():
            kinematics.joints(geometry, kinematics.relative(rail, home))
    except LimitError as error:
        places = ', '.join(f'{place:g}' for place in HOME_POSITIONS)
        raise ParameterError(
            f'the home positions {places} m are not within the reach of this design while the '
            f'gondola sways: {error.problem}; next: choose other lengths for this figure'
        ) from error
    return home


def draw_extremes(grid: list[Axes], geometry: Geometry) -> None:
    """Draw the head at maximum rotation and displacements, in front of the opposite extremes."""
    turned, far, aside = extremes(geometry)
    angle = degrees(turned.theta)
    panels = (
        (
            f'a) θ = {angle:.1f}° at y = {turned.y * MM:.0f} mm',
            turned,
            turned._replace(theta=-turned.theta),
        ),
        (
            f'b) y = {far.y * MM:.0f} mm',
            far,
            far._replace(y=aside.y),
        ),
        (
            f'c) x = {aside.x * MM:.0f} mm at y = {aside.y * MM:.0f} mm',
            aside,
            aside._replace(x=-aside.x),
        ),
    )
    for axes, (title, pose, opposite) in zip(grid, panels, strict=True):
        _draw_postures(axes, geometry, pose, opposite, has_names=True)
        plan_view(axes, 980.0, (-310.0, 500.0), title)


INSIDE_LIMIT = 1.0 - 1e-9  # share of a limit: rounding may put the limit itself outside


def extremes(geometry: Geometry) -> tuple[Pose, Pose, Pose]:
    """
    Return three extreme head poses [m, m, rad], inside the workspace by `INSIDE`.

    These poses have the maximum θ, the maximum y at θ = 0, and the maximum x at θ = 0, which is at
    the minimum y. The first two have the x that is the nearest to 0. Raises a ParameterError if
    no pose is reachable at θ = 0.
    """
    require_section(geometry)
    y_turned, theta_max = theta_peak(geometry)
    lower, upper = section_bounds(geometry)
    theta = theta_max * INSIDE_LIMIT
    turned = Pose(_nearest_x(geometry, y_turned, theta), y_turned, theta)
    far_y = upper * INSIDE_LIMIT
    far = Pose(_nearest_x(geometry, far_y, 0.0), far_y, 0.0)
    # at θ = 0 the links, and with them the interval of x, are widest at the least y
    near_y = lower / INSIDE_LIMIT
    aside = Pose(float(pose_map(geometry, near_y, 0.0).upper[0]), near_y, 0.0)
    return turned, far, aside


def _nearest_x(geometry: Geometry, y: float, theta: float) -> float:
    """Return the reachable x nearest to 0 [m]."""
    at = pose_map(geometry, y, theta)
    return float(np.clip(0.0, at.lower[0], at.upper[0]))


def _draw_postures(
    axes: Axes, geometry: Geometry, pose: Pose, *others: Pose, has_names: bool
) -> None:
    for other in others:
        draw_mechanism(axes, geometry, other, alpha=GHOST)
    draw_mechanism(axes, geometry, pose, has_names=has_names)
