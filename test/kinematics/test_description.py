"""The URDF is the mechanism: an independent library's forward kinematics of it is ours."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from hypothesis import given, reject
from mechanism import DESIGN, workspace_poses
import pytest

from facade_manipulator.errors import LimitError, UnreachableError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose, positions, tree, urdf
from facade_manipulator.kinematics.planar import compose

urdf_reader = pytest.importorskip('pytransform3d.urdf', reason='pytransform3d is not installed')
MADE = Geometry(  # measured, not drawn
    link_errors=(1e-3, -7e-4), platform_errors=(4e-4, -9e-4), carriage_offsets=(2e-3, -1e-3, 5e-4),
    rail_angle=0.01, slide_angle=-0.01, tool=(0.01, 0.02, 0.05), screw_errors_q1=(0.0, 4e-4))
WITHIN = 1e-9  # m or rad, of what an iteration solves


def read(geometry: Geometry, head: Pose):
    """Return the library's tree of the URDF, with its joints where the head is at a pose."""
    try:
        mechanism_of(geometry).certify(head)
    except LimitError:  # of a stroke that is elsewhere: the library would clip the joints
        reject()
    manager = urdf_reader.UrdfTransformManager()
    manager.load_urdf(urdf(geometry, 'gondola_1/'))
    for joint, position in zip(
            (one for one in tree(geometry) if one.name),
            positions(mechanism_of(geometry), head), strict=True):
        manager.set_joint(joint.name, position)
    return manager


def pose_of(matrix) -> Pose:
    return Pose(matrix[0, 3], matrix[1, 3], math.atan2(matrix[1, 0], matrix[0, 0]))


@pytest.mark.parametrize('geometry', [DESIGN, MADE], ids=['drawn', 'made'])
@given(head=workspace_poses())
def test_the_end_effector_is_where_the_head_is_and_the_loops_are_closed(geometry, head):
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


def test_carriages_move_within_their_stroke_and_no_other_link_has_the_frames_of_the_wall():
    root = ElementTree.fromstring(urdf(DESIGN))
    bounds = {joint.get('name'): joint.find('limit') for joint in root.iter('joint')}
    for name in ('q1', 'q2', 'q3'):
        assert [float(bounds[name].get(end)) for end in ('lower', 'upper')] == [*DESIGN.stroke]
    assert {link.get('name') for link in root.iter('link')} == {
        'rail', 'carriage_1', 'carriage_2', 'carriage_3', 'slider', 'platform', 'link_1',
        'link_2', 'end_effector'}


@pytest.mark.parametrize('geometry', [DESIGN, MADE], ids=['drawn', 'made'])
def test_what_is_seen_of_a_part_is_as_long_as_it_and_lies_on_it(geometry):
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


def test_a_head_out_of_reach_has_no_joints():
    with pytest.raises(UnreachableError):
        positions(mechanism_of(DESIGN), Pose(0.0, 0.5, 0.0))
