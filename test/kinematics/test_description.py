"""The URDF is the mechanism: an independent library's forward kinematics of it is ours."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from hypothesis import given, reject
from mechanism import DESIGN, workspace_poses
import pytest

from facade_manipulator.errors import LimitError, UnreachableError
from facade_manipulator.kinematics import Geometry, Mechanism, Pose, positions, tree, urdf
from facade_manipulator.kinematics.planar import compose

urdf_reader = pytest.importorskip('pytransform3d.urdf', reason='pytransform3d is not installed')
MADE = Geometry(  # measured, not drawn
    link_errors=(1e-3, -7e-4), platform_errors=(4e-4, -9e-4), carriage_offsets=(2e-3, -1e-3, 5e-4),
    rail_angle=0.01, tool=(0.01, 0.02, 0.05))
WITHIN = 1e-9  # m or rad, accuracy of an iterative solution


def read(geometry: Geometry, head: Pose):
    """Return the library's tree of the URDF, with its joints where the head is at a pose."""
    try:
        Mechanism(geometry).certify(head)
    except LimitError:  # of a stroke that is elsewhere: the library would clip the joints
        reject()
    manager = urdf_reader.UrdfTransformManager()
    manager.load_urdf(urdf(geometry, 'gondola_1/'))
    for joint, position in zip(
            (one for one in tree(geometry) if one.name),
            positions(Mechanism(geometry), head), strict=True):
        manager.set_joint(joint.name, position)
    return manager


def pose_of(matrix) -> Pose:
    return Pose(matrix[0, 3], matrix[1, 3], math.atan2(matrix[1, 0], matrix[0, 0]))


@pytest.mark.parametrize('geometry', [DESIGN, MADE], ids=['drawn', 'made'])
@given(head=workspace_poses())
def test_urdf_has_the_head_and_closed_loops(geometry, head):
    manager = read(geometry, head)
    found = pose_of(manager.get_transform('gondola_1/end_effector', 'gondola_1/rail'))
    assert found == pytest.approx(head, abs=WITHIN)
    for number, length, half in zip(
            (1, 2), geometry.link_lengths, (-geometry.half_lengths[0], geometry.half_lengths[1]),
            strict=True):
        link = pose_of(manager.get_transform(f'gondola_1/link_{number}', 'gondola_1/rail'))
        platform = pose_of(manager.get_transform('gondola_1/platform', 'gondola_1/rail'))
        assert compose(link, Pose(length, 0.0, 0.0))[:2] == pytest.approx(
            compose(platform, Pose(half, 0.0, 0.0))[:2], abs=WITHIN)


def test_urdf_has_the_stroke_and_nine_links():
    root = ElementTree.fromstring(urdf(DESIGN))
    bounds = {joint.get('name'): joint.find('limit') for joint in root.iter('joint')}
    for name in ('q1', 'q2', 'q3'):
        assert [float(bounds[name].get(end)) for end in ('lower', 'upper')] == [*DESIGN.stroke]
    assert {link.get('name') for link in root.iter('link')} == {
        'rail', 'carriage_1', 'carriage_2', 'carriage_3', 'slider', 'platform', 'link_1',
        'link_2', 'end_effector'}


@pytest.mark.parametrize('geometry', [DESIGN, MADE], ids=['drawn', 'made'])
def test_boxes_have_the_lengths_of_their_parts(geometry):
    half_1, half_2 = geometry.half_lengths
    half = 0.5 * geometry.carriage_gap  # of a carriage: they touch where they must stop
    ends = {'rail': geometry.stroke, 'platform': (-half_1, half_2),
            **{f'link_{n}': (0.0, geometry.link_lengths[n - 1]) for n in (1, 2)},
            **{f'carriage_{n}': (-half, half) for n in (1, 2, 3)}}
    for link in ElementTree.fromstring(urdf(geometry)).iter('link'):
        if link.get('name') in ends:
            length = float(link.find('visual/geometry/box').get('size').split()[0])
            origin = link.find('visual/origin')
            x, y, z = map(float, origin.get('xyz').split())
            turn = geometry.rail_angle if link.get('name') == 'rail' else 0.0
            assert [*map(float, origin.get('rpy').split())] == [0.0, 0.0, turn]
            assert (x - 0.5 * length, x + 0.5 * length) == pytest.approx(ends[link.get('name')])
            assert (y, z) == (0.0, 0.0)


def test_head_out_of_reach_has_no_joints():
    with pytest.raises(UnreachableError):
        positions(Mechanism(DESIGN), Pose(0.0, 0.5, 0.0))
