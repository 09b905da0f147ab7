import ctypes
import gc
import math
import os
import sys
import threading

import pytest

from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.realtime import GarbageCollectionPause, request_realtime


def reject(*_):
    raise PermissionError(1, 'Operation not permitted')


def test_default_settings_request_nothing(monkeypatch):
    monkeypatch.setattr(os, 'sched_setscheduler', reject)
    monkeypatch.setattr(os, 'sched_setaffinity', reject)
    monkeypatch.setattr(ctypes, 'CDLL', reject)
    assert request_realtime(ControllerSettings()) == []


def test_rejected_priority_names_the_way_to_grant_it(monkeypatch):
    monkeypatch.setattr(os, 'sched_setscheduler', reject)
    message, = request_realtime(ControllerSettings(realtime_priority=50))
    assert 'priority 50 is rejected (Operation not permitted)' in message
    assert 'rtprio' in message


@pytest.mark.parametrize(('priority', 'cpu'), [(1, 0), (50, 3)])
def test_granted_priority_and_cpu_are_silent(monkeypatch, priority, cpu):
    asked = []
    monkeypatch.setattr(os, 'sched_setscheduler', lambda *wish: asked.append(wish))
    monkeypatch.setattr(os, 'sched_setaffinity', lambda *wish: asked.append(wish))
    assert request_realtime(ControllerSettings(realtime_priority=priority, cpu=cpu)) == []
    (thread, policy, parameters), affinity = asked
    assert (thread, policy) == (0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK)
    assert parameters.sched_priority == priority and affinity == (0, {cpu})


def test_threads_of_the_control_thread_have_no_priority():
    policies = []

    def note():
        policies.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)

    def control():
        if not request_realtime(ControllerSettings(realtime_priority=1)):
            note()
            in_thread(note)

    in_thread(control)
    if not policies:
        pytest.skip('SCHED_FIFO is not permitted here')
    assert policies == [os.SCHED_FIFO, os.SCHED_OTHER]


def in_thread(work):
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()


@pytest.mark.parametrize(('answer', 'count'), [(0, 0), (-1, 1)])
def test_locked_memory_is_requested_from_the_kernel(monkeypatch, answer, count):
    class Library:
        def __init__(self, *_, **__):
            self.mlockall = lambda flags: answer

    monkeypatch.setattr(ctypes, 'CDLL', Library)
    messages = request_realtime(ControllerSettings(lock_memory=True))
    assert len(messages) == count
    assert all('memlock' in message for message in messages)


@pytest.fixture
def collector():
    made = GarbageCollectionPause()
    yield made
    made.stop()


def test_collector_takes_over_and_gives_back(collector):
    before = gc.isenabled(), sys.getswitchinterval()
    collector.start()
    collector.start()
    assert not gc.isenabled()
    assert sys.getswitchinterval() <= before[1]
    collector.stop()
    collector.stop()
    assert (gc.isenabled(), sys.getswitchinterval()) == before
    frozen = gc.get_freeze_count()
    collector.keep()
    assert (collector.due, gc.get_freeze_count()) == (math.inf, frozen)
