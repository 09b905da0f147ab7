import math

from mechanism import NO_GAP
import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.study.gcw import count_poses, Grid, grid_y, PoseCount, table2
from facade_manipulator.lab.study.volume import measure

COARSE = Grid(0.01, 0.004, 0.03)
ROUNDING = 1e-12  # m


def brute_force(geometry, grid, threshold, characteristic_length):
    """Count every grid pose on its own, by eqs 7-8, 18, 19 and the Jacobian's own norms."""
    length, half = geometry.link_length, geometry.platform_half_length
    steps = int(0.5 * math.pi / grid.theta)
    x, y, theta = np.meshgrid(
        np.arange(-120, 121) * grid.x, grid_y(geometry, grid),
        np.arange(-steps, steps + 1) * grid.theta, indexing='ij')
    rise, span = half * np.sin(theta), half * np.cos(theta)
    u1, u2 = y - rise, y + rise
    with np.errstate(all='ignore'):
        s1, s2 = np.sqrt(length ** 2 - u1 * u1), np.sqrt(length ** 2 - u2 * u2)
        q1, q2 = x - span + s1, x + span - s2
        least, greatest = geometry.stroke[0] - ROUNDING, geometry.stroke[1] + ROUNDING
        reachable = (s1 > 0) & (s2 > 0) & (q1 >= least) & (q2 <= greatest)
        for distance in (span - s1, span - s2):
            reachable &= (distance > 0) & (distance >= geometry.carriage_gap)
        y1, t1 = -u1 / s1, (u1 * span + s1 * rise) / s1 / characteristic_length
        y2, t2 = u2 / s2, (u2 * span - s2 * rise) / s2 / characteristic_length
        determinant = y1 * t2 - y2 * t1
        forward = 3 + y1 ** 2 + y2 ** 2 + t1 ** 2 + t2 ** 2
        backward = 1 + (y1 ** 2 + y2 ** 2 + t1 ** 2 + t2 ** 2 + (y1 - y2) ** 2
                        + (t1 - t2) ** 2) / determinant ** 2
        good = 3 / np.sqrt(forward * backward) >= threshold
        beyond = determinant >= 0.0  # det J = −b N/(s1 s2)
    return PoseCount(int(reachable.sum()), int((reachable & good).sum()),
                     int((reachable & beyond).sum()))


@pytest.mark.long
@pytest.mark.parametrize('geometry', [
    NO_GAP, Geometry(0.25, 0.45, (-0.5, 0.6), 0.01), Geometry(0.34, 0.36, carriage_gap=0.0),
    Geometry(0.15, 0.55, (-0.5, 0.5), 0.0), Geometry(0.4, 0.3, (-0.21, 0.5), 0.03)])
@pytest.mark.parametrize(('threshold', 'length'), [(0.001, 0.001), (0.2, 1.0)])
def test_counts_are_those_of_brute_force_to_the_last_pose(geometry, threshold, length):
    count = count_poses(geometry, COARSE, threshold, length)
    assert count == brute_force(geometry, COARSE, threshold, length)
    assert count.total > 0


def test_an_empty_workspace_counts_nothing():
    count = count_poses(Geometry(0.15, 0.55, (-0.3, 0.3), 0.0), COARSE)
    assert count == PoseCount(0, 0, 0)
    assert math.isnan(count.ratio)


def test_a_characteristic_length_is_checked():
    with pytest.raises(ParameterError):
        count_poses(NO_GAP, COARSE, 0.1, 0.0)


def test_with_a_stroke_of_one_metre_the_ratios_move_by_a_thousandth_at_most():
    for row in table2(1.0):
        assert row['ratio'] == pytest.approx(row['paper']['ratio'], abs=0.0011)


def test_counts_approach_the_integrals():
    geometry = Geometry(0.3, 0.4, (-0.4, 0.4), 0.01)
    count = count_poses(geometry, Grid(0.002, 0.001, math.radians(0.25)))
    of = measure(geometry, 0.001, 0.001, 512, 256)
    assert count.ratio == pytest.approx(of.ratio, abs=1e-3)
    assert count.beyond / count.total == pytest.approx(of.beyond_share, abs=4e-3)
    cell = 0.002 * 0.001 * math.radians(0.25)
    assert count.total * cell == pytest.approx(of.volume, rel=5e-3)
