"""Config/sros2_policy.xml allows each node exactly its topics and services."""

from fnmatch import fnmatchcase
from xml.etree import ElementTree

from nodes.node_rig import NODES
import pytest
from rclpy.parameter import Parameter

from facade_manipulator import config_path, topics
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.topics import Topic

NAMESPACE = '/gondola_1'
ROOT = ElementTree.parse(config_path('sros2_policy.xml')).getroot()
#: parameters with which a node together has all its endpoints
VARIANTS = {
    'driver': [{'simulate_drives': True}],
    'gondola_simulator': [
        {'scenario': 'breeze'},
        {'scenario': 'sensors'},
        {'scenario': 'pressing'},
    ],
}
#: nodes of the policy that are not nodes of the package
NEIGHBOURS = {
    'supervisor',
    'estimator',
    'rail_sensors',
    'force_sensor',
    'camera',
    'instrument',
    'robot_state_publisher',
    'recorder_gondola_1',
    'viewer',
}
OF_ROS = {'/rosout', '/parameter_events'}
Right = tuple[str, str, str]  # verb, kind, full name or pattern


def allowed(name: str) -> set[Right]:
    """Return the rights of a node, with wildcards."""
    (element,) = ROOT.findall(f".//profile[@node='{name}']")
    namespace = element.get('ns').rstrip('/')
    rights = set()
    for group in element:
        for verb, value in group.attrib.items():
            if value == 'ALLOW':
                for one in group:
                    is_absolute = one.text.startswith('/')
                    path = one.text if is_absolute else f'{namespace}/{one.text}'
                    rights.add((verb, one.tag, path))
    return rights


def matches(right: Right, rule: Right) -> bool:
    return right[:2] == rule[:2] and fnmatchcase(right[2], rule[2])


def make_node(ros, name: str, parameters: dict[str, object]):
    """Return a node of the package with the given parameters."""
    overrides = [Parameter(key, value=value) for key, value in parameters.items()]
    return ros.add(NODES[name](namespace=NAMESPACE, parameter_overrides=overrides))


def endpoints(node) -> set[Right]:
    """Return the rights that a node needs."""
    rights = {('publish', 'topic', '/rosout')}  # endpoint of rcl
    for one in node.publishers:
        rights.add(('publish', 'topic', one.topic_name))
    for one in node.subscriptions:
        rights.add(('subscribe', 'topic', one.topic_name))
    for one in node.services:
        rights.add(('reply', 'service', one.service_name))
    for one in node.clients:
        rights.add(('request', 'service', one.service_name))
    return rights


def is_allowed(right: Right, rules: set[Right]) -> bool:
    return any(matches(right, rule) for rule in rules)


def is_needed(rule: Right, needed: set[Right]) -> bool:
    return any(matches(right, rule) for right in needed)


@pytest.mark.parametrize('name', NODES)
def test_policy_allows_a_node_exactly_its_endpoints(ros, name):
    needed = set()
    for parameters in VARIANTS.get(name, [{}]):
        needed |= endpoints(make_node(ros, name, parameters))
    rules = allowed(name)
    assert not {right for right in needed if not is_allowed(right, rules)}
    optional = {('publish', 'topic', '/tf')}
    assert not {rule for rule in rules - optional if not is_needed(rule, needed)}


def test_policy_contains_all_nodes_and_their_neighbours():
    profiles = [one.get('node') for one in ROOT.iter('profile')]
    assert sorted(profiles) == sorted({*NODES} | NEIGHBOURS)


@pytest.mark.usefixtures('ros')
def test_policy_allows_a_client_its_endpoints():
    rules = allowed('supervisor')
    with ManipulatorClient(NAMESPACE) as client:
        needed = endpoints(client.node)
    assert ('subscribe', 'topic', f'{NAMESPACE}/driver/status') in needed
    assert not {right for right in needed if not is_allowed(right, rules)}


@pytest.mark.parametrize('observer', ['recorder_gondola_1', 'viewer'])
def test_observer_may_read_everything_but_command_nothing(observer):
    rules = allowed(observer)
    for one in vars(topics).values():
        if isinstance(one, Topic):
            name = one.name if one.name.startswith('/') else f'{NAMESPACE}/{one.name}'
            assert any(matches(('subscribe', 'topic', name), rule) for rule in rules), (
                name
            )
    assert {name for verb, kind, name in rules if verb == 'publish'} - {
        '/events/write_split'
    } == OF_ROS
    assert not [rule for rule in rules if rule[0] == 'request']


def test_compensator_and_ik_service_share_an_enclave():
    paths = {}
    for enclave in ROOT.iter('enclave'):
        for one in enclave.iter('profile'):
            paths[one.get('node')] = enclave.get('path')
    assert (
        paths.pop('compensator')
        == paths.pop('ik_service')
        == f'{NAMESPACE}/manipulator'
    )
    assert paths.pop('recorder_gondola_1') == f'{NAMESPACE}/recorder'
    assert paths == {name: f'{NAMESPACE}/{name}' for name in paths}
