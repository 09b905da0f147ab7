"""Transforms: broadcast where tf2_msgs is installed, in the gondola's frames, to who listens."""

from geometry_msgs.msg import TransformStamped
import pytest

from facade_manipulator import interfaces
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import seconds
from facade_manipulator.ros import conversions
from facade_manipulator.ros.conversions import Transforms

pytestmark = pytest.mark.quick
PLACE = Pose(0.1, 0.2, 1.0)


@pytest.fixture
def with_tf2(monkeypatch):
    """Let a single transform be the message of /tf: no wheel has tf2_msgs."""
    monkeypatch.setattr(conversions, 'is_installed', lambda _: True)
    monkeypatch.setattr(conversions.interfaces, 'TF', interfaces.TF._replace(
        type='geometry_msgs/TransformStamped'))


@pytest.mark.parametrize('namespace, prefix', [('', ''), ('/gondola_1', 'gondola_1/')])
def test_a_pose_is_broadcast_with_its_time_in_the_frames_of_the_gondola(
        ros, with_tf2, namespace, prefix):
    transforms = Transforms(ros.node(namespace=namespace))
    transforms._message = lambda transforms: transforms[0]
    transforms.publish(11.5, 'facade', 'rail', PLACE)  # no node subscribes yet
    sent = ros.collect(ros.node('listener'), TransformStamped, '/tf', 100)
    ros.until(lambda: transforms.is_wanted, 'the listener')
    transforms.publish(12.5, 'facade', 'rail', PLACE)
    ros.until(lambda: sent, 'the transform')
    message, = sent
    assert (message.header.frame_id, message.child_frame_id) == (
        prefix + 'facade', prefix + 'rail')
    assert seconds(message.header.stamp) == 12.5
    transform = message.transform
    assert (transform.translation.x, transform.translation.y) == (0.1, 0.2)
    assert transform.rotation.z == pytest.approx(0.479425538604203)


def test_without_tf2_msgs_nothing_is_broadcast(ros, monkeypatch):
    monkeypatch.setattr(conversions, 'is_installed', lambda _: False)
    node = ros.node()
    Transforms(node).publish(0.0, 'facade', 'rail', PLACE)
    assert '/tf' not in {one.topic_name for one in node.publishers}
