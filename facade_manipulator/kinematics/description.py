"""
Description of the mechanism for other programs: joint points, joint tree and URDF.

A URDF has no closed loops, so the tree is cut where the two links meet the platform. `positions`
closes the loops there with the kinematics of the calibrated machine. The URDF is for display. It
contains no masses, and no limits of speed and effort, which are parameters of the driver.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import atan2
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from facade_manipulator.kinematics.geometry import AXIS_NAMES, Geometry, Pose
from facade_manipulator.kinematics.mechanism import Mechanism
from facade_manipulator.kinematics.planar import compose, ZERO_POSE


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
    """Joint of the tree: pose of its child in the parent frame, and motion axis."""

    name: str  #: '' for a fixed joint
    parent: str
    child: str
    axis: str = 'z'
    origin: Pose = ZERO_POSE


class Box(NamedTuple):
    """Visible box of a URDF link."""

    link: str
    size: tuple[float, float, float]  #: [m]
    middle: Pose  #: in the frame of the link
    colour: str


def joints(geometry: Geometry, pose: Pose) -> JointPoints:
    """
    Return the joints of the nominal mechanism at a pose [m, m, rad].

    Raises
    ------
    ParameterError, UnreachableError
        As `inverse_kinematics`.

    """
    return _joints(geometry.drawn, pose)


def _joints(mechanism: Mechanism, head: Pose) -> JointPoints:
    """Return the joints at a pose of the head [m, m, rad], with B1, B2 = P ∓ b (c, s)."""
    platform = mechanism.platform(head)
    q1, q2, q3 = mechanism.on_rail(mechanism.inverse_kinematics(head))
    _, _, half1, half2 = mechanism.sides
    b1 = compose(platform, Pose(-half1, 0.0, 0.0))
    b2 = compose(platform, Pose(half2, 0.0, 0.0))
    return JointPoints(
        a1=(q1, 0.0),
        a2=(q2, 0.0),
        a3=(q3, 0.0),
        b1=(b1.x, b1.y),
        b2=(b2.x, b2.y),
        p=(platform.x, platform.y),
    )


def tree(geometry: Geometry) -> tuple[TreeJoint, ...]:
    """Return the joints from the rail to the end effector and to both link ends."""
    along = Pose(0.0, 0.0, geometry.rail_angle)
    tool = Pose(*geometry.tool)
    return (
        TreeJoint('q1', 'rail', 'carriage_1', 'x', along),
        TreeJoint('q2', 'rail', 'carriage_2', 'x', along),
        TreeJoint('q3', 'rail', 'carriage_3', 'x', along),
        TreeJoint('guide', 'carriage_3', 'slider', 'y'),
        TreeJoint('turn', 'slider', 'platform', 'z'),
        TreeJoint('swing_1', 'carriage_1', 'link_1'),
        TreeJoint('swing_2', 'carriage_2', 'link_2'),
        TreeJoint('', 'platform', 'end_effector', 'z', tool),
    )


def positions(mechanism: Mechanism, head: Pose) -> tuple[float, ...]:
    """
    Return the positions [m or rad] of the moving joints of `tree` for a pose of the head.

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


COLOURS = {'dark': '0.35 0.35 0.35 1', 'grey': '0.6 0.6 0.6 1', 'blue': '0 0.45 0.7 1'}


def urdf(geometry: Geometry, prefix: str = '') -> str:
    """Return the URDF of a geometry; a prefix precedes the link names, as in TF."""
    robot = Element('robot', name='facade_manipulator')
    for name, colour in COLOURS.items():
        material = SubElement(robot, 'material', name=name)
        SubElement(material, 'color', rgba=colour)

    joints_of_tree = tree(geometry)
    names = ['rail', *(joint.child for joint in joints_of_tree)]
    links = {name: SubElement(robot, 'link', name=prefix + name) for name in names}
    for box in _boxes(geometry):
        _add_box(links[box.link], box)
    for joint in joints_of_tree:
        _add_joint(robot, joint, prefix, _range(geometry, joint))

    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode')


def _add_box(link: Element, box: Box) -> None:
    """Add a coloured box to the appearance of a link."""
    visual = SubElement(link, 'visual')
    _add_origin(visual, box.middle)
    shape = SubElement(visual, 'geometry')
    SubElement(shape, 'box', size=_text(box.size))
    SubElement(visual, 'material', name=box.colour)


