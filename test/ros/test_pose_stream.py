"""Poses are published to who listens, and to nobody else."""

import math

from geometry_msgs.msg import PoseStamped
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.ros.conversions import planar_pose, seconds
from facade_manipulator.ros.pose_stream import PoseStream
from facade_manipulator.ros.runtime import LATEST

PLACE = Pose(0.1, 0.2, math.radians(5.0))


@pytest.fixture
def stream(ros):
    """Return a stream whose publisher notes what it is given."""
    stream = PoseStream(ros.node('teller'), 'poses', 'rail', LATEST)
    publish, stream.published = stream._publisher.publish, []

    def note(data):
        stream.published.append(data)
        publish(data)

    stream._publisher.publish = note
    return stream


def listen(ros, stream):
    """Return the list of messages that a new listener hears, once it is known, and its node."""
    listeners = stream._listeners
    node = ros.node('listener')
    heard = ros.collect(node, PoseStamped, 'poses', LATEST)
    ros.until(lambda: stream._listeners == listeners + 1, 'the listener')
    return heard, node


def test_nobody_listens_and_nothing_is_published(stream):
    stream.tell(1.0, PLACE)
    assert not stream.published


def test_a_listener_hears_time_and_pose_until_it_goes(ros, stream):
    heard, node = listen(ros, stream)
    stream.tell(12.5, PLACE)
    ros.until(lambda: heard, 'the pose')
    assert seconds(heard[0].header.stamp) == 12.5
    assert heard[0].header.frame_id == 'rail'
    assert planar_pose(heard[0].pose, 'pose') == pytest.approx(PLACE)
    for subscription in list(node.subscriptions):
        node.destroy_subscription(subscription)
    ros.until(lambda: stream._listeners == 0, 'its end')
    stream.tell(13.0, PLACE)
    assert len(stream.published) == 1


@pytest.mark.parametrize('subscribes', [True, False])
def test_a_neighbour_gets_every_pose_and_for_its_sake_nothing_is_published(
        ros, stream, subscribes):
    handed = []
    stream.hand_to(lambda *told: handed.append(told), subscribes=subscribes)
    if subscribes:
        listen(ros, stream)
    stream.tell(1.0, PLACE)
    assert handed == [(1.0, PLACE)] and not stream.published
    heard, _ = listen(ros, stream)
    stream.tell(2.0, PLACE)
    ros.until(lambda: heard, 'the pose')
    assert len(handed) == 2 and len(stream.published) == 1
