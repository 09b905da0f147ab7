"""Messages: planar poses, stamps, carriages, transforms; invalid contents are rejected."""

import math
from types import SimpleNamespace

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, TransformStamped, WrenchStamped
from geometry_msgs.msg import Pose as PoseMessage
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.nodes import conversions, planar_messages
from facade_manipulator.nodes.conversions import pose_stamped, stamp

lengths = st.floats(-10.0, 10.0)
angles = st.floats(-math.pi + 1e-9, math.pi)


@given(lengths, lengths, angles, st.sampled_from([1.0, -1.0]))
def test_pose_survives_conversion_to_a_message_and_back(x, y, theta, sign):
    """Both signs of a quaternion are the same orientation."""
    message = pose_stamped('rail', 12.5, Pose(x, y, theta))
    q = message.pose.orientation
    if sign < 0.0:
        message.pose.orientation = Quaternion(x=-q.x, y=-q.y, z=-q.z, w=-q.w)
    assert message.header.frame_id == 'rail'
    assert planar_messages.seconds(message.header.stamp) == 12.5
    back = planar_messages.planar_pose(message.pose, 'goal')
    assert back.x == x
    assert back.y == y
    turn = math.remainder(back.theta - theta, math.tau)
    assert turn == pytest.approx(0.0, abs=1e-14)


@given(angles, st.integers(2, 6))
def test_rounded_quaternion_is_accepted_with_its_yaw(theta, digits):
    message = pose_stamped('rail', 12.5, Pose(0.0, 0.0, theta)).pose
    q = message.orientation
    q.z = round(q.z, digits)
    q.w = round(q.w, digits)
    yaw = planar_messages.planar_pose(message, 'goal').theta
    error = math.remainder(yaw - theta, math.tau)
    assert abs(error) < 2.0 * math.sqrt(0.5) * 10.0**-digits


@given(st.integers(0, 2**31 - 1), st.integers(0, 10**9 - 1))
def test_stamp_survives_conversion_to_seconds_and_to_text(sec, nanosec):
    time = sec + nanosec * 1e-9
    assert planar_messages.seconds(stamp(time)) == pytest.approx(time, abs=1e-6)
    whole, part = planar_messages.stamp_text(Time(sec=sec, nanosec=nanosec)).split('.')
    assert int(whole) == sec
    assert int(part) == nanosec
    assert len(part) == 9


@pytest.mark.parametrize('age', [5.0, 0.0, -1.0])
def test_stamp_within_its_limits_is_accepted(age):
    planar_messages.require_recent_command('goal_pose', 100.0 - age, 100.0)


@pytest.mark.parametrize(('age', 'reason'), [(5.01, 'stale'), (-1.01, 'future')])
def test_old_and_future_stamps_are_rejected(age, reason):
    with pytest.raises(InputError) as caught:
        planar_messages.require_recent_command('goal_pose', 100.0 - age, 100.0)
    assert caught.value.reason == reason


@given(st.builds(Pose, lengths, lengths, angles), angles, st.floats(0.0, 0.2), lengths)
def test_tilted_pose_is_projected_into_the_plane(place, direction, tilt, height):
    """Rotate a pose about z, then tilt it about an axis in the plane."""
    turn = (math.cos(place.theta / 2), math.sin(place.theta / 2))
    half = math.sin(tilt / 2)
    ax = half * math.cos(direction)
    ay = half * math.sin(direction)
    w = math.cos(tilt / 2)
    message = PoseMessage()
    message.position = Point(x=place.x, y=place.y, z=height)
    message.orientation.x = ax * turn[0] + ay * turn[1]
    message.orientation.y = ay * turn[0] - ax * turn[1]
    message.orientation.z = w * turn[1]
    message.orientation.w = w * turn[0]
    found, out_of_plane = planar_messages.projected(message, 'disturbance')
    assert found == pytest.approx(place, abs=1e-9)
    assert out_of_plane == pytest.approx((height, tilt), abs=1e-7)


@given(st.permutations(AXIS_NAMES))
def test_carriages_are_found_by_name_in_any_order(names):
    values = {'q1': -0.1, 'q2': 0.2, 'q3': 0.3}
    positions = [values[name] for name in names]
    found = planar_messages.carriages_from(names, positions, 'p')
    assert found == (-0.1, 0.2, 0.3)


