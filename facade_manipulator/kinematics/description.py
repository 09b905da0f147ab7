"""
Description of the mechanism for other programs: joint points, a tree of joints, and its URDF.

A URDF has no closed loops, so the tree is cut where the two links meet the platform. `positions`
closes the loops there with the kinematics of the calibrated machine. The URDF is for display: it
has no masses, and no limits of speed and effort, which are parameters of the driver.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import atan2
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from facade_manipulator.kinematics.geometry import Carriages, Geometry, Pose
from facade_manipulator.kinematics.mechanism import Mechanism
from facade_manipulator.kinematics.planar import compose, ZERO_POSE

# Sizes of the boxes in the picture [m]. A carriage is as long as the gap, so that two carriages
# touch at their minimum distance.
RAIL_DEPTH, RAIL_HEIGHT = 0.03, 0.02
CARRIAGE_DEPTH, CARRIAGE_HEIGHT, THINNEST_CARRIAGE = 0.05, 0.03, 0.004
LINK_WIDTH, PLATFORM_WIDTH, GUIDE_WIDTH = 0.012, 0.018, 0.006
HEAD_LENGTH, HEAD_WIDTH = 0.06, 0.012
COLOURS = {'dark': '0.35 0.35 0.35 1', 'grey': '0.6 0.6 0.6 1', 'blue': '0 0.45 0.7 1'}
AXES = {'x': '1 0 0', 'y': '0 1 0', 'z': '0 0 1'}


class JointPoints(NamedTuple):
    """
    Positions of the joints in frame `rail`, each (x, y) [m].

    A1, A2 and A3 are on the carriages. The links connect A1 with B1 and A2 with B2. The
    end-effector point P is the middle of the platform between B1 and B2, and slides above A3.
    """

    a1: tuple[float, float]
    a2: tuple[float, float]
    a3: tuple[float, float]
    b1: tuple[float, float]
    b2: tuple[float, float]
    p: tuple[float, float]


class TreeJoint(NamedTuple):
    """Joint of the tree: the pose of its child in its parent, and the axis of its motion."""

    name: str  #: '' for a fixed joint
    parent: str
    child: str
    axis: str = 'z'
    origin: Pose = ZERO_POSE


def joints(geometry: Geometry, pose: Pose) -> JointPoints:
    """
    Return the joints of the drawing's mechanism at a pose [m, m, rad].

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    return _joints(geometry.drawn, pose)


def _joints(mechanism: Mechanism, head: Pose) -> JointPoints:
    """Return the joints at a pose of the head [m, m, rad]; B1, B2 = P ∓ b (c, s)."""
    platform = mechanism.platform(head)
    q1, q2, q3 = mechanism.on_rail(mechanism.inverse_kinematics(head))
    _, _, half1, half2 = mechanism.sides
    b1 = compose(platform, Pose(-half1, 0.0, 0.0))
    b2 = compose(platform, Pose(half2, 0.0, 0.0))
    return JointPoints(
        (q1, 0.0),
        (q2, 0.0),
        (q3, 0.0),
        (b1.x, b1.y),
        (b2.x, b2.y),
        (platform.x, platform.y),
    )


def tree(geometry: Geometry) -> tuple[TreeJoint, ...]:
    """Return the joints from the rail to the end effector and to the ends of the links."""
    along = Pose(0.0, 0.0, geometry.rail_angle)
    return (
        TreeJoint('q1', 'rail', 'carriage_1', 'x', along),
        TreeJoint('q2', 'rail', 'carriage_2', 'x', along),
        TreeJoint('q3', 'rail', 'carriage_3', 'x', along),
        TreeJoint('guide', 'carriage_3', 'slider', 'y'),
        TreeJoint('turn', 'slider', 'platform', 'z'),
        TreeJoint('swing_1', 'carriage_1', 'link_1'),
        TreeJoint('swing_2', 'carriage_2', 'link_2'),
        TreeJoint('', 'platform', 'end_effector', 'z', Pose(*geometry.tool)),
    )


