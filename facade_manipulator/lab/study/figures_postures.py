"""Figures of the paper that show the mechanism itself: what moves it, its modes, its extremes."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from facade_manipulator.kinematics import Geometry, Pose, pose_map
from facade_manipulator.lab.study import drawing
from facade_manipulator.lab.study.drawing import draw_mechanism, MILLIMETRES, X_LABEL, Y_LABEL
from facade_manipulator.lab.study.reach import theta_limits
from facade_manipulator.lab.study.section import section_bounds
from facade_manipulator.lab.study.tables import lengths, Study

MODES = ('++', '-+', '+-', '--')  # in the order of the paper's Figure 5
GHOST = 0.3  # opacity of the postures behind the one that is named
INSIDE = 1.0 - 1e-9  # of the greatest turn: the limit itself may be out by rounding
PART = 0.6  # of the way to a limit, where Figure 3 shows a motion


def figure_3(study: Study) -> Figure:
    """Draw which motion of the carriages moves the head along x, along y and turns it."""
    made = drawing.figure(10.0, 3.0, f'Figure 3 b: what moves the head, {lengths(study.geometry)}')
    turned, far, aside = extremes(study.geometry)
    rest = Pose(0.0, turned.y, 0.0)
    reach = PART * float(np.nan_to_num(pose_map(study.geometry, rest.y, 0.0).upper[0]))
    for axes, title, moves in zip(made.subplots(1, 3), (
            'x: all carriages together', 'y: the outer ones apart or together',
            'θ: the outer ones the same way'), (
            [rest._replace(x=sign * reach) for sign in (-1.0, 1.0)],
            [rest._replace(y=(1.0 - PART) * rest.y + PART * y) for y in (aside.y, far.y)],
            [rest._replace(theta=sign * PART * turned.theta) for sign in (-1.0, 1.0)],
    ), strict=True):
        _draw_postures(axes, study.geometry, rest, *moves)
        drawing.label(axes, X_LABEL, Y_LABEL, title)
    return made


def figure_5(study: Study) -> Figure:
    """Draw the four working modes of one pose, with the room that each needs on the rail."""
    made = drawing.figure(
        10.0, 5.4, f'Figure 5: working modes of one pose, {lengths(study.geometry)}')
    turned, *_ = extremes(study.geometry)
    pose = Pose(0.0, turned.y, 0.5 * turned.theta)
    for axes, mode, letter in zip(made.subplots(2, 2).flat, MODES, 'abcd', strict=True):
        draw_mechanism(axes, study.geometry, pose, mode)
        at = drawing.joints_in_mode(study.geometry, pose, mode)
        room = MILLIMETRES * np.ptp([at[name][0] for name in ('a1', 'a2', 'a3')])
        drawing.label(axes, X_LABEL, Y_LABEL, f'{letter}) “{mode.replace("-", "−")}”: carriages '
                      f'on {room:.0f} mm')
    return made


def draw_extremes(grid: list[Axes], geometry: Geometry) -> None:
    """Draw how far the head turns and goes, in front of what is as far the other way."""
    turned, far, aside = extremes(geometry)
    for axes, title, pose, opposite in zip(grid, (
            f'a) θ = {np.degrees(turned.theta):.1f}° at y = {turned.y * MILLIMETRES:.0f} mm',
            f'b) y = {far.y * MILLIMETRES:.0f} mm',
            f'c) x = {aside.x * MILLIMETRES:.0f} mm at y = {aside.y * MILLIMETRES:.0f} mm'),
            (turned, far, aside),
            (turned._replace(theta=-turned.theta), far._replace(y=aside.y),
             aside._replace(x=-aside.x)), strict=True):
        _draw_postures(axes, geometry, pose, opposite)
        drawing.label(axes, X_LABEL, Y_LABEL, title)


def extremes(geometry: Geometry) -> tuple[Pose, Pose, Pose]:
    """Return the pose that turns most, and at θ = 0 those furthest out and furthest aside."""
    y = np.linspace(*section_bounds(geometry), 2001)[1:]
    turns = INSIDE * theta_limits(geometry, y)
    flat, turned = pose_map(geometry, y, 0.0), pose_map(geometry, y, turns)
    most = np.nanargmax(turns + 0.0 * turned.lower)
    last, widest = np.flatnonzero(~np.isnan(flat.lower))[-1], np.nanargmax(flat.upper)
    return (
        Pose(float(np.clip(0.0, turned.lower[most], turned.upper[most])), float(y[most]),
             float(turns[most])),
        Pose(float(np.clip(0.0, flat.lower[last], flat.upper[last])), float(y[last]), 0.0),
        Pose(float(flat.upper[widest]), float(y[widest]), 0.0))


def _draw_postures(axes: Axes, geometry: Geometry, pose: Pose, *others: Pose) -> None:
    for one in (*others, pose):
        draw_mechanism(axes, geometry, one, alpha=1.0 if one is pose else GHOST)
