import math

from geometry_msgs.msg import Point, Quaternion
from geometry_msgs.msg import Pose as PoseMessage
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, Wrench
from facade_manipulator.messages import (
    carriages_from,
    planar_pose,
    planar_wrench,
    projected,
    require_frame,
    seconds,
)
from facade_manipulator.ros.conversions import pose_message, pose_stamped, stamp, wrench_stamped
from facade_manipulator.ros.diagnostics import diagnostic_status

lengths = st.floats(-10.0, 10.0)
angles = st.floats(-math.pi + 1e-9, math.pi)


@given(lengths, lengths, angles)
def test_a_pose_survives_the_way_through_a_message(x, y, theta):
    back = planar_pose(pose_message(Pose(x, y, theta)), 'goal')
    assert (back.x, back.y) == (x, y)
    assert math.remainder(back.theta - theta, math.tau) == pytest.approx(0.0, abs=1e-14)


@given(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1))
def test_a_stamp_survives_as_seconds_to_a_microsecond(sec, nanosec):
    time = sec + nanosec * 1e-9
    assert seconds(stamp(time)) == pytest.approx(time, abs=1e-6)


def test_the_two_signs_of_a_quaternion_are_the_same_pose():
    message = pose_message(Pose(0.1, 0.2, 0.3))
    q = message.orientation
    message.orientation = Quaternion(x=-q.x, y=-q.y, z=-q.z, w=-q.w)
    assert planar_pose(message, 'goal').theta == pytest.approx(0.3)


@given(st.builds(Pose, lengths, lengths, angles), angles, st.floats(0.0, 0.2), lengths)
def test_a_tilted_pose_is_seen_as_the_nearest_in_the_plane(place, direction, tilt, height):
    numbers = tilted(place, direction, tilt, height)
    found, out_of_plane = projected(numbers, 'disturbance')
    assert found == pytest.approx(place, abs=1e-9)
    assert out_of_plane == pytest.approx((height, tilt), abs=1e-7)
    x, y, z, w = numbers[3:]
    turn = math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))  # of the x axis
    assert abs(math.remainder(turn - place.theta, math.tau)) <= 0.5 * tilt ** 2 + 1e-9


def tilted(place, direction, tilt, height):
    """Return the numbers of a pose turned about z, then tilted about an axis in the plane."""
    turn, half = (math.cos(place.theta / 2), math.sin(place.theta / 2)), math.sin(tilt / 2)
    ax, ay, w = half * math.cos(direction), half * math.sin(direction), math.cos(tilt / 2)
    return (place.x, place.y, height, ax * turn[0] + ay * turn[1], ay * turn[0] - ax * turn[1],
            w * turn[1], w * turn[0])


@pytest.mark.parametrize('message, reason, expected', [
    (PoseMessage(position=Point(x=math.nan)), 'not_finite', 'goal x = nan'),
    (PoseMessage(position=Point(y=math.inf)), 'not_finite', 'goal y = inf'),
    (PoseMessage(position=Point(z=math.nan)), 'not_finite', 'goal z = nan'),
    (PoseMessage(orientation=Quaternion(w=math.nan)), 'not_finite', 'orientation.w = nan'),
    (PoseMessage(position=Point(z=0.01)), 'out_of_plane', 'z = 0.01 m'),
    (PoseMessage(orientation=Quaternion(x=0.1, w=math.sqrt(0.99))), 'out_of_plane', '0.2003 rad'),
    (PoseMessage(orientation=Quaternion(w=0.0)), 'quaternion', 'norm 0'),
    (PoseMessage(orientation=Quaternion(z=1.0, w=1.0)), 'quaternion', 'norm 1.41421'),
])
def test_what_is_no_planar_pose_is_rejected_with_value_and_bound(message, reason, expected):
    with pytest.raises(InputError, match=expected) as rejection:
        planar_pose(message, 'goal')
    assert rejection.value.reason == reason


def test_another_frame_is_rejected_naming_both():
    require_frame('rail', 'rail', 'goal')
    with pytest.raises(InputError, match="goal is in frame 'map', expected 'rail'"):
        require_frame('map', 'rail', 'goal')


@given(st.lists(st.text(max_size=50), max_size=20).map('\n'.join))
def test_what_a_stranger_calls_things_stays_one_short_line(text):
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
    (['q1', 'q2', 'q3'], [0.0, math.nan, 0.0], 'of q2 = nan is not a finite number'),
])
def test_missing_double_or_unknown_names_and_numbers_are_rejected(names, values, message):
    with pytest.raises(InputError, match=message):
        carriages_from(names, values, 'setpoint position')


def test_a_stamped_pose_has_frame_and_stamp():
    message = pose_stamped('rail', 12.5, Pose(1.0, 2.0, 0.0))
    assert message.header.frame_id == 'rail'
    assert seconds(message.header.stamp) == 12.5


@given(lengths, lengths, lengths)
def test_a_wrench_survives_the_way_through_a_message(fx, fy, mz):
    message = wrench_stamped('end_effector', 12.5, Wrench(fx, fy, mz))
    assert planar_wrench(message) == (fx, fy, mz)
    assert (message.header.frame_id, seconds(message.header.stamp)) == ('end_effector', 12.5)


def test_what_a_wrench_has_out_of_the_plane_is_left_out():
    message = wrench_stamped('end_effector', 0.0, Wrench(1.0, 2.0, 3.0))
    message.wrench.force.z = message.wrench.torque.x = 9.0
    assert planar_wrench(message) == (1.0, 2.0, 3.0)


def test_a_diagnostic_status_holds_its_values_as_text():
    status = diagnostic_status('bus', 'warn', 'late', {'load': 0.123456789, 'cycles': 3})
    assert status.level == b'\x01'
    assert [(item.key, item.value) for item in status.values] == [
        ('load', '0.123457'), ('cycles', '3')]
