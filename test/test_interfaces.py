"""One table of topics and services: what nodes declare and documents say is what stands there."""

from __future__ import annotations

import ast
from pathlib import Path
import re

from every_node import NODES
from own_processes import free_domain
import pytest
import rclpy
from rclpy.parameter import Parameter

import facade_manipulator
from facade_manipulator import interfaces
from facade_manipulator.interfaces import Service, SERVICES, Topic, TOPICS
from facade_manipulator.ros.interfaces import class_of, is_installed, profile

PACKAGE = Path(facade_manipulator.__file__).parent
DOCUMENT = PACKAGE.parent / 'docs' / 'supervisor.md'
GONDOLA = '/gondola_1'
# that the simulator publishes where its scenario has raw sensors or a wall
OF_OTHER_SCENARIOS = (
    interfaces.IMU, interfaces.RANGE_1, interfaces.RANGE_2, interfaces.FIX_X,
    interfaces.CONTACT_WRENCH, interfaces.CARRIAGE_FORCES)
STOPS = {'software_stop_topics': ['software_stop', 'watchdog/stop']}
OF_ROS = {interfaces.ROSOUT, interfaces.PARAMETER_EVENTS, interfaces.TRANSITION_EVENT}
DECLARING = {'create_publisher', 'create_subscription', 'create_service', 'create_client',
             'create_lifecycle_publisher', 'Subscription'}
ALL_OF_IT = {'driver': {'simulate_drives': True, **STOPS}}


@pytest.fixture
def context():
    """Lend ROS without a network: no test here waits for anybody."""
    with free_domain() as domain:
        rclpy.init(domain_id=domain)
        yield
        rclpy.try_shutdown()


@pytest.fixture
def node(request, context):
    """Make the node of a name, with all that it may ever do."""
    made = NODES[request.param](namespace=GONDOLA, parameter_overrides=[
        Parameter(name, value=value) for name, value in ALL_OF_IT.get(request.param, {}).items()])
    yield made
    if hasattr(made, 'close'):
        made.close()
    made.destroy_node()


def full(name: str) -> str:
    return name if name.startswith('/') else f'{GONDOLA}/{name}'


def may_subscribe(role: str, topic: Topic) -> bool:
    return role in topic.subscribers or role == interfaces.VIEWER or (
        role == 'recorder' and bool(topic.recorded))


def names_of(topic: Topic) -> list[str]:
    return STOPS.get(topic.parameter, [topic.name])


def expected(topics, depth=None) -> dict[str, tuple[type, tuple]]:
    """Return type and quality by name of the topics that this computer has the messages of."""
    return {full(name): (class_of(one), quality(profile(one.quality)))
            for one in topics if is_installed(one) for name in names_of(one)}


def quality(qos) -> tuple:
    return qos.depth, qos.reliability, qos.durability


def declared(endpoints) -> dict[str, tuple[type, tuple]]:
    return {one.topic_name: (one.msg_type, quality(one.qos_profile)) for one in endpoints
            if one.topic_name not in {full(topic.name) for topic in OF_ROS}}


@pytest.mark.parametrize('node', NODES, indirect=True)
def test_a_node_has_the_topics_of_the_table(node):
    name = node.get_name()
    own = {one for one in TOPICS if one not in OF_ROS and one != interfaces.EXECUTOR_CHECK}
    elsewhere = OF_OTHER_SCENARIOS if name == 'gondola_simulator' else ()
    assert declared(node.publishers) == expected(
        one for one in own if name in one.publishers and one not in elsewhere)
    heard = expected(one for one in own if may_subscribe(name, one))
    queues = {queue.topic for _, queue in getattr(node, '_queues', ())}
    assert declared(node.subscriptions) == {
        topic: one for topic, one in heard.items() if topic not in queues}
    assert queues <= heard.keys()


@pytest.mark.parametrize('node', NODES, indirect=True)
def test_a_node_has_the_services_of_the_table(node):
    name = node.get_name()
    for found, rows in (
            (node.services, [one for one in SERVICES if one.server == name]),
            (node.clients, [one for one in SERVICES if name in one.clients])):
        assert {one.service_name: one.srv_type for one in found} == {
            full(one.name): class_of(one) for one in rows}


def declarations(module: Path) -> set[str]:
    source = module.read_text()
    if not any(name in source for name in DECLARING):
        return set()
    return {getattr(node.func, 'attr', '') for node in ast.walk(ast.parse(source))
            if isinstance(node, ast.Call)} & DECLARING


def test_nothing_is_declared_past_the_table():
    found = {str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob('*.py')
             if declarations(path)}
    assert found == {'client.py', 'ros/interfaces.py', 'ros/rclpy_internals.py'}  # message queues


def cells(interface: Topic | Service) -> str:
    """Return what the documents say of a topic or service, but for what it is for."""
    if isinstance(interface, Service):
        return f'| `{interface.name}` | {interface.type} | '
    to = ', '.join(interface.subscribers) or 'all'
    depth, reliable, latched = interface.quality
    kind = 'latched' if latched else 'reliable' if reliable else 'best effort'
    return (f'| `{interface.name}` | {interface.type} | {", ".join(interface.publishers)} → {to} '
            f'| {kind}, {depth} | ')


@pytest.mark.skipif(not DOCUMENT.is_file(), reason='the documents stand in the source tree alone')
def test_the_documents_have_the_table():
    lines = DOCUMENT.read_text().splitlines()
    documented = {*TOPICS} - OF_ROS | {*SERVICES} - {*interfaces.OF_EVERY_NODE}
    for interface in documented:
        assert sum(line.startswith(cells(interface)) for line in lines) == 1, cells(interface)
    tables = [line for line in lines if re.match(r'\| `[^|]+` \| \w+_(msgs|srvs)/\w+ \|', line)]
    assert len(tables) == len(documented)


def test_names_stand_once_and_roles_are_known():
    for rows in (TOPICS, SERVICES):
        assert len({one.name for one in rows}) == len(rows)
    roles = {role for one in TOPICS for role in one.publishers + one.subscribers}
    roles |= {role for one in SERVICES for role in (one.server, *one.clients)}
    assert roles == {*interfaces.ROLES}
