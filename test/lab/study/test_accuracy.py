from dataclasses import replace

from mechanism import DESIGN
import numpy as np
import pytest

from facade_manipulator import kinematics
from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import Carriages, Geometry, Pose
from facade_manipulator.lab.study.accuracy import DriveTrain, worth, worth_rows

TRAIN = DriveTrain()


LONG = Geometry(link_errors=(1e-3, -2e-3), platform_errors=(2e-3, 0.0), rail_angle=0.02,
                tool=(0.01, 0.05, 0.1))


@pytest.mark.long
@pytest.mark.parametrize(('geometry', 'y', 'theta'), [
    (DESIGN, 0.1, 0.03), (DESIGN, 0.25, -0.1), (DESIGN, 0.3, 0.05), (LONG, 0.3, 0.05)])
def test_errors_are_those_of_many_machines(geometry, y, theta):
    random = np.random.default_rng(1)
    q = np.array(kinematics.mechanism_of(geometry).inverse_kinematics(Pose(0.0, y, theta)))
    heads = []
    for _ in range(2000):
        made = replace(geometry, **{
            name: tuple(getattr(geometry, name) + 1e-5 * random.standard_normal(2))
            for name in ('link_errors', 'platform_errors')})
        heads.append(kinematics.mechanism_of(made).forward_kinematics(
            Carriages(*(q + 1e-5 * random.standard_normal(3)).tolist())))
    found = worth(geometry, y, theta, DriveTrain(carriage_error=1e-5, length_error=1e-5)).errors
    assert found == pytest.approx(np.std(heads, axis=0), rel=0.08)


def test_the_pressing_force_is_that_of_the_weakest_carriage():
    assert worth(DESIGN, 0.06, 0.0, TRAIN).pressing == pytest.approx(20.4, abs=0.1)
    assert worth(DESIGN, 0.25, 0.0, TRAIN).pressing == pytest.approx(119.0, abs=0.1)


@pytest.mark.parametrize('theta', [0.0, 0.15])
def test_the_drives_allow_a_polygon_at_whose_edge_one_of_them_is_at_its_limit(theta):
    at = worth(DESIGN, 0.25, theta, TRAIN)
    rates = kinematics.jacobian(DESIGN, Pose(0.0, 0.25, theta))
    for allowed, demand, limit in (
            (at.speeds, rates[:, :2], TRAIN.speed),
            (at.forces, np.linalg.inv(rates).T[:, :2], TRAIN.force)):
        corners = np.array(allowed.corners)
        edges = 0.5 * (corners + np.roll(corners, 1, axis=0))
        ends = [*corners, *edges, (allowed.along_x, 0.0), (0.0, allowed.along_y)]
        assert np.abs(ends @ demand.T).max(axis=1) == pytest.approx(np.full(len(ends), limit))
        assert np.hypot(*edges.T).min() >= allowed.anywhere * (1.0 - 1e-9)
        turn = np.linspace(0.0, 2.0 * np.pi, 1000)
        around = allowed.anywhere * np.array([np.cos(turn), np.sin(turn)])
        assert np.abs(demand @ around).max() == pytest.approx(limit, rel=1e-4)


def test_what_cannot_be_reached_is_worth_nothing():
    with pytest.raises(LimitError):
        worth(DESIGN, 0.4, 0.0, TRAIN)
    assert [row.y for row in worth_rows(DESIGN, [0.2, 0.4], TRAIN)] == [0.2]
