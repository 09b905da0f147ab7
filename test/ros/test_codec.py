"""Messages as bytes: the same as what rclpy makes of them, whatever comes."""

import math
import struct

from geometry_msgs.msg import Point, PointStamped, PoseStamped, PoseWithCovarianceStamped, Vector3
from hypothesis import given
from hypothesis import strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, JointState, Range

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.messages import FIX, IMU, RANGE
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import CARRIAGES, seconds, VARIANCES
from facade_manipulator.ros import codec
from facade_manipulator.ros.codec import estimate_codec, pose_codec, setpoint_codec, states_codec
from facade_manipulator.ros.conversions import pose_stamped, stamp

STAMP = 12.5
ARRAYS = ('position', 'velocity', 'effort')
numbers = st.floats(allow_nan=False)


def poses(values, frame_id='rail'):
    message = PoseStamped()
    _fill(message.pose, values)
    return _stamped(message, frame_id)


def estimates(values, frame_id='facade'):
    message = PoseWithCovarianceStamped()
    _fill(message.pose.pose, values[:7])
    message.pose.covariance[list(VARIANCES)] = values[7:]
    return _stamped(message, frame_id)


def setpoints(values, frame_id='rail', names=CARRIAGES):
    arrays = {name: values[3 * k:3 * k + 3] for k, name in enumerate(ARRAYS)}
    return _stamped(JointState(name=list(names), **arrays), frame_id)


def states(values):
    return setpoints(values, '')


def _fill(pose, values):
    position, q = pose.position, pose.orientation
    position.x, position.y, position.z, q.x, q.y, q.z, q.w = values


def _stamped(message, frame_id):
    message.header.frame_id = frame_id
    message.header.stamp = stamp(STAMP)
    return message


@pytest.fixture(params=[
    (lambda: pose_codec('corrected_pose', 'rail'), poses, 7),
    (lambda: estimate_codec('disturbance', 'facade'), estimates, 10),
    (setpoint_codec, setpoints, 6),
    (states_codec, states, 9),
], ids=['pose', 'estimate', 'setpoint', 'states'], scope='module')
def topic(request):
    """Return a wire, what makes a message of its kind from numbers, and their count."""
    make, message, count = request.param
    return make(), message, count


@pytest.fixture
def no_slow_way(monkeypatch):
    """Fail where a message goes through rclpy."""
    def reject(*_):
        raise AssertionError('went the slow way')

    monkeypatch.setattr(codec, 'deserialize_message', reject)


@given(st.data())
def test_what_is_written_is_what_rclpy_writes(topic, data):
    wire, message, count = topic
    values = data.draw(st.lists(numbers, min_size=count, max_size=count))
    assert deserialize_message(
        wire.write(STAMP, values), type(message(values))) == message(values)


@given(st.data())
def test_what_rclpy_writes_is_read(topic, data):
    wire, message, count = topic
    values = data.draw(st.lists(numbers, min_size=count, max_size=count))
    time, read = wire.read(serialize_message(message(values)))
    assert (time, list(read)) == (STAMP, values)


@given(st.integers(-2 ** 31, 2 ** 31 - 1), st.integers(0, 10 ** 9 - 1))
def test_every_stamp_is_read_as_rclpy_does(sec, nanosec):
    message = poses([0.0] * 7)
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    time, _ = pose_codec('pose', 'rail').read(serialize_message(message))
    assert time == seconds(message.header.stamp)


def test_the_usual_message_goes_the_fast_way_even_with_numbers_that_are_none(topic, no_slow_way):
    wire, message, count = topic
    _, read = wire.read(serialize_message(message([math.nan, math.inf] + [0.0] * (count - 2))))
    assert math.isnan(read[0]) and read[1] == math.inf


def test_what_memory_held_before_does_not_matter_in_the_padding(topic, no_slow_way):
    """Serialisers write nothing into the padding: what is sent there is left from before."""
    wire, message, count = topic
    values = [float(k) for k in range(1, count + 1)]
    whole, paddings = serialize_message(message(values)), 0
    for k in range(2, len(whole)):
        other = bytes([*whole[:k], whole[k] ^ 0x55, *whole[k + 1:]])
        if _same(other, whole, type(message(values))):
            paddings += 1
            assert wire.read(other) == (STAMP, values)
    assert paddings


def _same(data, other, message_type):
    try:
        return deserialize_message(data, message_type) == deserialize_message(other, message_type)
    except Exception:  # of whatever kind the middleware has
        return False


@pytest.mark.parametrize('wire, message', [
    (pose_codec('corrected_pose', 'rail'), poses([0.0] * 7, 'map')),
    (pose_codec('corrected_pose', 'rail'), poses([0.0] * 7, 'RAIL')),
    (pose_codec('corrected_pose', 'rail'), poses([0.0] * 7, 'rail\n' * 500)),
    (estimate_codec('disturbance', 'facade'), estimates([0.0] * 10, '')),
])
def test_another_frame_is_rejected_as_ever(wire, message):
    with pytest.raises(InputError, match='is in frame') as rejection:
        wire.read(serialize_message(message))
    assert rejection.value.reason == 'frame'


