"""URDF of the mechanism, compared with the forward kinematics of an independent library."""

from functools import cache
import math
from xml.etree import ElementTree

from hypothesis import assume, given
from mechanism import DESIGN, passes, workspace_poses
import pytest

from facade_manipulator.kinematics import (
    Geometry,
    Mechanism,
    Pose,
    positions,
    tree,
    urdf,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.kinematics.planar import compose

urdf_reader = pytest.importorskip(
    'pytransform3d.urdf', reason='pytransform3d is not installed'
)
MADE = Geometry(  # measured instead of drawn values
    link_errors=(1e-3, -7e-4),
    platform_errors=(4e-4, -9e-4),
    carriage_offsets=(2e-3, -1e-3, 5e-4),
    rail_angle=0.01,
    tool=(0.01, 0.02, 0.05),
)
WITHIN = 1e-9  # m or rad, accuracy of an iterative solution


@cache
def loaded(geometry: Geometry):
    """Return the library's tree of the URDF."""
    manager = urdf_reader.UrdfTransformManager()
    manager.load_urdf(urdf(geometry, 'gondola_1/'))
    return manager


def read(geometry: Geometry, head: Pose):
    """Return the library's tree with its joints at a pose of the head."""
    # The library would clip joints outside the stroke.
    assume(passes(Mechanism(geometry).certify, head))
    manager = loaded(geometry)
    for joint, position in zip(
        (one for one in tree(geometry) if one.name),
        positions(Mechanism(geometry), head),
        strict=True,
    ):
        manager.set_joint(joint.name, position)
    return manager


def pose_of(matrix) -> Pose:
    yaw = math.atan2(matrix[1, 0], matrix[0, 0])
    return Pose(matrix[0, 3], matrix[1, 3], yaw)


@pytest.mark.parametrize('geometry', [DESIGN, MADE], ids=['drawn', 'made'])
@given(head=workspace_poses())
def test_urdf_has_a_head_and_closed_loops(geometry, head):
    manager = read(geometry, head)

    def on_rail(name):
        return pose_of(manager.get_transform(f'gondola_1/{name}', 'gondola_1/rail'))

    assert on_rail('end_effector') == pytest.approx(head, abs=WITHIN)
    platform = on_rail('platform')
    links = (on_rail('link_1'), on_rail('link_2'))
    for link, length, side, half in zip(
        links, geometry.link_lengths, (-1.0, 1.0), geometry.half_lengths, strict=True
    ):
        end_of_link = compose(link, Pose(length, 0.0, 0.0))
        joint = compose(platform, Pose(side * half, 0.0, 0.0))
        assert end_of_link[:2] == pytest.approx(joint[:2], abs=WITHIN)


@pytest.mark.parametrize('geometry', [DESIGN, MADE], ids=['drawn', 'made'])
def test_stroke_limits_and_boxes_have_the_lengths_of_parts(geometry):
    root = ElementTree.fromstring(urdf(geometry))
    for name, offset in zip(AXIS_NAMES, geometry.carriage_offsets, strict=True):
        limit = root.find(f"joint[@name='{name}']/limit")
        lower, upper = geometry.stroke
        assert float(limit.get('lower')) == lower + offset
        assert float(limit.get('upper')) == upper + offset
    half_1, half_2 = geometry.half_lengths
    length_1, length_2 = geometry.link_lengths
    # length of a carriage, which is the minimum distance of neighbours
    half = 0.5 * geometry.carriage_gap
    ends = {
        'rail': geometry.stroke,
        'platform': (-half_1, half_2),
        'link_1': (0.0, length_1),
        'link_2': (0.0, length_2),
    }
    for number in (1, 2, 3):
        ends[f'carriage_{number}'] = (-half, half)
    links = {link.get('name'): link for link in root.iter('link')}
    assert links.keys() == {*ends, 'slider', 'end_effector'}
    for name, expected in ends.items():
        box = links[name].find('visual/geometry/box')
        length = float(box.get('size').split()[0])
        origin = links[name].find('visual/origin')
        x, y, z = map(float, origin.get('xyz').split())
        turn = geometry.rail_angle if name == 'rail' else 0.0
        angles = [float(angle) for angle in origin.get('rpy').split()]
        assert angles == [0.0, 0.0, turn]
        assert (x - 0.5 * length, x + 0.5 * length) == pytest.approx(expected)
        assert y == 0.0
        assert z == 0.0