AXIS_VECTORS = {'x': '1 0 0', 'y': '0 1 0', 'z': '0 0 1'}


def _add_joint(
    robot: Element, joint: TreeJoint, prefix: str, bounds: tuple[float, float] | None
) -> None:
    """Add a joint; add minimum and maximum position [m] if the joint is prismatic."""
    kind = 'fixed'
    if bounds:
        kind = 'prismatic'
    elif joint.name:
        kind = 'continuous'

    element = SubElement(robot, 'joint', name=joint.name or joint.child, type=kind)
    SubElement(element, 'parent', link=prefix + joint.parent)
    SubElement(element, 'child', link=prefix + joint.child)
    _add_origin(element, joint.origin)
    if joint.name:
        SubElement(element, 'axis', xyz=AXIS_VECTORS[joint.axis])
    if bounds:
        limit = SubElement(element, 'limit')
        limit.set('lower', repr(bounds[0]))
        limit.set('upper', repr(bounds[1]))
        # these attributes are required; 0 means that they are not given
        limit.set('effort', '0')
        limit.set('velocity', '0')


def _range(geometry: Geometry, joint: TreeJoint) -> tuple[float, float] | None:
    """Return the minimum and maximum position of a prismatic joint [m]."""
    if joint.name in AXIS_NAMES:
        number = AXIS_NAMES.index(joint.name)
        minimum, maximum = geometry.stroke
        offset = geometry.carriage_offsets[number]
        return minimum + offset, maximum + offset
    if joint.axis == 'y':
        reach = max(geometry.link_lengths) + max(geometry.half_lengths)
        return -reach, reach
    return None


# Sizes of the boxes in the picture [m]. A carriage is as long as the gap, so that two carriages
# touch at their minimum distance.
RAIL_DEPTH = 0.03
RAIL_HEIGHT = 0.02
CARRIAGE_DEPTH = 0.05
CARRIAGE_HEIGHT = 0.03
THINNEST_CARRIAGE = 0.004
LINK_WIDTH = 0.012
PLATFORM_WIDTH = 0.018
GUIDE_WIDTH = 0.006
HEAD_LENGTH = 0.06
HEAD_WIDTH = 0.012


def _boxes(geometry: Geometry) -> Iterator[Box]:
    """Yield all visible boxes."""
    minimum, maximum = geometry.stroke
    yield Box(
        'rail',
        (geometry.stroke_length, RAIL_DEPTH, RAIL_HEIGHT),
        Pose(0.5 * (minimum + maximum), 0.0, geometry.rail_angle),
        'dark',
    )

    for side, length in enumerate(geometry.link_lengths, start=1):
        size = (length, LINK_WIDTH, LINK_WIDTH)
        yield Box(f'link_{side}', size, Pose(0.5 * length, 0.0, 0.0), 'blue')

    width = max(geometry.carriage_gap, THINNEST_CARRIAGE)
    carriage = (width, CARRIAGE_DEPTH, CARRIAGE_HEIGHT)
    for number in (1, 2, 3):
        yield Box(f'carriage_{number}', carriage, ZERO_POSE, 'blue')

    length = geometry.link_length
    guide = (GUIDE_WIDTH, length, GUIDE_WIDTH)
    yield Box('carriage_3', guide, Pose(0.0, 0.5 * length, 0.0), 'grey')

    half1, half2 = geometry.half_lengths
    platform = (half1 + half2, PLATFORM_WIDTH, PLATFORM_WIDTH)
    yield Box('platform', platform, Pose(0.5 * (half2 - half1), 0.0, 0.0), 'blue')

    head = (HEAD_WIDTH, HEAD_LENGTH, HEAD_WIDTH)
    yield Box('end_effector', head, Pose(0.0, 0.5 * HEAD_LENGTH, 0.0), 'grey')


def _add_origin(element: Element, pose: Pose) -> None:
    place = _text((pose.x, pose.y, 0.0))
    turn = _text((0.0, 0.0, pose.theta))
    SubElement(element, 'origin', xyz=place, rpy=turn)


def _text(numbers: Sequence[float]) -> str:
    return ' '.join(map(repr, numbers))
