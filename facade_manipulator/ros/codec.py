"""
Messages as bytes, for topics of hundreds of messages a second.

rclpy makes a Python object of every part of a message: 25 us for a pose with its covariance, 11 us
for a JointState, which is more than the nodes take to decide. On the topic of a stream all
messages look alike but for stamp and numbers, so one call of `struct` reads or writes them.
Whatever looks different goes through rclpy as on any other topic.

References
----------
OMG Common Data Representation, which all of ROS 2's middleware sends: values follow each other,
each aligned to its own size, as in a struct of C. Four bytes before them name the byte order.
Strings have their length before them and a zero after, arrays their length before them.

"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import chain, pairwise
import math
from operator import itemgetter
import struct
import sys
from typing import Any, NamedTuple

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from facade_manipulator import messages
from facade_manipulator.errors import InputError

ENCAPSULATION = {'little': b'\0\1', 'big': b'\0\0'}[sys.byteorder]
NUMBER = None
COVARIANCE_SIZE = 36
ARRAYS = ('position', 'velocity', 'effort')  # of a JointState
LATEST_STAMP = 2.0 ** 31  # s, where the seconds of a stamp end


class Field(NamedTuple):
    """Values of a message."""

    format: str  #: as of `struct`
    values: tuple[Any, ...]  #: in every message of the topic; `NUMBER` where it changes


STAMP = Field('iI', (NUMBER, NUMBER))


def text(value: str) -> Field:
    """Return the field of a string that is the same in every message."""
    data = value.encode() + b'\0'
    return Field(f'I{len(data)}s', (len(data), data))


def doubles(count: int, unread: int = 0) -> Field:
    """Return the field of numbers that change, and more that nobody asks for, written as 0."""
    return Field(f'{count}d{8 * unread}x', (NUMBER,) * count)


def array(count: int) -> Field:
    """Return the field of an array of numbers that change, its length before them."""
    return Field(f'I{count}d' if count else 'I', (count, *(NUMBER,) * count))


# of a sensor's message what follows the frame
IMU_FIELDS = (doubles(0, unread=13), doubles(4, unread=8), doubles(4, unread=8))
RANGE_FIELDS = (Field('x0f4x3f', (NUMBER,) * 3),)  # after kind and field of view
POINT_FIELDS = (doubles(1, unread=2),)


class Codec:
    """
    Reads and writes the messages of a topic.

    Parameters
    ----------
    message_type : type
        Of messages with a header.
    fields : iterable of Field
        What follows the header's stamp in every usual message of the topic.
    numbers_of : callable
        Returns of any such message the numbers of `fields`, in their order. May raise
        `InputError`, such as for another frame.
    what : str
        Name of the message in the message of a rejection.

    """

    def __init__(
        self, message_type: type, fields: Iterable[Field],
        numbers_of: Callable[[Any], Sequence[float]], what: str,
    ) -> None:
        self._type = message_type
        self._numbers_of = numbers_of
        self._what = what
        fields = (STAMP, *fields)
        self._body = struct.Struct('@' + ' '.join(field.format for field in fields))
        self._head = ENCAPSULATION + b'\0\0'
        self._size = len(self._head) + self._body.size
        values = list(chain.from_iterable(field.values for field in fields))
        changing = [k for k, value in enumerate(values) if value is NUMBER]
        constant = [k for k, value in enumerate(values) if value is not NUMBER]
        self._constants = tuple(values[k] for k in constant)
        self._pick_constants, self._pick_changing = itemgetter(*constant), itemgetter(*changing)
        self._in_order = itemgetter(*map((constant + changing).index, range(len(values))))

    def write(self, time: float, numbers: Sequence[float]) -> bytes:
        """Return the message with a stamp [s] and numbers, to be given to `publish`."""
        return self._head + self._body.pack(*self._in_order(
            (*self._constants, *messages.stamp_numbers(time), *numbers)))

    def read(self, data: bytes) -> tuple[float, Sequence[float]]:
        """
        Return stamp [s] and numbers of a message of a subscription that is `raw`.

        Raises
        ------
        InputError
            With reason ``'malformed'``, or what the function for the numbers raises.

        """
        if len(data) >= self._size and data.startswith(ENCAPSULATION):  # padding may follow
            values = self._body.unpack_from(data, len(self._head))
            if self._pick_constants(values) == self._constants:
                sec, nanosec, *numbers = self._pick_changing(values)
                return self._checked(sec + nanosec * 1e-9), numbers
        return self._read_slowly(data)

    def _checked(self, time: float) -> float:
        """Return the time of a stamp if a message with it can be written."""
        if time >= LATEST_STAMP:
            raise InputError(
                'malformed', f'{self._what}: a stamp of {time:.9g} s, bound {LATEST_STAMP:.9g} s')
        return time

    def _read_slowly(self, data: bytes) -> tuple[float, Sequence[float]]:
        message = message_from(data, self._type, self._what)
        return self._checked(messages.seconds(message.header.stamp)), self._numbers_of(message)


def message_from(data: bytes, kind: type, what: str) -> Any:
    """
    Return a message from its bytes.

    Raises
    ------
    InputError
        With reason ``'malformed'``.

    """
    try:
        return deserialize_message(data, kind)
    except Exception as error:  # whatever the middleware's library makes of it
        raise InputError(
            'malformed', f'{what}: {len(data)} bytes are no {kind.__name__}') from error


def pose_codec(topic: str, frame_id: str) -> Codec:
    """Return the codec of a topic of PoseStamped, whose numbers are those of the pose."""
    return _codec_in_frame(
        PoseStamped, topic, frame_id, lambda message: messages.pose_numbers(message.pose))


def estimate_codec(topic: str, frame_id: str) -> Codec:
    """
    Return the codec of a topic of PoseWithCovarianceStamped.

    Its numbers are those of the pose, then the variances of x, y and yaw.
    """
    return _codec_in_frame(PoseWithCovarianceStamped, topic, frame_id, messages.estimate_numbers, (
        doubles(1, unread=end - begin - 1)
        for begin, end in pairwise((*messages.VARIANCES, COVARIANCE_SIZE))))


class SensorReader:
    """
    Read the messages of a sensor whose driver names a frame of its own, as `Codec.read` does.

    The frame of the first message is the usual one. Parameters as those of a `Codec`, without it.
    """

    def __init__(
        self, message_type: type, fields: Iterable[Field],
        numbers_of: Callable[[Any], Sequence[float]], what: str,
    ) -> None:
        self._type, self._what = message_type, what
        self._codec_of = lambda frame_id: Codec(
            message_type, (text(frame_id), *fields), numbers_of, what)
        self._codec: Codec | None = None

    def read(self, data: bytes) -> tuple[float, Sequence[float]]:
        """Return stamp [s] and numbers."""
        if self._codec is None:
            frame_id = message_from(data, self._type, self._what).header.frame_id
            self._codec = self._codec_of(frame_id)
        return self._codec.read(data)


def odometry_codec(topic: str, frame_id: str, child_frame_id: str) -> Codec:
    """
    Return the codec of a topic of Odometry, to write it.

    Its numbers are those of the pose, its covariance, the twist and the covariance of that.
    """
    return Codec(Odometry, (
        text(frame_id), text(child_frame_id),
        doubles(len(messages.POSE_NUMBERS) + COVARIANCE_SIZE + 6 + COVARIANCE_SIZE)), list, topic)


def _codec_in_frame(
    message_type: type, topic: str, frame_id: str, numbers: Callable[[Any], Sequence[float]],
    after_the_pose: Iterable[Field] = (),
) -> Codec:
    def numbers_of(message: Any) -> Sequence[float]:
        messages.require_frame(message.header.frame_id, frame_id, topic)
        return numbers(message)

    return Codec(
        message_type, (text(frame_id), doubles(len(messages.POSE_NUMBERS)), *after_the_pose),
        numbers_of, topic)


def setpoint_codec(frame_id: str = messages.RAIL) -> Codec:
    """Return the codec of joint_setpoints: position and velocity of q1, q2 and q3."""
    return _carriages_codec('setpoint', frame_id, ARRAYS[:2])


def states_codec() -> Codec:
    """Return the codec of joint_states: position, velocity and effort of q1, q2 and q3."""
    return _carriages_codec('joint_states', '', ARRAYS, optional=ARRAYS[1:])


def _carriages_codec(
    what: str, frame_id: str, arrays: Sequence[str], optional: Sequence[str] = ()
) -> Codec:
    """
    Return the codec of a topic of JointState: three numbers of each array.

    They are NaN where an optional array has not one for each. The frame is the usual one, others
    will do.
    """
    def numbers_of(message: JointState) -> tuple[float, ...]:
        return tuple(chain.from_iterable(
            messages.in_order(message.name, array_of(message, name), f'{what} {name}')
            for name in arrays))

    def array_of(message: JointState, name: str) -> Sequence[float]:
        values, count = getattr(message, name), len(message.name)
        return (math.nan,) * count if name in optional and len(values) != count else values

    count = len(messages.CARRIAGES)
    return Codec(JointState, (
        text(frame_id), Field('I', (count,)), *map(text, messages.CARRIAGES),
        *(array(count if name in arrays else 0) for name in ARRAYS)), numbers_of, what)
