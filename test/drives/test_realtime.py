import ctypes
import gc
import os
import sys

import pytest

from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.realtime import (
    collect_garbage,
    freeze_objects,
    request_realtime,
    take_over_collector,
)


def reject(*_):
    raise PermissionError(1, 'Operation not permitted')


def test_default_settings_request_no_priority(monkeypatch):
    for module, name in (
        (os, 'sched_setscheduler'),
        (os, 'sched_setaffinity'),
        (ctypes, 'CDLL'),
    ):
        monkeypatch.setattr(module, name, reject)
    assert request_realtime(ControllerSettings()) == []


def test_rejected_priority_names_the_required_permission(monkeypatch):
    monkeypatch.setattr(os, 'sched_setscheduler', reject)
    message, *_ = request_realtime(ControllerSettings(realtime_priority=50))
    assert 'priority 50 is rejected: it needs' in message and 'rtprio' in message
    assert 'Operation not permitted' in message


@pytest.mark.parametrize(('priority', 'cpu'), [(1, 0), (50, 3)])
def test_granted_priority_and_cpu_are_not_reported(monkeypatch, priority, cpu):
    asked = []
    for name in ('sched_setscheduler', 'sched_setaffinity'):
        monkeypatch.setattr(os, name, lambda *wish: asked.append(wish))
    assert (
        request_realtime(ControllerSettings(realtime_priority=priority, cpu=cpu)) == []
    )
    (thread, policy, parameters), affinity = asked
    assert (thread, policy) == (0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK)
    assert parameters.sched_priority == priority and affinity == (0, {cpu})


def test_replaced_garbage_collector_runs_only_on_request(monkeypatch):
    interval, frozen, collections = sys.getswitchinterval(), gc.get_freeze_count(), []
    monkeypatch.setattr(gc, 'collect', lambda: collections.append(1))
    collect_garbage()
    freeze_objects()
    assert (
        gc.get_freeze_count() == frozen and not collections
    )  # not in a process of others
    try:
        take_over_collector()
        freeze_objects()
        assert not gc.isenabled() and gc.get_freeze_count() > frozen
        collect_garbage()
        assert len(collections) == 2
    finally:
        gc.unfreeze()
        gc.enable()
        sys.setswitchinterval(interval)
