"""What a recorder needs of ROS."""

from __future__ import annotations

from geometry_msgs.msg import PoseStamped
import pytest

from facade_manipulator import resources
from facade_manipulator.ros import message_type


def test_a_definition_holds_all_that_the_message_contains():
    name, definition = message_type(PoseStamped)
    assert name == 'geometry_msgs/msg/PoseStamped'
    for part in ('std_msgs/Header', 'builtin_interfaces/Time', 'geometry_msgs/Quaternion'):
        assert f'MSG: {part}\n' in definition


def test_an_installation_by_pip_needs_no_environment(monkeypatch):
    expected = message_type(PoseStamped)
    (prefix, *_) = resources.installed_shares('geometry_msgs')
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    monkeypatch.setattr(resources.sys, 'prefix', str(prefix.parents[1]))
    assert message_type(PoseStamped) == expected


def test_a_package_without_definitions_is_named(monkeypatch):
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    monkeypatch.setattr(resources.sys, 'prefix', 'nowhere')
    with pytest.raises(LookupError, match='Header.msg of std_msgs is not installed'):
        message_type(PoseStamped)
