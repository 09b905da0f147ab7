"""The twist of the rail: its velocity along the axes of the rail, with covariance."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.estimation.estimator import RailMotion
from facade_manipulator.kinematics import Pose, Twist

vectors = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3)


@given(vectors, vectors, st.lists(vectors, min_size=3, max_size=3).map(np.array))
def test_twist_is_the_velocity_turned_by_the_yaw(pose, velocity, root):
    motion = RailMotion(1.0, Pose(*pose), Twist(*velocity), np.zeros((3, 3)), root @ root.T)
    twist, covariance = motion.twist()
    turned = complex(twist.x, twist.y) * np.exp(1j * pose[2])
    assert turned == pytest.approx(complex(velocity[0], velocity[1]), abs=1e-9)
    assert twist.theta == pytest.approx(velocity[2])
    assert np.trace(covariance) == pytest.approx(np.trace(root @ root.T), abs=1e-9)
    assert covariance[2, 2] == pytest.approx((root @ root.T)[2, 2], abs=1e-9)
    assert covariance == pytest.approx(covariance.T, abs=1e-9)
