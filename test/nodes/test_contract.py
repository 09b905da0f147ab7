"""Nothing that comes over the graph ends a node: each subscription and service, each content."""

from __future__ import annotations

from array import array
from importlib import import_module
import math
import os
import subprocess
import sys

from every_node import NODES
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from facade_manipulator.interfaces import EXECUTOR_CHECK, TOPICS
from facade_manipulator.ros.interfaces import is_installed

SIMULATED = {'driver': {'parameter_overrides': [Parameter('simulate_drives', value=True)]}}
FOREIGN = 'another says that'
LONG = 100_000
PARTNERS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # suits every reader


def interface(name: str) -> type:
    """Return the class of a message or service, such as std_msgs/msg/Bool."""
    package, kind, name = name.split('/')
    return getattr(import_module(f'{package}.{kind}'), name)


def filled(value, number: float, text: str, length: int):
    """Return what a field of a message becomes: numbers, texts and arrays as long as may be."""
    if isinstance(value, bool) or isinstance(value, bytes):
        return value
    if isinstance(value, float):
        return number
    if isinstance(value, str):
        return text
    if isinstance(value, array):
        return array(value.typecode, [number if value.typecode in 'df' else 99] * length)
    if hasattr(value, 'get_fields_and_field_types'):
        return fill(value, number, text, length)
    return value


def fill(message, number: float, text: str, length: int):
    """Fill a message to its leaves; unbounded lists of messages get a few elements."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if kind.startswith('sequence<') and '/' in kind:
            part = interface(kind[9:-1].partition(',')[0].replace('/', '/msg/', 1))
            setattr(message, name, [fill(part(), number, text, length) for _ in range(3)])
        elif kind.startswith('sequence<string'):
            setattr(message, name, [text] * 3)
        elif kind == 'sequence<double>':
            setattr(message, name, array('d', [number] * length))
        elif kind == 'uint8':
            setattr(message, name, 99)
        elif kind.startswith('double['):
            setattr(message, name, [number] * len(value))
        else:
            setattr(message, name, filled(value, number, text, length))
    return message


CONTENTS = {
    'empty': lambda kind: kind(),
    'malformed': lambda kind: b'\x00\x01\x00\x00',
    'cut': lambda kind: serialize_message(fill(kind(), 1.0, FOREIGN, 7))[:-3],
    'not finite': lambda kind: fill(kind(), math.nan, '', 3),
    'foreign': lambda kind: fill(kind(), 1e300, FOREIGN, 7),
    'huge': lambda kind: fill(kind(), -1.0, 'x' * LONG, LONG),
}


@pytest.fixture
def nodes(ros):
    """Return all nodes in this process, where what a callback raises ends the test."""
    return [ros.add(make(**SIMULATED.get(name, {}))) for name, make in NODES.items()]


def is_alive(ros, tester, node) -> bool:
    """Let a node answer for itself, after all that was sent to it before."""
    kind = interface('rcl_interfaces/srv/ListParameters')
    return bool(ros.call(tester, kind, f'{node.get_name()}/list_parameters').result.names)


@pytest.mark.quick
def test_no_message_ends_a_node(ros, nodes):
    tester = ros.node()
    topics = {topic: interface(kind) for node in nodes for topic, (kind, *_) in (
        node.get_subscriber_names_and_types_by_node(node.get_name(), '/'))}
    assert {topic.removeprefix('/') for topic in topics} >= {
        one.name.removeprefix('/') for one in TOPICS
        if is_installed(one) and one is not EXECUTOR_CHECK
        and {*one.subscribers} & {*NODES}}
    publishers = {topic: tester.create_publisher(kind, topic, PARTNERS)
                  for topic, kind in topics.items()}
    ros.until(lambda: all(0 < tester.count_subscribers(topic) <= one.get_subscription_count()
                          for topic, one in publishers.items()), 'all who subscribe')
    for name, content in CONTENTS.items():
        for topic, kind in topics.items():
            publishers[topic].publish(content(kind))
        assert all(is_alive(ros, tester, node) for node in nodes), name


def test_no_request_ends_a_node(ros, nodes):
    tester = ros.node()
    services = {service: interface(kind) for node in nodes for service, (kind, *_) in (
        node.get_service_names_and_types_by_node(node.get_name(), '/'))
        if not kind.endswith('GetTypeDescription')}  # rclpy's own, which answers no empty one
    assert len(services) > 30
    for name in ('empty', 'not finite', 'foreign', 'huge'):
        for service, kind in services.items():
            ros.call(tester, kind, service, CONTENTS[name](kind.Request), deadline=30.0)
        assert all(is_alive(ros, tester, node) for node in nodes), name


def test_numpy_computes_without_threads_in_a_node():
    own = {name: text for name, text in os.environ.items() if name != 'OPENBLAS_NUM_THREADS'}
    threads = subprocess.check_output(
        [sys.executable, '-c', 'import facade_manipulator.nodes, numpy, os\n'
         'print(len(os.listdir("/proc/self/task")))'], env=own, text=True)
    assert int(threads) == 1
