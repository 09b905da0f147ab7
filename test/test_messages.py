import math
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, TransformStamped
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
    stamp_text,
)
from facade_manipulator.nodes import conversions
from facade_manipulator.nodes.conversions import (
    FacadeTransform,
    pose_message,
    pose_stamped,
    stamp,
    wrench_stamped,
)

lengths = st.floats(-10.0, 10.0)
angles = st.floats(-math.pi + 1e-9, math.pi)


@given(lengths, lengths, angles)
def test_pose_survives_the_way_through_a_message(x, y, theta):
    back = planar_pose(pose_message(Pose(x, y, theta)), 'goal')
    assert (back.x, back.y) == (x, y)
    assert math.remainder(back.theta - theta, math.tau) == pytest.approx(0.0, abs=1e-14)


@given(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1))
def test_stamp_survives_as_seconds_to_a_microsecond(sec, nanosec):
    time = sec + nanosec * 1e-9
    assert seconds(stamp(time)) == pytest.approx(time, abs=1e-6)


def test_both_signs_of_a_quaternion_are_one_pose():
    message = pose_message(Pose(0.1, 0.2, 0.3))
    q = message.orientation
    message.orientation = Quaternion(x=-q.x, y=-q.y, z=-q.z, w=-q.w)
    assert planar_pose(message, 'goal').theta == pytest.approx(0.3)


@given(st.builds(Pose, lengths, lengths, angles), angles, st.floats(0.0, 0.2), lengths)
def test_tilted_pose_is_projected_into_the_plane(place, direction, tilt, height):
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
def test_pose_out_of_the_plane_is_rejected_with_its_value(message, reason, expected):
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
    (['q1', 'q2', 'q3'], [0.0, math.nan, 0.0], 'of q2 = nan is not a finite number'),
])
def test_bad_carriage_names_and_values_are_rejected(names, values, message):
    with pytest.raises(InputError, match=message):
        carriages_from(names, values, 'setpoint position')


def test_stamped_pose_has_frame_and_stamp():
    message = pose_stamped('rail', 12.5, Pose(1.0, 2.0, 0.0))
    assert message.header.frame_id == 'rail'
    assert seconds(message.header.stamp) == 12.5


@given(lengths, lengths, lengths)
def test_wrench_survives_the_way_through_a_message(fx, fy, mz):
    message = wrench_stamped('end_effector', 12.5, Wrench(fx, fy, mz))
    assert planar_wrench(message) == (fx, fy, mz)
    assert (message.header.frame_id, seconds(message.header.stamp)) == ('end_effector', 12.5)


def test_wrench_out_of_the_plane_is_ignored():
    message = wrench_stamped('end_effector', 0.0, Wrench(1.0, 2.0, 3.0))
    message.wrench.force.z = message.wrench.torque.x = 9.0
    assert planar_wrench(message) == (1.0, 2.0, 3.0)


def test_malformed_stamp_is_rejected():
    with pytest.raises(InputError, match='1000000000 ns, bound 1000000000 ns') as rejection:
        seconds(Time(sec=1, nanosec=10 ** 9))
    assert rejection.value.reason == 'malformed'


@given(st.integers(0, 2 ** 31 - 1), st.integers(0, 10 ** 9 - 1))
def test_stamp_text_is_exact(sec, nanosec):
    whole, part = stamp_text(Time(sec=sec, nanosec=nanosec)).split('.')
    assert (int(whole), int(part), len(part)) == (sec, nanosec, 9)


@pytest.mark.parametrize('namespace, prefix', [('', ''), ('/gondola_1', 'gondola_1/')])
def test_disturbance_is_broadcast_in_the_frames_of_the_namespace(
        ros, monkeypatch, namespace, prefix):
    """No wheel has tf2_msgs: a single transform replaces its message."""
    monkeypatch.setattr(conversions, 'import_module', lambda _: SimpleNamespace(
        TFMessage=TransformStamped))
    transform = FacadeTransform(ros.node(namespace=namespace))
    transform._message = lambda transforms: transforms[0]
    sent = ros.collect(ros.node('listener'), TransformStamped, '/tf', 100)
    ros.until(lambda: transform.publish(12.5, Pose(0.1, 0.2, 1.0)) or sent, 'the transform')
    header, child = sent[0].header, sent[0].child_frame_id
    assert (header.frame_id, child, seconds(header.stamp)) == (
        prefix + 'facade', prefix + 'rail', 12.5)
    translation, rotation = sent[0].transform.translation, sent[0].transform.rotation
    assert (translation.x, translation.y) == (0.1, 0.2)
    assert rotation.z == pytest.approx(0.479425538604203)


def test_nothing_is_broadcast_without_tf2_msgs(ros):
    node = ros.node()
    FacadeTransform(node).publish(0.0, Pose(0.0, 0.0, 0.0))
    assert '/tf' not in {one.topic_name for one in node.publishers}
