"""Hostile contents on each topic and service, which end no node."""

from array import array
from importlib import import_module
import math
import os
import subprocess
import sys

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from support import wait_until

PROCESSES = {  # nodes and arguments of each
    'driver': (('driver',), '--ros-args', '-p', 'simulate_drives:=true'),
    'manipulator': (('compensator', 'ik_service'),),
    'ik_service': (('ik_service',),),
    'disturbance_estimator': (('disturbance_estimator',),),
}
FOREIGN = 'another_machine/frame'
LONG = 100_000
EVERY_READER = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ENUMERATION = 99  # an undefined value
FUTURE = 2_147_483_000  # s, near the end of a stamp


def interface(name: str) -> type:
    """Return the class of a message or service, such as std_msgs/msg/Bool."""
    package, kind, name = name.split('/')
    return getattr(import_module(f'{package}.{kind}'), name)


def fill(message, number: float, text: str, length: int, seconds: int = 0):
    """Fill a message to its leaves: numbers, texts and arrays of a length."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        rest = (number, text, length, seconds)
        if kind.startswith('sequence<') and '/' in kind:
            type_name = kind[9:-1].partition(',')[0]
            part = interface(type_name.replace('/', '/msg/', 1))
            value = [fill(part(), *rest) for _ in range(3)]
        elif kind == 'builtin_interfaces/Time':
            value.sec = seconds
            value.nanosec = 4_294_967_295 if seconds else 0
        elif hasattr(value, 'get_fields_and_field_types'):
            value = fill(value, *rest)
        else:
            value = leaf(kind, value, number, text, length)
        setattr(message, name, value)
    return message


def leaf(kind: str, value, number: float, text: str, length: int):
    """Return the content of a field that is not a message."""
    if isinstance(value, array):
        element = number if value.typecode in 'df' else ENUMERATION
        return array(value.typecode, [element] * length)
    if kind.startswith('double['):
        return [number] * len(value)
    if kind.startswith('sequence<string'):
        return [text] * 3
    if isinstance(value, float):
        return number
    if isinstance(value, str):
        return text
    return ENUMERATION if kind == 'uint8' else value


REQUESTS = {
    'empty': lambda kind: kind(),
    'NaN': lambda kind: fill(kind(), math.nan, '', 3),
    'foreign frames': lambda kind: fill(kind(), 1e300, FOREIGN, 7),
    'future stamps': lambda kind: fill(kind(), 1.0, 'rail', 3, FUTURE),
    '100 kB texts': lambda kind: fill(kind(), -1.0, 'x' * LONG, 7),
    'long arrays': lambda kind: fill(kind(), -1.0, '', LONG),
}
MESSAGES = REQUESTS | {
    'malformed CDR': lambda kind: b'\x00\x01\x00\x00',
    'cut CDR': lambda kind: serialize_message(fill(kind(), 1.0, FOREIGN, 7))[:-3],
    'wrong byte order': lambda kind: (
        b'\x00\x00' + serialize_message(fill(kind(), 1.0, '', 3))[2:]
    ),
}


@pytest.fixture(params=PROCESSES)
def graph(request, ros, start_process):
    """Start nodes in a process; return their names, a hostile node, and a check of answers."""
    (names, *arguments) = PROCESSES[request.param]
    hostile = ros.node('hostile')
    process = start_process(f'facade_manipulator.nodes.{request.param}', *arguments)
    ros.until(lambda: {*names} <= {*hostile.get_node_names()}, request.param)

    def require_answers(what):
        """Return the log after the answers to a harmless request."""
        kind = interface('rcl_interfaces/srv/ListParameters')
        for name in names:
            reply = ros.call(hostile, kind, f'{name}/list_parameters', deadline=30.0)
            assert reply.result.names and process.poll() is None, what
        return process.log.read_text()

    require_answers('the start')
    yield names, hostile, require_answers
    process.terminate()
    wait_until(lambda: process.poll() is not None, 'the end of the process')
    assert process.returncode == 0, process.log.read_text()


def connected(ros, hostile, name):
    """Return publishers and clients for all subscriptions and services of a node."""

    def subscriptions():
        return hostile.get_subscriber_names_and_types_by_node(name, '/')

    def services():
        return hostile.get_service_names_and_types_by_node(name, '/')

    ros.until(lambda: name in hostile.get_node_names(), 'the node')
    ros.until(lambda: len(subscriptions()) > 1 and len(services()) > 5, 'the graph')
    publishers = []
    for topic, kinds in subscriptions():
        kind = interface(kinds[0])
        publishers.append(hostile.create_publisher(kind, topic, EVERY_READER))
    clients = []
    for service, kinds in services():
        if not kinds[0].endswith('GetTypeDescription'):  # not of this package
            clients.append(hostile.create_client(interface(kinds[0]), service))
    for publisher in publishers:
        ros.until(publisher.get_subscription_count, 'the subscriptions')
    for client in clients:
        ros.until(client.service_is_ready, 'the services')
    return publishers, clients


def test_no_message_or_request_ends_a_node(ros, graph):
    names, hostile, require_answers = graph
    publishers = []
    clients = []
    for name in names:
        publishers_of_node, clients_of_node = connected(ros, hostile, name)
        publishers += publishers_of_node
        clients += clients_of_node
    for what, content in MESSAGES.items():
        for publisher in publishers:
            publisher.publish(content(publisher.msg_type))
        assert 'Traceback' not in require_answers(what)
    for what, content in REQUESTS.items():
        for client in clients:
            client.call_async(content(client.srv_type.Request))
        require_answers(what)


def test_numpy_computes_without_threads_in_a_node():
    own = {}
    for name, text in os.environ.items():
        if name != 'OPENBLAS_NUM_THREADS':
            own[name] = text
    code = (
        'import facade_manipulator.nodes, numpy, os\n'
        'print(len(os.listdir("/proc/self/task")))'
    )
    command = [sys.executable, '-c', code]
    threads = subprocess.check_output(command, env=own, text=True)
    assert int(threads) == 1
