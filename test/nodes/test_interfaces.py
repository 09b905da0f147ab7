"""Documents, recorder and SROS2 policy name the same topics: checked without nodes or a graph."""

from __future__ import annotations

from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

import pytest

import facade_manipulator
from facade_manipulator import config_path
from facade_manipulator.nodes.recorder import TOPICS

DOCUMENT = Path(facade_manipulator.__file__).parents[1] / 'docs' / 'supervisor.md'
if not DOCUMENT.is_file():
    pytest.skip('the documents stand in the source tree alone', allow_module_level=True)
TYPES = dict(re.findall(r'^\| `([\w/]+)` \| (\w+_msgs/\w+) \|',
                        DOCUMENT.read_text().partition('## Services')[0], re.MULTILINE))
CHECK = {'executor_check/message'}  # of the executor, at the start
OF_ROS = {'/rosout', '/parameter_events', '/tf'}
DRAWN = {'ik_service/linkage'}  # is made of what is recorded


def policy(node: str, what: str) -> set[str]:
    """Return the topics that a node's profile allows."""
    root = ElementTree.parse(config_path('sros2/gondola_1.policy.xml')).getroot()
    profile, = (item for item in root.iter('profile') if item.get('node') == node)
    return {topic.text.replace('~', node) for group in profile.findall('topics')
            if group.get(what) == 'ALLOW' for topic in group}


def test_every_documented_topic_is_recorded_with_its_type():
    recorded = {topic: f'{kind.__module__.partition(".")[0]}/{kind.__name__}'
                for topic, (kind, _) in TOPICS.items() if topic not in OF_ROS}
    assert recorded == {topic: kind for topic, kind in TYPES.items() if topic not in DRAWN}


def test_the_recorder_may_hear_what_it_records():
    assert policy('recorder', 'subscribe') - OF_ROS - CHECK == TOPICS.keys() - OF_ROS


@pytest.mark.parametrize('node', ['driver', 'compensator', 'ik_service'])
@pytest.mark.parametrize('what', ['publish', 'subscribe'])
def test_what_a_node_may_say_or_hear_is_documented(node, what):
    own = {f'{node}/transition_event'}  # of rclpy's life cycle
    assert policy(node, what) - OF_ROS - CHECK - own <= TYPES.keys()
