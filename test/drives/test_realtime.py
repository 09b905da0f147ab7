import ctypes
import gc
import os
import resource
import signal
import subprocess
import sys
import threading

import pytest

from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.realtime import (
    collect_garbage,
    freeze_objects,
    NODE_PRIORITY,
    realtime_priority,
    request_node_priority,
    request_realtime,
    set_priority,
    take_over_collector,
)


def reject(*_):
    raise PermissionError(1, 'Operation not permitted')


@pytest.fixture(name='requests')
def recorded_requests(monkeypatch):
    """Return the requests to the system by their names; none reaches it."""
    found = []

    def record(module, name):
        monkeypatch.setattr(
            module, name, lambda *details: found.append((name, details))
        )

    for name in ('sched_setscheduler', 'sched_setaffinity'):
        record(os, name)
    record(resource, 'setrlimit')
    record(signal, 'signal')
    monkeypatch.setattr(ctypes, 'CDLL', lambda *_, **__: Memory(found))
    return found


class Memory:
    """Library of the system that records the flags of locked memory."""

    def __init__(self, found):
        self._found = found

    def mlockall(self, flags):
        self._found.append(('mlockall', (flags,)))
        return 0


def test_default_settings_request_a_priority_below_interrupts(requests):
    assert request_realtime(ControllerSettings()) == []
    priorities = set()
    for name, details in requests:
        if name == 'sched_setscheduler':
            priorities.add(details[2].sched_priority)
    assert priorities == {20}
    assert NODE_PRIORITY < 20 < 50


def test_priority_zero_requests_nothing(requests):
    assert request_realtime(ControllerSettings(realtime_priority=0)) == []
    assert requests == []


def test_rejected_priority_names_the_required_permission(monkeypatch, requests):
    monkeypatch.setattr(os, 'sched_setscheduler', reject)
    (message,) = request_realtime(ControllerSettings(realtime_priority=45))
    assert 'priority 45 is rejected: it needs' in message
    assert 'rtprio' in message
    assert 'Operation not permitted' in message
    assert 'mlockall' not in dict(requests)


@pytest.mark.parametrize('rejected', [(signal, 'signal'), (resource, 'setrlimit')])
def test_priority_without_a_watchdog_is_not_requested(monkeypatch, requests, rejected):
    def fail(*_):
        raise ValueError('not allowed to raise maximum limit')

    module, name = rejected
    monkeypatch.setattr(module, name, fail)
    (message,) = request_realtime(ControllerSettings(realtime_priority=45))
    assert 'priority 45 is rejected' in message
    assert 'maximum limit' in message
    assert 'sched_setscheduler' not in dict(requests)


@pytest.mark.parametrize(('priority', 'cpu'), [(1, 0), (50, 3)])
def test_granted_priority_and_cpu_are_not_reported(requests, priority, cpu):
    settings = ControllerSettings(realtime_priority=priority, cpu=cpu)
    assert request_realtime(settings) == []
    assert ('sched_setaffinity', (0, {cpu})) in requests


def test_priority_covers_all_threads_but_no_child(requests):
    release = threading.Event()
    thread = threading.Thread(target=release.wait)
    thread.start()
    try:
        set_priority(20)
    finally:
        release.set()
        thread.join()
    scheduled = [details for name, details in requests if name == 'sched_setscheduler']
    threads = {number for number, _, _ in scheduled}
    assert threading.main_thread().native_id in threads
    assert thread.native_id in threads
    policies = {policy for _, policy, _ in scheduled}
    assert policies == {os.SCHED_FIFO | os.SCHED_RESET_ON_FORK}


def test_node_started_with_a_priority_keeps_it(monkeypatch, requests):
    monkeypatch.setattr(os, 'sched_getparam', lambda _: os.sched_param(5))
    request_node_priority()
    assert requests == []


@pytest.mark.parametrize('rejected', [(os, 'sched_setscheduler'), (signal, 'signal')])
@pytest.mark.parametrize('error', [PermissionError(1, 'no'), ValueError('no')])
def test_node_without_permission_continues(monkeypatch, requests, rejected, error):
    def fail(*_):
        raise error

    module, name = rejected
    monkeypatch.setattr(module, name, fail)
    request_node_priority()
    assert realtime_priority() == 0
    assert 'sched_setscheduler' not in dict(requests)


@pytest.mark.realtime
def test_process_without_a_pause_loses_its_priority():
    program = """
import os, time
from facade_manipulator.drives.realtime import set_priority
try:
    set_priority(1)
except PermissionError as error:
    raise SystemExit(str(error))
end = time.monotonic() + 2.5
while os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK and time.monotonic() < end:
    pass
print('policy', os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)
"""
    command = [sys.executable, '-c', program]
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=30.0, check=False
    )
    if 'not permitted' in ended.stderr:
        pytest.skip('this account may not use real-time priority')
    assert ended.stdout == f'policy {os.SCHED_OTHER}\n'
    assert 'ran for 1 s without a pause' in ended.stderr


def test_replaced_garbage_collector_runs_only_on_request(monkeypatch):
    interval = sys.getswitchinterval()
    frozen = gc.get_freeze_count()
    collections = []
    monkeypatch.setattr(gc, 'collect', lambda: collections.append(1))
    collect_garbage()
    freeze_objects()
    # not in a process of others
    assert gc.get_freeze_count() == frozen
    assert not collections
    try:
        take_over_collector()
        freeze_objects()
        assert not gc.isenabled()
        assert gc.get_freeze_count() > frozen
        collect_garbage()
        assert len(collections) == 2
    finally:
        gc.unfreeze()
        gc.enable()
        sys.setswitchinterval(interval)