@pytest.mark.parametrize('message, expected', [
    (setpoints([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], ''), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
    (setpoints([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
    (setpoints([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], names=('q3', 'q1', 'q2')),
     [2.0, 3.0, 1.0, 5.0, 6.0, 4.0]),
])
def test_another_order_frame_or_array_is_no_harm(message, expected):
    assert setpoint_codec().read(serialize_message(message)) == (STAMP, tuple(expected))


@pytest.mark.parametrize('message, expected', [
    (setpoints([1.0, 2.0, 3.0]), 'setpoint velocity has 0 values for 3 names'),
    (setpoints([1.0, 2.0, 3.0], names=('q1', 'q2')), 'setpoint position has 3 values for 2 names'),
    (setpoints([0.0] * 6, names=('q1', 'q2', 'q4')), 'expected each of q1, q2, q3 once'),
])
def test_missing_numbers_and_unknown_names_are_rejected_with_a_message(message, expected):
    with pytest.raises(InputError, match=expected):
        setpoint_codec().read(serialize_message(message))


def test_joint_states_may_come_without_a_velocity_and_effort_for_each():
    for told in ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 4.0]):
        _, read = states_codec().read(serialize_message(states(told)))
        assert read[:3] == (1.0, 2.0, 3.0) and all(map(math.isnan, read[3:])) and len(read) == 9


def test_a_message_of_a_machine_of_the_other_byte_order_is_read():
    header = struct.pack('>2x2xiII5s7x', 12, 500_000_000, 5, b'rail\0')
    values = (0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0)
    data = header + struct.pack('>7d', *values)
    assert pose_codec('corrected_pose', 'rail').read(data) == (12.5, values)


@given(st.data())
def test_bytes_that_are_no_message_are_rejected_and_nothing_else_happens(topic, data):
    wire, message, count = topic
    whole = bytearray(serialize_message(message([0.5] * count)))
    for place in data.draw(st.lists(st.integers(0, len(whole) - 1), max_size=6)):
        whole[place] = data.draw(st.integers(0, 255))
    cut = data.draw(st.one_of(st.just(len(whole)), st.integers(0, len(whole))))
    try:
        time, read = wire.read(bytes(whole[:cut]))
    except InputError as error:
        assert str(error)
    else:
        assert len(read) == count
        assert wire.write(time, read)


@pytest.mark.parametrize('sec, nanosec', [(2 ** 31 - 1, 999_999_999), (2 ** 31 - 4, 2 ** 32 - 1)])
@pytest.mark.parametrize('frame_id', ['', 'rail'])
def test_a_stamp_that_no_message_could_have_any_more_is_rejected(sec, nanosec, frame_id):
    message = setpoints([0.0] * 6, frame_id)
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    with pytest.raises(InputError, match='a stamp of 2.147') as rejection:
        setpoint_codec().read(serialize_message(message))
    assert rejection.value.reason == 'malformed'


def test_what_is_cut_short_is_rejected_with_its_length():
    data = serialize_message(pose_stamped('rail', STAMP, Pose(0.1, 0.2, 0.3)))
    with pytest.raises(InputError, match='20 bytes are no PoseStamped') as rejection:
        pose_codec('corrected_pose', 'rail').read(data[:20])
    assert rejection.value.reason == 'malformed'


@pytest.mark.parametrize('frame_id', ['', 'imu', 'a_link', 'front/laser'])
@pytest.mark.parametrize(('kind', 'fields', 'taken'), [
    (Imu, codec.IMU_FIELDS, IMU), (Range, codec.RANGE_FIELDS, RANGE),
    (PointStamped, codec.POINT_FIELDS, FIX)])
def test_a_sensor_of_any_frame_is_read_fast_as_rclpy_reads_it(
    kind, fields, taken, frame_id, monkeypatch
):
    reader = codec.SensorReader(kind, fields, taken.numbers_of, 'sensor')
    message = _stamped(kind(), frame_id)
    if kind is Imu:
        message.angular_velocity = Vector3(x=0.1, y=0.2, z=0.3)
        message.linear_acceleration = Vector3(x=1.0, y=2.0, z=math.nan)
        message.orientation_covariance[8] = message.linear_acceleration_covariance[0] = 7.0
        message.angular_velocity_covariance[0] = -1.0
    elif kind is Range:
        message = _stamped(Range(radiation_type=1, field_of_view=9.0, min_range=0.1,
                                 max_range=2.0, range=0.45), frame_id)
    else:
        message.point = Point(x=0.1, y=0.2, z=0.3)
    data = serialize_message(message)
    expected = STAMP, list(taken.numbers_of(deserialize_message(data, kind)))
    assert repr(reader.read(data)) == repr(expected)
    other = serialize_message(_stamped(message, 'another'))
    assert repr(list(reader.read(other)[1])) == repr(expected[1])
    monkeypatch.setattr(codec, 'message_from', None)
    assert repr(reader.read(data)) == repr(expected)


def test_bytes_that_are_no_message_of_a_sensor_are_rejected_before_and_after_the_first():
    reader = codec.SensorReader(Imu, codec.IMU_FIELDS, IMU.numbers_of, 'imu')
    for data in (b'', serialize_message(_stamped(Imu(), 'imu')), b'\0\1'):
        if len(data) > 2:
            assert reader.read(data) == (STAMP, [0.0] * 8)
            continue
        with pytest.raises(InputError, match='imu: . bytes are no Imu'):
            reader.read(data)
