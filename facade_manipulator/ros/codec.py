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
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import (
    CARRIAGES,
    estimate_numbers,
    in_order,
    POSE_NUMBERS,
    pose_numbers,
    RAIL,
    require_frame,
    seconds,
    VARIANCES,
)

ENCAPSULATION = {'little': b'\0\1', 'big': b'\0\0'}[sys.byteorder]
NUMBER = None
COVARIANCE_SIZE = 36
LATEST_STAMP = 2.0 ** 31  # s, where the seconds of a stamp end


class Field(NamedTuple):
    """Values of a message."""

    format: str  #: as of `struct`
    values: tuple  #: what they are in every message of the topic; `NUMBER` where that changes


STAMP = Field('iI', (NUMBER, NUMBER))


def text(value: str) -> Field:
    """Return the field of a string that is the same in every message."""
    data = value.encode() + b'\0'
    return Field(f'I{len(data)}s', (len(data), data))


def length(value: int) -> Field:
    """Return the field of an array's length, to be followed by the array."""
    return Field('I', (value,))


def doubles(count: int) -> Field:
    """Return the field of numbers that change."""
    return Field(f'{count}d', (NUMBER,) * count)


def unread(count: int) -> Field:
    """Return the field of numbers that nobody asks for; 0 when written."""
    return Field(f'{8 * count}x', ())


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
            (*self._constants, *stamp_numbers(time), *numbers)))

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
        try:
            message = deserialize_message(data, self._type)
        except Exception as error:  # whatever the middleware's library makes of it
            raise InputError(
                'malformed', f'{self._what}: {len(data)} bytes are no '
                f'{self._type.__name__}') from error
        return self._checked(seconds(message.header.stamp)), self._numbers_of(message)


def pose_codec(topic: str, frame_id: str) -> Codec:
    """Return the codec of a topic of PoseStamped, whose numbers are those of the pose."""
    def numbers_of(message: PoseStamped) -> tuple[float, ...]:
        require_frame(message.header.frame_id, frame_id, topic)
        return pose_numbers(message.pose)

    return Codec(PoseStamped, (text(frame_id), doubles(len(POSE_NUMBERS))), numbers_of, topic)


def estimate_codec(topic: str, frame_id: str) -> Codec:
    """
    Return the codec of a topic of PoseWithCovarianceStamped.

    Its numbers are those of the pose, then the variances of x, y and yaw.
    """
    def numbers_of(message: PoseWithCovarianceStamped) -> tuple[float, ...]:
        require_frame(message.header.frame_id, frame_id, topic)
        return estimate_numbers(message)

    covariance = chain.from_iterable(
        (doubles(1), unread(end - begin - 1))
        for begin, end in pairwise((*VARIANCES, COVARIANCE_SIZE)))
    return Codec(
        PoseWithCovarianceStamped,
        (text(frame_id), doubles(len(POSE_NUMBERS)), *covariance), numbers_of, topic)


def setpoint_codec() -> Codec:
    """Return the codec of joint_setpoints: position and velocity of q1, q2 and q3."""
    return _carriages_codec('setpoint', RAIL, needed=('position', 'velocity'), optional=())


def states_codec() -> Codec:
    """Return the codec of joint_states: position, velocity and effort of q1, q2 and q3."""
    return _carriages_codec(
        'joint_states', '', needed=('position',), optional=('velocity', 'effort'))


def _carriages_codec(
    what: str, frame_id: str, needed: Sequence[str], optional: Sequence[str]
) -> Codec:
    """
    Return the codec of a topic of JointState: three numbers of each array.

    They are NaN where an optional array has not one for each. The frame is the usual one, others
    will do.
    """
    def numbers_of(message: JointState) -> tuple[float, ...]:
        return tuple(chain.from_iterable(
            in_order(message.name, array_of(message, name), f'{what} {name}')
            for name in (*needed, *optional)))

    def array_of(message: JointState, name: str) -> Sequence[float]:
        array, count = getattr(message, name), len(message.name)
        return (math.nan,) * count if name in optional and len(array) != count else array

    count = len(CARRIAGES)
    arrays = [
        (length(count), doubles(count)) if name in (*needed, *optional) else (length(0),)
        for name in ('position', 'velocity', 'effort')]
    return Codec(JointState, (
        text(frame_id), length(count), *map(text, CARRIAGES), *chain.from_iterable(arrays),
    ), numbers_of, what)


def stamp_numbers(time: float) -> tuple[int, int]:
    """Return the two numbers of a stamp, whole seconds and the nanoseconds after them."""
    sec = math.floor(time)
    return sec, int((time - sec) * 1e9)


def planar_numbers(pose: Pose) -> tuple[float, ...]:
    """Return the seven numbers of a planar pose, position [m] and quaternion."""
    half = 0.5 * pose.theta
    return pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half)
