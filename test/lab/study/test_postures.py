from math import dist, radians

from mechanism import DESIGN, NO_GAP
import pytest

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import add, certify, Geometry, Pose, subtract
from facade_manipulator.lab.study.drawing import joints_in_mode
from facade_manipulator.lab.study.figures_postures import extremes, MODES

SHORT_STROKE = Geometry(0.352, 0.348, (-0.2, 0.3), 0.02)


def test_the_four_modes_have_one_platform_and_links_of_one_length():
    pose = Pose(0.05, 0.25, radians(8.0))
    at = [joints_in_mode(DESIGN, pose, mode) for mode in MODES]
    for joints in at:
        for side in '12':
            assert joints[f'b{side}'] == pytest.approx(at[0][f'b{side}'])
            assert joints[f'a{side}'][1] == 0.0
            assert dist(joints[f'a{side}'], joints[f'b{side}']) == pytest.approx(0.352)
    q1, q2 = [{round(joints[name][0], 6) for joints in at} for name in ('a1', 'a2')]
    assert len(q1) == len(q2) == 2 and max(q1) < 0.05 < min(q2)  # “+−” is the narrowest


@pytest.mark.parametrize('geometry', [DESIGN, NO_GAP, SHORT_STROKE])
def test_the_machine_can_stand_at_the_extremes_and_no_step_beyond_them(geometry):
    turned, far, aside = extremes(geometry)
    for pose, step in ((turned, Pose(0.0, 0.0, 1e-3)), (far, Pose(0.0, 1e-3, 0.0)),
                       (aside, Pose(1e-3, 0.0, 0.0))):
        certify(geometry, subtract(pose, step), min_conditioning=0.0)
        with pytest.raises(LimitError):
            certify(geometry, add(pose, step), min_conditioning=0.0)
