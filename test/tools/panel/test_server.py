"""Who may look, what is to be had, and what a browser cannot do."""

from __future__ import annotations

import base64
import http.client
import json
import socket
import time

from hypothesis import given
from hypothesis import strategies as st
from panel_bench import panel_bench
import pytest
from support import wait_until

from facade_manipulator.errors import ParameterError
from facade_manipulator.tools.panel.server import Access, MOST_VIEWERS
from facade_manipulator.tools.panel.view import recordings

TOKEN = 'correct horse battery'
FILE = 'blackbox_000007_g_20261123T070000Z.mcap'
pytestmark = pytest.mark.realtime


@pytest.fixture
def bench(tmp_path):
    folder = tmp_path / 'files'
    folder.mkdir()
    (folder / FILE).write_bytes(b'recorded')
    (tmp_path / 'secret').write_text('secret')
    (folder / 'blackbox_link.mcap').symlink_to(tmp_path / 'secret')
    with panel_bench(folder) as made:
        yield made


def ask(bench, path, method='GET', **headers):
    connection = http.client.HTTPConnection('127.0.0.1', bench.port, timeout=10.0)
    try:
        connection.request(method, path, headers=headers)
        response = connection.getresponse()
        return response.status, response.headers, response.read()
    finally:
        connection.close()


def basic(token, encoding='utf-8'):
    return 'Basic ' + base64.b64encode(f'me:{token}'.encode(encoding)).decode()


def events(bench, count):
    """Return the first events that a browser receives."""
    connection = http.client.HTTPConnection('127.0.0.1', bench.port, timeout=10.0)
    connection.request('GET', '/events')
    response = connection.getresponse()
    if response.status != 200:
        connection.close()
        return response.status
    found = []
    while len(found) < count:
        line = response.readline().decode().strip()
        found += [json.loads(line[6:])] if line.startswith('data: ') else []
    connection.close()
    return found


@pytest.mark.parametrize('path', ['/', '/panel.js', '/panel.css', '/events/none'])
def test_every_answer_forbids_what_the_page_does_not_need(bench, path):
    _, headers, _ = ask(bench, path)
    assert "default-src 'none'" in headers['Content-Security-Policy']
    assert 'unsafe' not in headers['Content-Security-Policy']
    assert headers['X-Content-Type-Options'] == 'nosniff'


@pytest.mark.parametrize('method', ['POST', 'PUT', 'DELETE', 'PATCH', 'OPTIONS'])
def test_there_is_nothing_to_send(bench, method):
    assert {ask(bench, path, method)[0] for path in ('/', '/events', f'/files/{FILE}')} == {405}


def test_a_file_of_the_black_box_is_sent_as_it_is(bench):
    status, headers, body = ask(bench, f'/files/{FILE}')
    assert (status, body) == (200, b'recorded')
    assert headers['Content-Disposition'] == f'attachment; filename="{FILE}"'


@pytest.mark.parametrize('name', [
    '../secret', '..%2Fsecret', '%2e%2e/secret', '%2e%2e%2fsecret', '....//secret', '%00',
    'blackbox_link.mcap', f'./../files/{FILE}', '/etc/passwd', '%2Fetc%2Fpasswd', ''])
def test_no_other_file_is_sent(bench, name):
    assert ask(bench, f'/files/{name}')[0] in (400, 403, 404)


@given(st.text())
def test_no_name_but_of_a_recording_leads_to_a_file(tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp()
    (folder / FILE).touch()
    assert (name in recordings(folder)) is (name == FILE)


def test_who_comes_has_the_last_minute_then_views(bench):
    past, view = events(bench, 2)
    assert len(past['gondola_1']) >= 1 and view['gondolas'][0]['title']['text'] == (
        'gondola_1: active')


def test_more_browsers_than_the_bound_are_told_so_and_one_that_leaves_makes_room(bench):
    held = []
    try:
        for _ in range(MOST_VIEWERS):
            held.append(socket.create_connection(('127.0.0.1', bench.port), timeout=10.0))
            held[-1].sendall(b'GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n')
            assert b'200 OK' in held[-1].recv(100)
        assert events(bench, 1) == 503
        held.pop().close()
        end = time.monotonic() + 20.0
        while events(bench, 1) == 503:
            assert time.monotonic() < end, 'nobody made room'
    finally:
        for one in held:
            one.close()


def test_a_browser_that_takes_nothing_is_left_and_one_that_takes_all_is_not(bench, monkeypatch):
    monkeypatch.setattr('facade_manipulator.tools.panel.server.PATIENCE', 0.3)
    bench.doctor = [('long', 'x' * 500_000)]  # more than the kernel keeps, within seconds
    with socket.create_connection(('127.0.0.1', bench.port), timeout=10.0) as idle:
        idle.sendall(b'GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n')
        wait_until(lambda: bench.server._viewers == 1, 'the browser')
        wait_until(lambda: bench.server._viewers == 0, 'its end')
    assert len(events(bench, 10)) == 10


@pytest.mark.parametrize('host', ['evil.example', 'localhost.evil.example', '127.0.0.1.evil', ''])
def test_a_name_that_a_foreign_page_gave_this_computer_is_not_answered(bench, host):
    assert ask(bench, '/', Host=host)[0] in (400, 403)


def test_a_network_wants_a_long_token_and_the_message_says_what_to_do():
    for token in ('', 'short'):
        with pytest.raises(ParameterError, match='bound 16; next: --token-file'):
            Access('0.0.0.0', token)
        with pytest.raises(ParameterError, match='--host gondola-pc is open to the network'):
            Access('gondola-pc', token)
    assert Access('0.0.0.0', TOKEN) and Access('::1') and Access('localhost')


@pytest.mark.parametrize('given, known', [
    (basic(TOKEN), True), (basic(TOKEN[:-1]), False), (basic(TOKEN + 'x'), False),
    (basic(''), False), ('', False), ('Basic %', False), ('Bearer ' + TOKEN, False),
    (basic('é', 'latin-1'), False)])
def test_only_the_token_opens_what_is_open_to_the_network(given, known):
    answer = Access('0.0.0.0', TOKEN).rejection('machine:8088', given)
    assert (answer is None) is known
    assert known or answer.status == 401 and 'Basic' in answer.headers['WWW-Authenticate']