def pose(**parts):
    return lambda: planar_messages.planar_pose(PoseMessage(**parts), 'goal')


def carriages(names, values):
    return lambda: planar_messages.carriages_from(names, values, 'setpoint position')


@pytest.mark.parametrize(
    'read, reason, message',
    [
        (pose(position=Point(x=math.nan)), 'not_finite', 'goal x = nan'),
        (pose(position=Point(z=math.inf)), 'not_finite', 'goal z = inf'),
        (pose(orientation=Quaternion(w=math.nan)), 'not_finite', 'orientation.w = nan'),
        (pose(position=Point(z=0.01)), 'out_of_plane', 'z = 0.01 m'),
        (
            pose(orientation=Quaternion(x=0.1, w=math.sqrt(0.99))),
            'out_of_plane',
            '0.2003 rad',
        ),
        (pose(orientation=Quaternion(w=0.0)), 'quaternion', 'norm 0'),
        (pose(orientation=Quaternion(z=1.0, w=1.0)), 'quaternion', 'norm 1.41421'),
        (
            lambda: planar_messages.seconds(Time(sec=1, nanosec=10**9)),
            'malformed',
            'stamp is invalid: 1000000000 ns is not below the limit 1000000000 ns',
        ),
        (
            lambda: planar_messages.require_frame('map', 'rail', 'goal'),
            'frame',
            "goal is in frame 'map', expected 'rail'",
        ),
        (
            carriages(['q1', 'q2'], [0.0] * 2),
            'names',
            'expected each of q1, q2, q3 once',
        ),
        (
            carriages(['q1', 'q2', 'q2'], [0.0] * 3),
            'names',
            r"names \['q1', 'q2', 'q2'\]",
        ),
        (carriages(AXIS_NAMES, [0.0] * 2), 'names', '2 values for 3 names'),
        (
            carriages(AXIS_NAMES, [0.0, math.nan, 0.0]),
            'not_finite',
            'of q2 = nan',
        ),
    ],
)
def test_invalid_content_is_rejected_with_its_value(read, reason, message):
    with pytest.raises(InputError, match=message) as rejection:
        read()
    assert rejection.value.reason == reason


@given(st.lists(st.text(max_size=50), max_size=20).map('\n'.join))
def test_long_foreign_text_is_shortened_in_a_rejection(text):
    for reject in (
        lambda: planar_messages.require_frame(f'{text}!', 'rail', 'goal'),
        carriages([text] * 99, [0.0] * 99),
    ):
        with pytest.raises(InputError) as rejection:
            reject()
        assert len(str(rejection.value)) < 350
        assert str(rejection.value).isprintable()


def test_wrench_out_of_the_plane_is_ignored():
    message = WrenchStamped()
    message.wrench.force.x = 1.0
    message.wrench.force.y = 2.0
    message.wrench.force.z = 9.0
    message.wrench.torque.x = 9.0
    message.wrench.torque.z = 3.0
    assert planar_messages.planar_wrench(message) == (1.0, 2.0, 3.0)


def test_disturbance_is_broadcast_in_frames_of_the_namespace(ros, monkeypatch):
    """No wheel provides tf2_msgs, so a single transform replaces its message."""
    node = ros.node(namespace='/gondola_1')
    assert not conversions.FacadeTransform(node).is_subscribed
    assert '/tf' not in {one.topic_name for one in node.publishers}
    monkeypatch.setattr(
        conversions,
        'import_module',
        lambda _: SimpleNamespace(TFMessage=TransformStamped),
    )
    transform = conversions.FacadeTransform(node)
    transform._message = lambda transforms: transforms[0]
    sent = ros.collect(ros.node('listener'), TransformStamped, '/tf', 100)

    def publish():
        transform.publish(12.5, Pose(0.1, 0.2, 1.0))
        return sent

    ros.until(publish, 'the transform')
    header = sent[0].header
    body = sent[0].transform
    assert header.frame_id == 'gondola_1/facade'
    assert sent[0].child_frame_id == 'gondola_1/rail'
    assert planar_messages.seconds(header.stamp) == 12.5
    assert body.translation.x == 0.1
    assert body.translation.y == 0.2
    assert body.rotation.z == pytest.approx(math.sin(0.5))
