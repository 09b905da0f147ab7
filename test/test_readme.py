"""The README's tables and examples are those of the code."""

from __future__ import annotations

from pathlib import Path
import re

import pytest
from rclpy.parameter import Parameter

import facade_manipulator
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.ik_service import IkServiceNode

ROOT = Path(facade_manipulator.__file__).parents[1]
README = ROOT / 'README.md'
INNER = ('parameter', '/rosout', 'get_type_description')

if not README.is_file():
    pytest.skip('the README stands in the source tree alone', allow_module_level=True)
TEXT = README.read_text()


def rows(head: str) -> list[list[str]]:
    """Return the cells of the table whose head begins so."""
    body = re.search(rf'\n\| {head} .*\n\|[-|]+\n((?:\|.*\n)+)', TEXT).group(1)
    return [[cell.strip() for cell in line.strip('|').split(' | ')]
            for line in body.splitlines()]


def names(cell: str) -> list[str]:
    return re.findall('`([^`]+)`', cell)


@pytest.fixture
def graph(ros):
    """Return names and types of all topics and services of the nodes in the gondola."""
    virtual = [Parameter('bus.interface', value='virtual')]
    nodes = [ros.add(DriverNode(parameter_overrides=virtual)), ros.add(CompensatorNode()),
             ros.add(IkServiceNode())]
    nodes[-1]._linkage._open()

    def seen(kind):
        return {name: types[0].replace('/msg/', '/').replace('/srv/', '/')
                for node in nodes for name, types in getattr(
                    node, f'get_{kind}_names_and_types_by_node')(node.get_name(), '/')}

    ros.until(lambda: '/ik_service/linkage' in seen('publisher'), 'the graph')
    return {**seen('publisher'), **seen('subscriber')}, seen('service')


def test_every_topic_of_the_nodes_stands_in_the_readme_with_its_type(graph):
    topics, _ = graph
    documented = {f'/{names(row[0])[0].lstrip("/")}': row[1] for row in rows('topic')}
    own = {name: kind for name, kind in topics.items()
           if not any(word in name for word in (*INNER, 'transition_event'))}
    assert documented == own


def test_every_service_of_the_nodes_stands_in_the_readme(graph):
    _, services = graph
    own = {name for name, kind in services.items()
           if not any(word in name for word in INNER) and 'lifecycle' not in kind}
    documented = {f'/{name}' for row in rows('service') for name in names(row[0])}
    assert documented - {'/driver/change_state'} == own


def test_every_executable_stands_in_the_readme():
    setup = (ROOT / 'setup.py').read_text()
    nodes = set(re.findall(r"'(\w+)'", re.search(r'NODES = \(([^)]*)\)', setup).group(1)))
    documented = [names(row[0]) for row in rows('executable')]
    assert {name for cell in documented for name in cell} >= (
        nodes - {'compensator', 'ik_service'}) | {'workspace_study'}


@pytest.mark.parametrize('number', range(TEXT.count('```python')))
def test_every_python_example_is_python_and_those_without_ros_run(number):
    example = re.findall(r'```python\n(.*?)```', TEXT, re.DOTALL)[number]
    code = compile(example, f'README example {number}', 'exec')
    if 'rclpy' not in example:
        exec(code, {})


def test_every_file_that_the_readme_names_exists():
    linked = re.findall(r'\]\(([^)#:]+)\)', TEXT)
    named = re.findall(r'`(config/[\w./]+|launch/[\w./]+)`', TEXT)
    missing = [name for name in (*linked, *named) if not (ROOT / name).exists()]
    assert not missing
