"""Limits that hold axes of the head back."""

from facade_manipulator.compensation import held_back as module
from facade_manipulator.compensation.held_back import HeldBack
from facade_manipulator.kinematics import Pose, ZERO_POSE


def test_held_axes_are_reported_for_one_second():
    held = HeldBack()
    least = module.HeldBack.LEAST_ERROR
    second = module.HeldBack.SHOWN_FOR
    assert held.message(0.0) == ''
    saturation_error = Pose(-2.0 * least, 0.9 * least, 0.01)
    held.note(10.0, saturation_error, Pose(0.0, 1.0, 0.0))
    assert held.message(10.0 + 0.9 * second) == (
        'held back in x, theta at the workspace limit; held back in y by an uncertain estimate; '
        'next: choose a goal nearer to the middle of the workspace, then check the sensor'
    )
    held.note(11.0, ZERO_POSE, Pose(0.0, 0.0, 0.1))
    assert held.message(10.1 + second) == (
        'held back in theta by an uncertain estimate; next: check the sensor'
    )
    assert held.message(1.0) == held.message(11.0) == ''  # the clock was set back
