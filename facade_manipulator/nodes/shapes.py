"""The picture of the manipulator as plain shapes in frame `rail`: poses in, shapes out."""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import (
    compose,
    Geometry,
    joints,
    mechanism_of,
    Point,
    Pose,
    relative,
)

Colour = tuple[float, float, float, float]  # red, green, blue and opacity, 0 to 1

RAIL_DEPTH, RAIL_HEIGHT = 0.03, 0.02
CARRIAGE_DEPTH, CARRIAGE_HEIGHT = 0.05, 0.03
THINNEST_CARRIAGE = 0.004
LINK_WIDTH, PLATFORM_WIDTH, GUIDE_WIDTH = 0.012, 0.018, 0.006
HEAD_LENGTH, HEAD_WIDTH = 0.06, 0.012
CROSS_LENGTH, CROSS_WIDTH = 0.04, 0.004
WALL_LENGTH, WALL_DEPTH, WALL_HEIGHT = 4.0, 0.02, 0.3
TEXT_HEIGHT, TEXT_POSITION = 0.035, (0.0, -0.12)

# a colour-blind safe set (Okabe and Ito), the last number being the opacity
STATE_COLOURS = {
    'ok': (0.0, 0.45, 0.70, 1.0),
    'warn': (0.90, 0.62, 0.0, 1.0),
    'error': (0.84, 0.37, 0.0, 1.0),
    'stale': (0.6, 0.6, 0.6, 0.5),
}
RAIL_COLOUR = (0.35, 0.35, 0.35, 1.0)
GUIDE_COLOUR = (0.6, 0.6, 0.6, 1.0)
WALL_COLOUR = (0.75, 0.72, 0.65, 0.6)
GOAL_COLOUR = (0.0, 0.62, 0.45, 1.0)
CORRECTED_COLOUR = (0.80, 0.47, 0.65, 1.0)
TEXT_COLOUR = (0.9, 0.9, 0.9, 1.0)


class MechanismView(NamedTuple):
    """What is to be seen."""

    head: Pose | None = None  #: in frame `rail`; None when no pose has come lately
    corrected: Pose | None = None  #: the goal as the rail has to see it, in frame `rail`
    goal: Pose | None = None  #: on the wall, in frame `facade`
    disturbance: Pose = Pose(0.0, 0.0, 0.0)  #: pose of `rail` in `facade`
    wall: float = 0.3  #: its distance from the rail in still air [m]
    level: str = 'stale'  #: colour of the linkage: a key of `STATE_COLOURS`
    message: str = ''  #: what the drives are doing


class Shape(NamedTuple):
    """One thing to draw."""

    name: str  #: the same in every picture
    kind: str  #: ``'box'``, ``'lines'``, ``'arrow'`` or ``'text'``
    colour: Colour
    #: lengths of a box or an arrow; the width of lines and the height of a text first [m]
    size: tuple[float, float, float]
    #: middle of a box or a text, start of an arrow, which points along its own x
    pose: Pose = Pose(0.0, 0.0, 0.0)
    points: tuple[Point, ...] = ()  #: ends of lines, two each [m]
    text: str = ''


def shapes(geometry: Geometry, view: MechanismView) -> list[Shape]:
    """
    Return the picture of a view.

    Everything is given as seen from the rail: the wall and the goal on it move when the gondola
    does, the head should move with them.
    """
    picture = [_rail(geometry), _wall(view), _text(view)]
    for name, pose, colour in (
        ('goal', view.goal and relative(view.disturbance, view.goal), GOAL_COLOUR),
        ('corrected goal', view.corrected, CORRECTED_COLOUR),
    ):
        if pose is not None:
            picture.append(_cross(name, pose, colour))
    if view.head is not None:
        picture += _linkage(geometry, view.head, STATE_COLOURS[view.level])
    return picture


def _rail(geometry: Geometry) -> Shape:
    least, greatest = geometry.stroke
    middle = Pose(0.5 * (least + greatest), 0.0, 0.0)
    return Shape(
        'rail', 'box', RAIL_COLOUR, (geometry.stroke_length, RAIL_DEPTH, RAIL_HEIGHT), middle)


def _wall(view: MechanismView) -> Shape:
    face = Pose(0.0, view.wall + 0.5 * WALL_DEPTH, 0.0)
    return Shape('wall', 'box', WALL_COLOUR, (WALL_LENGTH, WALL_DEPTH, WALL_HEIGHT),
                 relative(view.disturbance, face))


def _text(view: MechanismView) -> Shape:
    return Shape('state', 'text', TEXT_COLOUR, (TEXT_HEIGHT,) * 3, Pose(*TEXT_POSITION, 0.0),
                 text=view.message or 'no diagnostics of the driver')


def _cross(name: str, pose: Pose, colour: Colour) -> Shape:
    ends = [compose(pose, Pose(x, y, 0.0)) for x, y in (
        (-CROSS_LENGTH, 0.0), (CROSS_LENGTH, 0.0), (0.0, -CROSS_LENGTH), (0.0, CROSS_LENGTH))]
    return Shape(name, 'lines', colour, (CROSS_WIDTH,) * 3,
                 points=tuple((end.x, end.y) for end in ends))


def _linkage(geometry: Geometry, head: Pose, colour: Colour) -> list[Shape]:
    """Return carriages as wide as their gap, so that they touch where they must stop."""
    try:
        at = joints(geometry, mechanism_of(geometry).platform(head))
    except ManipulatorError:
        return []  # whoever published that pose says why
    width = max(geometry.carriage_gap, THINNEST_CARRIAGE)
    carriages = [
        Shape(f'carriage {name}', 'box', colour, (width, CARRIAGE_DEPTH, CARRIAGE_HEIGHT),
              Pose(x, 0.0, 0.0))
        for name, (x, _) in (('q1', at.a1), ('q2', at.a2), ('q3', at.a3))
    ]
    return [
        *carriages,
        Shape('guide', 'lines', GUIDE_COLOUR, (GUIDE_WIDTH,) * 3, points=(at.a3, at.p)),
        Shape('links', 'lines', colour, (LINK_WIDTH,) * 3,
              points=(at.a1, at.b1, at.a2, at.b2)),
        Shape('platform', 'lines', colour, (PLATFORM_WIDTH,) * 3, points=(at.b1, at.b2)),
        Shape('end effector', 'arrow', colour, (HEAD_LENGTH, HEAD_WIDTH, HEAD_WIDTH),
              head._replace(theta=head.theta + 0.5 * math.pi)),
    ]
