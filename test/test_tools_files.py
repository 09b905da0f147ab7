"""Files for other tools: layouts and the aggregator name what is published."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

from facade_manipulator import config_path, topics
from facade_manipulator.nodes.messages import CARRIAGES
from facade_manipulator.parameters import NODES

SHOWN_IN_3D = {f'/{one.name}' for one in (topics.GOAL_POSE, topics.ROBOT_DESCRIPTION)}
TYPES = {f"/{one.name.lstrip('/')}": one.type
         for one in vars(topics).values() if isinstance(one, topics.Topic)}


def require_field(topic: str, path: list[str]) -> None:
    """Raise unless a message of the topic has a field."""
    value = TYPES[topic]()
    for name in path:
        value = getattr(value, name)


def test_foxglove_layout_shows_published_fields():
    layout = json.loads(config_path('foxglove.json').read_text())
    panels = layout['configById']
    shown, paths = set(), []
    for panel in panels.values():
        shown |= set(panel.get('topics', ()))
        shown |= {layer['topic'] for layer in panel.get('layers', {}).values()}
        paths += [panel[key] for key in ('topicPath', 'topicToRender') if key in panel]
        paths += [path['value'] for path in panel.get('paths', ())]
    assert shown == SHOWN_IN_3D
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
            assert fields.pop(0) in CARRIAGES
        require_field(f'/{topic}', fields)
    assert all(len(splitter) == int(splitter.get('count')) == len(splitter.get('sizes').split(';'))
               for splitter in root.iter('DockSplitter'))


@pytest.mark.parametrize('node', sorted(NODES))
@pytest.mark.parametrize('namespace', ['', 'gondola_1/'])
def test_aggregator_counts_every_component_once(node, namespace):
    (content,) = yaml.safe_load(config_path('diagnostic_aggregator.yaml').read_text()).values()
    analyzers = [one for one in content['ros__parameters'].values() if isinstance(one, dict)]
    assert len({one['path'] for one in analyzers}) == len(analyzers)
    name = f'{namespace}{node}: operation'
    assert [any(part in name for part in one['contains']) for one in analyzers].count(True) == 1


def test_aggregator_ignores_nodes_that_a_machine_may_lack():
    """A stale group beside others would make the top level an error."""
    (content,) = yaml.safe_load(config_path('diagnostic_aggregator.yaml').read_text()).values()
    analyzers = {one['contains'][0].rstrip(': '): one
                 for one in content['ros__parameters'].values() if isinstance(one, dict)}
    required = {name for name, one in analyzers.items()
                if not one.get('discard_stale') and one.get('num_items') != 0}
    assert required == {'driver', 'ik_service', 'compensator'}
    lasting = {name for name, one in analyzers.items() if not one.get('discard_stale')}
    assert lasting == required | {'disturbance_estimator'}
