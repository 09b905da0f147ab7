"""Misprints of the paper: each formula is true as corrected in docs/paper.md, not as printed."""

from math import cos, sin, sqrt

import numpy as np
import pytest

from facade_manipulator.kinematics import (
    Geometry,
    inverse_kinematics,
    local_conditioning_index,
    Pose,
)

# in the order of docs/paper.md
MISPRINTS = (
    'v',
    'twice',
    'over',
    'q3',
    'A10',
    'A8',
    'A9',
)
POSES = (Pose(0.1, 0.25, 0.15), Pose(-0.2, 0.15, -0.1))


def test_equation_11_is_correct_with_the_velocity_of_q2():
    geometry = Geometry()
    y = 0.25
    theta = 0.1
    b = 0.348
    step = 1e-6
    before = inverse_kinematics(geometry, Pose(0.0, y, theta - step))
    _, q2, q3 = inverse_kinematics(geometry, Pose(0.0, y, theta))
    after = inverse_kinematics(geometry, Pose(0.0, y, theta + step))
    # of the carriages for one rad/s
    rate1, rate2, rate3 = np.subtract(after, before) / (2 * step)
    factor = 2 * b * cos(theta) - 2 * q2 + 2 * q3
    right_of_y = 2 * b * y * cos(theta)
    right = 2 * b * sin(theta) * (q2 - q3) + right_of_y
    assert factor * (rate2 - rate3) == pytest.approx(right, abs=1e-9)
    assert abs(factor * (rate1 - rate3) - right) > 0.02  # m² rad/s, as printed


@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize('misprint', ['', *MISPRINTS])
def test_appendix_index_is_correct_only_as_corrected(pose, misprint):
    error = abs(
        index(pose, misprint) / local_conditioning_index(Geometry(), pose) - 1.0
    )
    assert error > 1e-4 if misprint else error < 1e-12


def index(
    pose: Pose, printed: str = '', length: float = 0.352, b: float = 0.348
) -> float:
    """Return the inverse condition number of the appendix, with one formula as printed."""
    _, y, theta = pose
    s = sin(theta)
    c = cos(theta)
    q1, q2, q3 = inverse_kinematics(Geometry(length, b), pose)
    a1 = b * q3 * s
    a2 = b * q2 * s
    a3 = b * q1 * s
    a4 = b * y * c
    a5 = q3 * s
    a6 = y * c
    a7 = b * s
    power = {name: s if name == printed else s * s for name in ('A8', 'A9')}
    n = 2 * y * y * c + (q1 + q2 - 2 * q3) * y * s
    first = b * b * (q1 - q2) * power['A8']
    a8 = 3 * (first + b * n) ** 2
    a9 = 3 * (n + b * (q1 - q2) * power['A9']) ** 2
    a10 = (q3 - q2 + b * c) ** 2
    a11 = (q1 - q3 + b * c) ** 2
    v = 0.0 if printed == 'v' else 1.0
    of_y = (y + a7) ** 2 / (3 * a10) + (y - v * a7) ** 2 / (3 * a11)
    of_q1 = (a4 + a3 - a1) ** 2 / (3 * a11)
    of_q2 = (a4 + (a3 if printed == 'twice' else a2) - a1) ** 2 / (3 * a10)
    norm = of_y + of_q1 + of_q2 + 1

    square_of_q3 = 2 * q3 * q3 * s * (s if printed == 'q3' else 1.0)
    with_y = (q1 + q2 - 2 * q3) * y * c
    products = 2 * (q1 * q2 - q1 * q3 - q2 * q3) * s
    bracket = (square_of_q3 + with_y + products + b * (q2 - q1) * c * s) ** 2

    first = bracket + 1.0 if printed == 'over' else bracket / a9
    sum_2 = q1 * y - q2 * y + 2 * b * y * c + a3 + a2 - 2 * b * q3 * s
    term_3 = (a10 if printed == 'A10' else a11) * (a6 + q2 * s - a5) ** 2 / a9
    term_4 = a10 * (a6 + q1 * s - a5) ** 2 / a9
    term_5 = a11 * (y + a7) ** 2 / a8
    term_6 = a10 * (y - a7) ** 2 / a8
    inverse = first + sum_2**2 / a8 + term_3 + term_4 + term_5 + term_6 + 1 / 3
    return 1 / sqrt(norm * inverse)
