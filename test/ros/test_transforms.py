"""Transforms: broadcast where tf2_ros is installed, in the frames of the gondola; else none."""

import sys
from types import SimpleNamespace

import pytest

from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import seconds
from facade_manipulator.ros.conversions import Transforms


@pytest.mark.parametrize('namespace, prefix', [('', ''), ('/gondola_1', 'gondola_1/')])
def test_a_pose_is_broadcast_with_its_time_in_the_frames_of_the_gondola(
        ros, monkeypatch, namespace, prefix):
    sent = []
    monkeypatch.setitem(sys.modules, 'tf2_ros', SimpleNamespace(
        TransformBroadcaster=lambda node: SimpleNamespace(sendTransform=sent.append)))
    Transforms(ros.node(namespace=namespace), 'facade', 'rail').publish(
        12.5, Pose(0.1, 0.2, 1.0))
    message, = sent
    assert (message.header.frame_id, message.child_frame_id) == (
        prefix + 'facade', prefix + 'rail')
    assert seconds(message.header.stamp) == 12.5
    transform = message.transform
    assert (transform.translation.x, transform.translation.y) == (0.1, 0.2)
    assert transform.rotation.z == pytest.approx(0.479425538604203)


def test_without_tf2_ros_nothing_is_broadcast(ros, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_ros', None)
    Transforms(ros.node(), 'facade', 'rail').publish(0.0, Pose(0.0, 0.0, 0.0))