def positions(mechanism: Mechanism, head: Pose) -> tuple[float, ...]:
    """
    Return the positions of the moving joints of `tree` at a pose of the head [m or rad].

    The positions of the carriages are those on the real rail, offsets included.

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    platform = mechanism.platform(head)
    a1, a2, a3, b1, b2, _ = _joints(mechanism, head)
    swing1 = atan2(b1[1], b1[0] - a1[0])
    swing2 = atan2(b2[1], b2[0] - a2[0])
    return (a1[0], a2[0], a3[0], platform.y, platform.theta, swing1, swing2)


def urdf(geometry: Geometry, prefix: str = '') -> str:
    """Return the URDF of a geometry; the prefix precedes the names of the links, as in TF."""
    robot = Element('robot', name='facade_manipulator')
    for name, colour in COLOURS.items():
        SubElement(SubElement(robot, 'material', name=name), 'color', rgba=colour)
    names = ['rail', *(joint.child for joint in tree(geometry))]
    links = {name: SubElement(robot, 'link', name=prefix + name) for name in names}
    for name, size, middle, colour in _boxes(geometry):
        visual = SubElement(links[name], 'visual')
        _origin(visual, middle)
        SubElement(SubElement(visual, 'geometry'), 'box', size=_text(size))
        SubElement(visual, 'material', name=colour)
    for joint in tree(geometry):
        _add_joint(robot, joint, prefix, _range(geometry, joint))
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')


def _add_joint(
    robot: Element, joint: TreeJoint, prefix: str, bounds: tuple[float, float] | None
) -> None:
    kind = 'prismatic' if bounds else 'continuous' if joint.name else 'fixed'
    element = SubElement(robot, 'joint', name=joint.name or joint.child, type=kind)
    SubElement(element, 'parent', link=prefix + joint.parent)
    SubElement(element, 'child', link=prefix + joint.child)
    _origin(element, joint.origin)
    if joint.name:
        SubElement(element, 'axis', xyz=AXES[joint.axis])
    if (
        bounds
    ):  # effort and velocity are required attributes; 0 means that they are not given
        lower, upper = map(repr, bounds)
        SubElement(element, 'limit', lower=lower, upper=upper, effort='0', velocity='0')


def _range(geometry: Geometry, joint: TreeJoint) -> tuple[float, float] | None:
    """Return the minimum and maximum position of a prismatic joint [m]."""
    if joint.name in Carriages._fields:
        ends = (
            Mechanism(geometry).on_rail(Carriages(q, q, q)) for q in geometry.stroke
        )
        lower, upper = (getattr(end, joint.name) for end in ends)
        return lower, upper
    reach = max(geometry.link_lengths) + max(geometry.half_lengths)
    return (-reach, reach) if joint.axis == 'y' else None


def _boxes(geometry: Geometry) -> Iterator[tuple[str, Sequence[float], Pose, str]]:
    """Yield the link, size [m], centre [m] and colour of each visible box."""
    minimum, maximum = geometry.stroke
    yield (
        'rail',
        (geometry.stroke_length, RAIL_DEPTH, RAIL_HEIGHT),
        Pose(0.5 * (minimum + maximum), 0.0, geometry.rail_angle),
        'dark',
    )
    width = max(geometry.carriage_gap, THINNEST_CARRIAGE)
    for side, length in enumerate(geometry.link_lengths, start=1):
        yield (
            f'link_{side}',
            (length, LINK_WIDTH, LINK_WIDTH),
            Pose(0.5 * length, 0.0, 0.0),
            'blue',
        )
    for number in (1, 2, 3):
        yield (
            f'carriage_{number}',
            (width, CARRIAGE_DEPTH, CARRIAGE_HEIGHT),
            ZERO_POSE,
            'blue',
        )
    yield (
        'carriage_3',
        (GUIDE_WIDTH, geometry.link_length, GUIDE_WIDTH),
        Pose(0.0, 0.5 * geometry.link_length, 0.0),
        'grey',
    )
    half_1, half_2 = geometry.half_lengths
    yield (
        'platform',
        (half_1 + half_2, PLATFORM_WIDTH, PLATFORM_WIDTH),
        Pose(0.5 * (half_2 - half_1), 0.0, 0.0),
        'blue',
    )
    yield (
        'end_effector',
        (HEAD_WIDTH, HEAD_LENGTH, HEAD_WIDTH),
        Pose(0.0, 0.5 * HEAD_LENGTH, 0.0),
        'grey',
    )


def _origin(element: Element, pose: Pose) -> None:
    SubElement(
        element,
        'origin',
        xyz=_text((*pose[:2], 0.0)),
        rpy=_text((0.0, 0.0, pose.theta)),
    )


def _text(numbers: Sequence[float]) -> str:
    return ' '.join(map(repr, numbers))
