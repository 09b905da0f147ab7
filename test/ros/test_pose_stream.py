"""Poses are published to who listens, and to nobody else."""

import math

from geometry_msgs.msg import PoseStamped
import pytest
from qualities import LATEST

from facade_manipulator import interfaces
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_pose, seconds
from facade_manipulator.ros.conversions import PoseStream

pytestmark = pytest.mark.quick
PLACE = Pose(0.1, 0.2, math.radians(5.0))


@pytest.fixture
def stream(ros):
    """Return a stream whose publisher notes what it is given."""
    stream = PoseStream(ros.node('teller'), interfaces.CORRECTED_POSE, 'rail')
    publish, stream.published = stream._publisher.publish, []

    def note(data):
        stream.published.append(data)
        publish(data)

    stream._publisher.publish = note
    return stream


def listen(ros, stream):
    """Return the list of messages that a new listener hears, once it is known, and its node."""
    listeners = stream._subscriptions
    node = ros.node('listener')
    received = ros.collect(node, PoseStamped, interfaces.CORRECTED_POSE.name, LATEST)
    ros.until(lambda: stream._subscriptions == listeners + 1, 'the listener')
    return received, node


def test_nobody_listens_and_nothing_is_published(stream):
    stream.publish(1.0, PLACE)
    assert not stream.published


def test_a_listener_hears_time_and_pose_until_it_goes(ros, stream):
    received, node = listen(ros, stream)
    stream.publish(12.5, PLACE)
    ros.until(lambda: received, 'the pose')
    assert seconds(received[0].header.stamp) == 12.5
    assert received[0].header.frame_id == 'rail'
    assert planar_pose(received[0].pose, 'pose') == pytest.approx(PLACE)
    for subscription in list(node.subscriptions):
        node.destroy_subscription(subscription)
    ros.until(lambda: stream._subscriptions == 0, 'its end')
    stream.publish(13.0, PLACE)
    assert len(stream.published) == 1


@pytest.mark.parametrize('subscribes', [True, False])
def test_a_neighbour_gets_every_pose_and_for_its_sake_nothing_is_published(
        ros, stream, subscribes):
    handed = []
    stream.connect(lambda *received: handed.append(received), subscribes=subscribes)
    if subscribes:
        listen(ros, stream)
    stream.publish(1.0, PLACE)
    assert handed == [(1.0, PLACE)] and not stream.published
    received, _ = listen(ros, stream)
    stream.publish(2.0, PLACE)
    ros.until(lambda: received, 'the pose')
    assert len(handed) == 2 and len(stream.published) == 1
