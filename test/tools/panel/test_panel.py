"""The program: it listens to the graph, says nothing there, and serves what came."""

from __future__ import annotations

import json
import signal
import socket
from urllib.request import urlopen

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from qualities import RELIABLE

from facade_manipulator.ros.client import COMPONENTS, GONDOLAS, LONGEST, ManipulatorClient
from facade_manipulator.ros.diagnostics import diagnostic_status
from facade_manipulator.tools.panel.__main__ import main


def status(name, message='active'):
    return diagnostic_status(name, 'ok', message, {'state': message})


def test_what_is_published_is_served_and_nothing_is_published(ros, start_process):
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    process = start_process('facade_manipulator.tools.panel', '--port', str(port))
    ros.until(lambda: f'panel: http://127.0.0.1:{port}/' in process.log.read_text(), 'the panel')
    tester = ros.node('tester')
    diagnostics = tester.create_publisher(DiagnosticArray, '/diagnostics', RELIABLE)
    with urlopen(f'http://127.0.0.1:{port}/events', timeout=20.0) as events:
        def is_shown():
            diagnostics.publish(DiagnosticArray(status=[
                status('a/driver: operation'), status('no name/driver: operation')]))
            line = events.readline()
            return line.startswith(b'data: ') and {'a: active', 'no name: active'} <= {
                one['title']['text'] for one in json.loads(line[6:]).get('gondolas', ())}
        ros.until(is_shown, 'both gondolas')
    publishes = dict(tester.get_publisher_names_and_types_by_node('panel', '/'))
    assert publishes.keys() == {'/parameter_events'}  # which rclpy has of every node
    services = dict(tester.get_service_names_and_types_by_node('panel', '/'))
    assert not any('parameter' in name for name in services)
    process.send_signal(signal.SIGTERM)
    assert process.wait(20.0) == 0


@pytest.mark.parametrize('port', ['-1', '65536'])
def test_a_port_that_there_is_not_is_a_sentence(port, capsys):
    with pytest.raises(SystemExit, match='2'):
        main(['--port', port])
    assert f'--port {port} is not within 0 to 65535' in capsys.readouterr().err


def test_a_hostile_graph_fills_no_memory(ros):
    with ManipulatorClient() as client:
        publisher = ros.node('hostile').create_publisher(
            DiagnosticArray, '/diagnostics', RELIABLE)
        ros.until(publisher.get_subscription_count, 'the client')
        for many in (
            [status(f'g{k}/driver: operation') for k in range(5 * GONDOLAS)],
            [status(f'g/part {k}') for k in range(5 * COMPONENTS)],
            [status('long/driver: operation', 'x' * (LONGEST + 1)), status('last/one')],
        ):
            publisher.publish(DiagnosticArray(status=many))

        def has_come():
            client.spin(0.02)
            return 'last' in client.gondolas
        ros.until(has_come, 'the last message')
        assert len(client.gondolas) == GONDOLAS and len(client.gondolas['g']) == COMPONENTS
        assert f'part {5 * COMPONENTS - 1}' in client.gondolas['g']
        assert 'long' not in client.gondolas
