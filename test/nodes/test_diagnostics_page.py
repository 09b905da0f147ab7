"""docs/diagnostics.md and reference.md list exactly the keys that a running stack publishes."""

from pathlib import Path
import re

from nav_msgs.srv import GetPlan
from nodes.node_rig import NodeBench, NODES, parameters_of
import pytest

from facade_manipulator import topics
from facade_manipulator.kinematics import Pose
from facade_manipulator.nodes.conversions import pose_stamped
from facade_manipulator.nodes.planar_messages import status_values

DOCS = Path(__file__).parents[2] / 'docs'
PAGE = DOCS / 'diagnostics.md'
PARAMETERS = {
    'driver': {'simulate_drives': True},
    'compensator': {'contact.enabled': True},
}


def sections() -> dict[str, dict[str, str]]:
    """Return the meanings by component and key; the component '' has the keys of every node."""
    found = {}
    for part in PAGE.read_text().split('\n## '):
        name = part.partition('\n')[0]
        meanings = {}
        for keys, meaning in re.findall(r'^\| (`.*`) \| (.*) \| .* \|$', part, re.M):
            for key in re.findall('`([^`]+)`', keys):
                meanings[key] = meaning
        found['' if name.startswith('#') else name] = meanings
    return found


def matching(name: str, patterns) -> str | None:
    """Return the pattern that matches a name; * in a pattern is any text."""
    for one in patterns:
        if re.fullmatch(re.escape(one).replace(r'\*', '.+'), name):
            return one
    return None


def is_published(pattern: str, keys) -> bool:
    """Return whether a key that matches a pattern is published."""
    return any(matching(key, [pattern]) for key in keys)


@pytest.fixture
def published(ros):
    """Return the keys of each component of a running stack."""
    for name, make in NODES.items():
        overrides = parameters_of(PARAMETERS.get(name, {}))
        ros.add(make(parameter_overrides=overrides))
    messages = ros.collect(ros.node(), *topics.DIAGNOSTICS[:2], 100)

    def reporting_nodes():
        return {one.status[0].name.partition(':')[0] for one in messages}

    ros.until(lambda: reporting_nodes() == NODES.keys(), 'all nodes')
    keys = {}
    for message in messages:
        for status in message.status:
            keys[status.name] = {*status_values(status)}
    return keys


def test_diagnostics_page_lists_exactly_the_published_keys(published):
    page = sections()
    every_node = page.pop('')
    for component, keys in published.items():
        section = matching(component, page)
        assert section, f'next: add {component} to docs/diagnostics.md'
        known = [*page[section], *every_node]
        unknown = {key for key in keys if not matching(key, known)}
        assert not unknown, (
            f'next: add these keys to {component} in docs/diagnostics.md'
        )
        meanings = page[section]
        required = {key for key in meanings if not meanings[key].startswith('only')}
        missing = {pattern for pattern in required if not is_published(pattern, keys)}
        assert not missing, (
            f'{component}: next: remove these keys from docs/diagnostics.md, or begin their '
            'meaning with only'
        )
    assert {matching(component, page) for component in published} == page.keys()


def keys_on_page(topic) -> set[str]:
    """Return the keys that the row of a status topic in docs/reference.md lists."""
    lines = (DOCS / 'reference.md').read_text().splitlines()
    row, *_ = [line for line in lines if line.startswith(f'| `{topic.name}`')]
    values = row.partition('Values: ')[2].partition('Level 1')[0]
    return {*re.findall('`([^`]+)`', values)} - {'followed', 'nan', 'inf'}


def published_keys(bench, topic) -> set[str]:
    """Return the keys of all messages received on a status topic."""
    messages = bench.collect(topic)
    bench.ros.until(lambda: messages, topic.name)
    found = set()
    for message in messages:
        found.update(status_values(message))
    return found


def test_reference_page_lists_exactly_the_keys_of_goal_status(ros):
    bench = NodeBench(ros, NODES['compensator'], {'contact.enabled': True})
    messages = bench.collect(topics.GOAL_STATUS)

    def keys():
        found = set()
        for message in messages:
            found.update(status_values(message))
        return found

    # the second goal is outside the workspace
    for x, key in ((0.0, 'followed x [mm]'), (9.0, 'rejection')):
        goal = pose_stamped('facade', bench.now(), Pose(x, 0.25, 0.0))
        bench.publish(topics.GOAL_POSE, goal)
        ros.until(lambda key=key: key in keys(), key)
    assert keys() == keys_on_page(topics.GOAL_STATUS)


def test_reference_page_lists_exactly_the_keys_of_driver_status(ros):
    bench = NodeBench(ros, NODES['driver'], {'simulate_drives': True})
    assert published_keys(bench, topics.DRIVER_STATUS) == keys_on_page(
        topics.DRIVER_STATUS
    )


def test_reference_page_lists_exactly_the_keys_of_rejections(ros):
    bench = NodeBench(ros, NODES['ik_service'])
    goal = pose_stamped('rail', bench.now(), Pose(9.0, 0.25, 0.0))
    bench.call(topics.SOLVE, GetPlan.Request(goal=goal))
    assert published_keys(bench, topics.REJECTIONS) == keys_on_page(topics.REJECTIONS)
