from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.compensation.impedance import ImpedanceSettings
from facade_manipulator.compensation.suspension import ENVELOPE_TIME, LEAST_SHARE, SwayWatch
from facade_manipulator.kinematics import Pose

PRESS = ImpedanceSettings()


def noted(*places: Pose, interval: float = 0.01, in_contact: bool = False) -> SwayWatch:
    watch = SwayWatch()
    for place in places:
        watch.note(interval, place, in_contact)
    return watch


@given(st.floats(-0.2, 0.2), st.floats(-0.1, 0.1))
def test_the_envelope_holds_the_greatest_sway_of_either_sign(x, theta):
    watch = noted(Pose(x, 0.0, theta), Pose(0.0, 0.0, 0.0))
    assert watch.envelope.x == pytest.approx(abs(x), rel=0.01)
    assert watch.envelope.theta == pytest.approx(abs(theta), rel=0.01)
    watch.note(ENVELOPE_TIME, Pose(0.0, 0.0, 0.0), False)
    assert watch.envelope.x == pytest.approx(abs(x) / 2.718, rel=0.01)


@given(st.floats(0.001, 0.1))
def test_a_gondola_pushed_off_the_wall_is_further_off_than_before_the_touch(back):
    watch = noted(*[Pose(0.0, 0.0, 0.0)] * 10)
    for _ in range(100):
        watch.note(1.0, Pose(0.0, -back, 0.0), True)
    assert watch.push_back == pytest.approx(back, rel=0.01)
    for _ in range(100):
        watch.note(1.0, Pose(0.0, -back, 0.0), False)
    assert watch.push_back == pytest.approx(0.0, abs=1e-12)


@given(st.floats(0.0, 4.0), st.booleans())
def test_the_force_falls_from_the_bound_of_the_sway_to_twice_it(times, yaws):
    place = Pose(0.0, 0.0, times * PRESS.most_yaw) if yaws else Pose(
        times * PRESS.most_sway, 0.0, 0.0)
    share = noted(place).share(PRESS)
    assert share == pytest.approx(min(max(2.0 - times, LEAST_SHARE), 1.0), abs=1e-9)
