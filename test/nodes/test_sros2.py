"""The SROS2 policies allow each node what it does and no more."""

from __future__ import annotations

from functools import partial
import re
import sys
from types import SimpleNamespace
from typing import ClassVar
import xml.etree.ElementTree as ElementTree

from geometry_msgs.msg import TransformStamped
from loop_bench import LoopThread
import pytest
from rclpy import experimental
from rclpy.parameter import Parameter

from facade_manipulator import config_path
from facade_manipulator.nodes.compensator import CompensatorNode
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.ik_service import IkServiceNode
from facade_manipulator.nodes.monitor import Observer
from facade_manipulator.nodes.recorder import RecorderNode, TOPICS
from facade_manipulator.ros import runtime
from facade_manipulator.ros.client import ManipulatorClient

NAMESPACE = '/gondola_1'
CHECK = f'{NAMESPACE}/executor_check/message'  # before a node spins: no longer in the graph
NODES = {'driver': partial(DriverNode, LoopThread), 'compensator': CompensatorNode,
         'ik_service': IkServiceNode, 'recorder': RecorderNode}
OVERRIDES = {'driver': [Parameter('bus.interface', value='virtual')]}
KINDS = {
    ('topics', 'publish'): 'get_publisher_names_and_types_by_node',
    ('topics', 'subscribe'): 'get_subscriber_names_and_types_by_node',
    ('services', 'reply'): 'get_service_names_and_types_by_node',
    ('services', 'request'): 'get_client_names_and_types_by_node',
}
POLICY = ElementTree.parse(config_path('sros2/gondola_1.policy.xml')).getroot()


def named(node: str, tag: str, what: str) -> set[str]:
    """Return the full names in a node's profile."""
    profile, = (item for item in POLICY.iter('profile') if item.get('node') == node)
    assert profile.get('ns') == NAMESPACE
    names = [name.text for group in profile.findall(tag) if group.get(what) == 'ALLOW'
             for name in group]
    assert len(names) == len(set(names))
    names = [name.replace('~', node) for name in names]
    return {name if name.startswith('/') else f'{NAMESPACE}/{name}' for name in names}


def allowed(node: str, tag: str, what: str) -> set[str]:
    """Return the full names that a node's profile allows while it spins."""
    without_tf2 = {'/tf'} - set(TOPICS) if (node, what) == ('recorder', 'subscribe') else set()
    return named(node, tag, what) - without_tf2 - {CHECK}


def used(node, name: str, method: str) -> set[str]:
    return {topic for topic, _ in getattr(node, method)(name, NAMESPACE)}


@pytest.fixture
def with_tf2(monkeypatch):
    """Let nodes find a tf2_ros, which no wheel has."""
    monkeypatch.setitem(sys.modules, 'tf2_ros', SimpleNamespace(
        TransformBroadcaster=lambda node: node.create_publisher(TransformStamped, '/tf', 100)))


@pytest.mark.parametrize('name', NODES)
def test_a_nodes_profile_is_what_the_node_does(ros, name, with_tf2):
    node = ros.add(NODES[name](
        namespace=NAMESPACE, parameter_overrides=OVERRIDES.get(name, [])))
    if name == 'ik_service':
        node._linkage._open()  # as when somebody looks
    for (tag, what), method in KINDS.items():
        ros.until(lambda t=tag, w=what, m=method: used(node, name, m) == allowed(name, t, w),
                  f'{what}: {used(node, name, method) ^ allowed(name, tag, what)}', 3.0)


@pytest.mark.parametrize('name, look', [('supervisor', id), ('monitor', Observer)])
def test_supervisor_and_monitor_do_no_more_than_they_may(ros, name, look):
    client = ManipulatorClient(NAMESPACE, name)
    look(client)
    try:
        for what in ('publish', 'subscribe'):
            own = {topic for topic in used(client.node, name, KINDS['topics', what])
                   if not topic.startswith(NAMESPACE + '/' + name)}
            assert own and own <= allowed(name, 'topics', what)
        offered = used(client.node, name, KINDS['services', 'reply'])
        assert offered == allowed(name, 'services', 'reply')
    finally:
        client.close()


class NamesTopics:
    """An executor that notes what a node it is checked with publishes and subscribes to."""

    topics: ClassVar[dict[str, set[str]]] = {}

    def add_node(self, node):
        for what, items in (('publish', node.publishers), ('subscribe', node.subscriptions)):
            self.topics[what] = {item.topic_name for item in items}

    def remove_node(self, _):
        pass

    def spin_once(self, timeout_sec):
        pass


def test_policies_allow_the_check_of_the_executor_to_who_runs_it(ros, monkeypatch):
    monkeypatch.setattr(experimental, 'EventsExecutor', NamesTopics)
    monkeypatch.setattr(runtime, 'CHECK_TIMEOUT', 0.0)
    runtime.choose_executor(NAMESPACE)
    for node in ('compensator', 'recorder'):
        for what, topics in NamesTopics.topics.items():
            assert CHECK in topics and topics <= allowed(node, 'topics', what) | {CHECK}
            assert CHECK in named(node, 'topics', what)


@pytest.mark.parametrize('unit', ['driver', 'manipulator', 'recorder'])
def test_each_service_has_the_enclave_of_a_policy(unit):
    text = config_path(f'deploy/systemd/facade-{unit}@.service').read_text('utf-8')
    enclave = re.search(r'--enclave (\S+)', text)[1].replace('%i', NAMESPACE.strip('/'))
    assert enclave in {item.get('path') for item in POLICY.iter('enclave')}


@pytest.mark.parametrize('node', ['supervisor', 'recorder', 'monitor'])
def test_who_watches_may_read_the_drivers_status(node):
    assert f'{NAMESPACE}/driver/status' in allowed(node, 'topics', 'subscribe')


def test_only_ik_service_sends_setpoints_and_only_the_supervisor_powers_the_drives():
    def profiles_with(tag, what, name):
        return {profile.get('node') for profile in POLICY.iter('profile')
                if f'{NAMESPACE}/{name}' in allowed(profile.get('node'), tag, what)}
    assert profiles_with('topics', 'publish', 'joint_setpoints') == {'ik_service'}
    assert profiles_with('services', 'request', 'driver/change_state') == {'supervisor'}
    assert profiles_with('services', 'request', 'driver/set_parameters') == set()
    assert profiles_with('services', 'request', 'driver/home') == {'supervisor'}
