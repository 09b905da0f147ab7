"""Messages that several nodes publish: stamped poses, and facade → rail on /tf."""

from types import SimpleNamespace

from geometry_msgs.msg import TransformStamped
import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes import conversions
from facade_manipulator.nodes.conversions import FacadeTransform, pose_stamped
from facade_manipulator.nodes.messages import planar_pose, seconds


def test_stamped_pose_has_frame_and_stamp():
    message = pose_stamped('rail', 12.5, Pose(1.0, 2.0, 0.0))
    assert (message.header.frame_id, seconds(message.header.stamp)) == ('rail', 12.5)
    assert planar_pose(message.pose, 'pose') == (1.0, 2.0, 0.0)


@pytest.mark.parametrize('namespace, prefix', [('', ''), ('/gondola_1', 'gondola_1/')])
def test_disturbance_is_broadcast_in_frames_of_the_namespace(
        ros, monkeypatch, namespace, prefix):
    """No wheel has tf2_msgs: a single transform replaces its message."""
    node = ros.node(namespace=namespace)
    FacadeTransform(node).publish(0.0, Pose(0.0, 0.0, 0.0))
    assert '/tf' not in {one.topic_name for one in node.publishers}
    monkeypatch.setattr(conversions, 'import_module', lambda _: SimpleNamespace(
        TFMessage=TransformStamped))
    transform = FacadeTransform(node)
    transform._message = lambda transforms: transforms[0]
    sent = ros.collect(ros.node('listener'), TransformStamped, '/tf', 100)
    ros.until(lambda: transform.publish(12.5, Pose(0.1, 0.2, 1.0)) or sent, 'the transform')
    header, child = sent[0].header, sent[0].child_frame_id
    assert (header.frame_id, child, seconds(header.stamp)) == (
        prefix + 'facade', prefix + 'rail', 12.5)
    translation, rotation = sent[0].transform.translation, sent[0].transform.rotation
    assert (translation.x, translation.y) == (0.1, 0.2)
    assert rotation.z == pytest.approx(0.479425538604203)
