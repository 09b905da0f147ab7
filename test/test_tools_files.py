"""Topics, and the files of other tools that name them: layouts, recorder, aggregator."""

import json
from pathlib import Path
import re
import xml.etree.ElementTree as ElementTree

from rclpy.qos import ReliabilityPolicy
import yaml

from facade_manipulator import config_path, topics
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.parameters import NODES
from facade_manipulator.topics import Service, Topic

PAGE = Path(__file__).parents[1] / 'docs/reference.md'
TOPICS = [one for one in vars(topics).values() if isinstance(one, Topic)]
SERVICES = [one for one in vars(topics).values() if isinstance(one, Service)]
TYPES = {f'/{one.name.lstrip("/")}': one.type for one in TOPICS}
SHOWN_IN_3D = topics.GOAL_POSE, topics.ROBOT_DESCRIPTION
# Topics at the rate of joint_states are reliable; other reliable topics are rare or latched.
EVERY_CYCLE = (
    topics.CORRECTED_POSE,
    topics.REFERENCE,
    topics.JOINT_SETPOINTS,
    topics.JOINT_STATES,
    topics.END_EFFECTOR_POSE,
    topics.HEAD_POSE,
    topics.RAIL_POSE,
    topics.WALL_ERROR,
    topics.UNCOMPENSATED_ERROR,
    topics.CARRIAGE_FORCES,
)
RARE = (
    topics.GOAL_POSE,
    topics.MECHANISM_STATES,
    topics.SOFTWARE_STOP,
    topics.DIAGNOSTICS,
)


def read(name: str):
    return yaml.safe_load(config_path(name).read_text())


def require_field(topic: str, path: list[str]) -> None:
    """Require that a message of the topic has a field."""
    value = TYPES[topic]()
    for name in path:
        value = getattr(value, name)


def test_reference_page_lists_each_name_once_with_its_type():
    rows = re.findall(
        r'^\| `([^`]+)` \| (\w+)/(\w+) \|', PAGE.read_text(), re.MULTILINE
    )
    for one in (*TOPICS, *SERVICES):
        package = one.type.__module__.partition('.')[0]
        assert rows.count((one.name, package, one.type.__name__)) == 1, (
            f'next: write one row of docs/reference.md for {one.name}'
        )
    for kind in (TOPICS, SERVICES):
        assert len({one.name for one in kind}) == len(kind) > 0


def test_every_reliable_topic_is_fast_or_rare():
    names = set()
    for one in TOPICS:
        is_reliable = one.qos.reliability is ReliabilityPolicy.RELIABLE
        if is_reliable and not isinstance(one, topics.LatchedTopic):
            names.add(one.name)
    assert names == {one.name for one in (*EVERY_CYCLE, *RARE)}, (
        'next: add a topic of each cycle to EVERY_CYCLE and config/recording_qos.yaml, and any '
        'other topic to RARE'
    )


def test_recorder_requests_fast_topics_with_best_effort():
    overrides = read('recording_qos.yaml')
    assert overrides.keys() == {'/tf', *(f'/{topic.name}' for topic in EVERY_CYCLE)}
    for topic in EVERY_CYCLE:
        assert topic.qos.reliability is not ReliabilityPolicy.BEST_EFFORT
        assert not isinstance(topic, topics.LatchedTopic)
    for profile in overrides.values():  # rosbag2 needs the depth with the history
        assert profile == {
            'history': 'keep_last',
            'depth': 100,
            'reliability': 'best_effort',
        }


def test_rviz_file_shows_published_topics_in_frame_rail():
    manager = read('manipulator.rviz')['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'rail'
    shown = {}
    for display in manager['Displays']:
        if display['Enabled']:
            for key, topic in display.items():
                if key in ('Topic', 'Description Topic'):
                    shown[topic['Value']] = topic['Durability Policy']
    expected = {}
    for one in SHOWN_IN_3D:
        is_latched = isinstance(one, topics.LatchedTopic)
        expected[one.name] = 'Transient Local' if is_latched else 'Volatile'
    assert shown == expected


def test_foxglove_layout_shows_published_fields():
    layout = json.loads(config_path('foxglove.json').read_text())
    panels = layout['configById']
    shown = set()
    paths = []
    for panel in panels.values():
        shown |= set(panel.get('topics', ()))
        shown |= {layer['topic'] for layer in panel.get('layers', {}).values()}
        paths += [panel[key] for key in ('topicPath', 'topicToRender') if key in panel]
        paths += [path['value'] for path in panel.get('paths', ())]
    assert shown == {f'/{one.name}' for one in SHOWN_IN_3D}
    for path in paths:
        topic, *fields = re.sub(r'\[[0-2]]', '', path).split('.')
        require_field(topic, fields)
    assert set(re.findall(r'"(\w+!\w+)"', json.dumps(layout['layout']))) == set(panels)


def test_plotjuggler_layout_shows_published_fields():
    root = ElementTree.parse(config_path('plotjuggler.xml')).getroot()
    curves = [curve.get('name') for curve in root.iter('curve')]
    assert len(curves) == len(set(curves)) > 10
    for curve in curves:
        _, topic, *fields = curve.split('/')
        if topic.startswith('joint_'):
            assert fields.pop(0) in AXIS_NAMES
        require_field(f'/{topic}', fields)


def counted(analyzers, name: str) -> list[str]:
    """Return the paths of the analyzers that count a component."""
    paths = []
    for analyzer in analyzers:
        if any(part in name for part in analyzer['contains']):
            paths.append(analyzer['path'])
    return paths


def test_aggregator_counts_every_component_once():
    """A stale group of a missing optional node would make the top level an error."""
    (content,) = read('diagnostic_aggregator.yaml').values()
    analyzers = [
        one for one in content['ros__parameters'].values() if isinstance(one, dict)
    ]
    assert len({one['path'] for one in analyzers}) == len(analyzers)
    for node in NODES:
        assert len(counted(analyzers, f'{node}: operation')) == 1
        assert len(counted(analyzers, f'gondola_1/{node}: operation')) == 1
    lasting = {}
    for one in analyzers:
        if not one.get('discard_stale'):
            lasting[one['contains'][0].rstrip(': ')] = one.get('num_items')
    required = {name for name, number in lasting.items() if number != 0}
    assert required == {'driver', 'ik_service', 'compensator'}
    assert {*lasting} == required | {'disturbance_estimator'}
