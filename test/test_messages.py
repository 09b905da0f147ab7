"""Messages: planar poses, stamps, carriages and wrenches; invalid contents are rejected."""

import math

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, WrenchStamped
from geometry_msgs.msg import Pose as PoseMessage
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.conversions import pose_message, stamp
from facade_manipulator.nodes.messages import (
    carriages_from,
    planar_pose,
    planar_wrench,
    projected,
    require_frame,
    seconds,
    stamp_text,
)

lengths = st.floats(-10.0, 10.0)
angles = st.floats(-math.pi + 1e-9, math.pi)


@given(lengths, lengths, angles, st.sampled_from([1.0, -1.0]))
def test_pose_survives_the_way_through_a_message(x, y, theta, sign):
    """Both signs of a quaternion are one orientation."""
    message = pose_message(Pose(x, y, theta))
    q = message.orientation
    q.x, q.y, q.z, q.w = (sign * value for value in (q.x, q.y, q.z, q.w))
    back = planar_pose(message, 'goal')
    assert (back.x, back.y) == (x, y)
    assert math.remainder(back.theta - theta, math.tau) == pytest.approx(0.0, abs=1e-14)


@given(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1))
def test_stamp_survives_as_seconds_and_as_text(sec, nanosec):
    assert seconds(stamp(sec + nanosec * 1e-9)) == pytest.approx(sec + nanosec * 1e-9, abs=1e-6)
    whole, part = stamp_text(Time(sec=sec, nanosec=nanosec)).split('.')
    assert (int(whole), int(part), len(part)) == (sec, nanosec, 9)


@given(st.builds(Pose, lengths, lengths, angles), angles, st.floats(0.0, 0.2), lengths)
def test_tilted_pose_is_projected_into_the_plane(place, direction, tilt, height):
    """Turn a pose about z, then tilt it about an axis in the plane."""
    turn, half = (math.cos(place.theta / 2), math.sin(place.theta / 2)), math.sin(tilt / 2)
    ax, ay, w = half * math.cos(direction), half * math.sin(direction), math.cos(tilt / 2)
    found, out_of_plane = projected(
        PoseMessage(position=Point(x=place.x, y=place.y, z=height), orientation=Quaternion(
            x=ax * turn[0] + ay * turn[1], y=ay * turn[0] - ax * turn[1], z=w * turn[1],
            w=w * turn[0])), 'disturbance')
    assert found == pytest.approx(place, abs=1e-9)
    assert out_of_plane == pytest.approx((height, tilt), abs=1e-7)


@pytest.mark.parametrize('message, reason, expected', [
    (PoseMessage(position=Point(x=math.nan)), 'not_finite', 'goal x = nan'),
    (PoseMessage(position=Point(z=math.inf)), 'not_finite', 'goal z = inf'),
    (PoseMessage(orientation=Quaternion(w=math.nan)), 'not_finite', 'orientation.w = nan'),
    (PoseMessage(position=Point(z=0.01)), 'out_of_plane', 'z = 0.01 m'),
    (PoseMessage(orientation=Quaternion(x=0.1, w=math.sqrt(0.99))), 'out_of_plane', '0.2003 rad'),
    (PoseMessage(orientation=Quaternion(w=0.0)), 'quaternion', 'norm 0'),
    (PoseMessage(orientation=Quaternion(z=1.0, w=1.0)), 'quaternion', 'norm 1.41421')])
def test_pose_out_of_plane_is_rejected_with_its_value(message, reason, expected):
    with pytest.raises(InputError, match=expected) as rejection:
        planar_pose(message, 'goal')
    assert rejection.value.reason == reason


def test_other_frame_is_rejected_with_both_names():
    require_frame('rail', 'rail', 'goal')
    with pytest.raises(InputError, match="goal is in frame 'map', expected 'rail'"):
        require_frame('map', 'rail', 'goal')


@given(st.lists(st.text(max_size=50), max_size=20).map('\n'.join))
def test_long_foreign_text_is_shortened_in_a_rejection(text):
    for reject in (lambda: require_frame(f'{text}!', 'rail', 'goal'),
                   lambda: carriages_from([text] * 99, [0.0] * 99, 'p')):
        with pytest.raises(InputError) as rejection:
            reject()
        assert len(str(rejection.value)) < 350 and str(rejection.value).isprintable()


@given(st.permutations(['q1', 'q2', 'q3']))
def test_carriages_are_found_by_name_in_any_order(names):
    values = {'q1': -0.1, 'q2': 0.2, 'q3': 0.3}
    assert carriages_from(names, [values[name] for name in names], 'p') == (-0.1, 0.2, 0.3)


@pytest.mark.parametrize('names, values, message', [
    (['q1', 'q2'], [0.0, 0.0], r"names \['q1', 'q2'\], expected each of q1, q2, q3 once"),
    (['q1', 'q2', 'q2'], [0.0] * 3, r"names \['q1', 'q2', 'q2'\]"),
    ([], [], r'names \[\]'),
    (['q1', 'q2', 'q3'], [0.0, 0.0], '2 values for 3 names'),
    (['q1', 'q2', 'q3'], [0.0, math.nan, 0.0], 'of q2 = nan is not a finite number')])
def test_bad_carriage_names_and_values_are_rejected(names, values, message):
    with pytest.raises(InputError, match=message):
        carriages_from(names, values, 'setpoint position')


def test_wrench_out_of_the_plane_is_ignored():
    message = WrenchStamped()
    message.wrench.force.x, message.wrench.force.y, message.wrench.force.z = 1.0, 2.0, 9.0
    message.wrench.torque.x, message.wrench.torque.z = 9.0, 3.0
    assert planar_wrench(message) == (1.0, 2.0, 3.0)


def test_malformed_stamp_is_rejected():
    with pytest.raises(InputError, match='1000000000 ns, bound 1000000000 ns') as rejection:
        seconds(Time(sec=1, nanosec=10 ** 9))
    assert rejection.value.reason == 'malformed'
