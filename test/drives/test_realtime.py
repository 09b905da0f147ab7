import ctypes
import gc
import math
import os
import re
import sys
import threading

import pytest

from facade_manipulator.drives import realtime
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.realtime import (
    describe_scheduling,
    GarbageCollectionPause,
    realtime_priority,
    request_realtime,
)


def reject(*_):
    raise PermissionError(1, 'Operation not permitted')


def test_nothing_is_asked_for_by_default(monkeypatch):
    monkeypatch.setattr(os, 'sched_setscheduler', reject)
    monkeypatch.setattr(os, 'sched_setaffinity', reject)
    monkeypatch.setattr(ctypes, 'CDLL', reject)
    assert request_realtime(ControllerSettings()) == []


def test_a_rejected_priority_comes_with_the_way_to_grant_it(monkeypatch):
    monkeypatch.setattr(os, 'sched_setscheduler', reject)
    message, = request_realtime(ControllerSettings(realtime_priority=50))
    assert 'priority 50 is rejected (Operation not permitted)' in message
    assert 'rtprio' in message


@pytest.mark.parametrize(('priority', 'cpu'), [(1, 0), (50, 3)])
def test_a_granted_priority_and_cpu_of_this_thread_say_nothing(monkeypatch, priority, cpu):
    asked = []
    monkeypatch.setattr(os, 'sched_setscheduler', lambda *wish: asked.append(wish))
    monkeypatch.setattr(os, 'sched_setaffinity', lambda *wish: asked.append(wish))
    assert request_realtime(ControllerSettings(realtime_priority=priority, cpu=cpu)) == []
    (thread, policy, parameters), affinity = asked
    assert (thread, policy) == (0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK)
    assert parameters.sched_priority == priority and affinity == (0, {cpu})


@pytest.mark.parametrize('policy, says', [
    (os.SCHED_OTHER, 'without real-time scheduling: .* controller.realtime_priority, .*ulimit -r'),
    (os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, 'with real-time scheduling, priority 1$'),
])
def test_how_the_control_thread_is_scheduled_is_what_the_kernel_says(monkeypatch, policy, says):
    monkeypatch.setattr(os, 'sched_getscheduler', {0: policy}.get)
    monkeypatch.setattr(os, 'sched_getparam', {0: os.sched_param(1)}.get)
    assert re.search(says, describe_scheduling(realtime_priority()))


def test_what_the_control_thread_starts_has_no_priority():
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


def test_a_cpu_that_does_not_exist_is_told():
    before = os.sched_getaffinity(0)
    message, = request_realtime(ControllerSettings(cpu=1023))
    assert 'CPU 1023' in message
    assert os.sched_getaffinity(0) == before


@pytest.mark.parametrize(('answer', 'count'), [(0, 0), (-1, 1)])
def test_locked_memory_is_asked_of_the_kernel(monkeypatch, answer, count):
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


def test_the_collector_takes_over_and_gives_back(collector):
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


def test_what_lives_when_the_cycle_begins_is_never_looked_at_again(collector):
    collector.start()
    before, made = gc.get_freeze_count(), [[number] for number in range(10_000)]
    collector.keep()
    assert gc.get_freeze_count() >= before + len(made)
    assert len(gc.get_objects()) < len(made)


def test_garbage_is_collected_now_and_then_in_the_slack(collector, monkeypatch):
    asked = []
    collector.start()
    monkeypatch.setattr(gc, 'collect', asked.append)
    for now in range(20):
        assert collector.due <= now
        collector.collect(now)
        assert collector.due == now + realtime.COLLECTION_PERIOD
    assert asked.count(realtime.FULL_COLLECTION) == 2
    assert asked.count(realtime.YOUNG_COLLECTION) == 18
