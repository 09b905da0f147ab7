"""Fixtures for tests of ROS in this process."""

import gc
import signal
import time
from types import SimpleNamespace

import pytest

from facade_manipulator.canopen.clock import Clock
from facade_manipulator.drives.realtime import clear_priority
from facade_manipulator.nodes import run


@pytest.fixture
def handlers(monkeypatch):
    """Restore the signal handlers and the scheduling that a process of nodes replaces."""
    # frozen objects would never be collected, because the tests do not thaw them
    monkeypatch.setattr(
        run, 'gc', SimpleNamespace(freeze=int, unfreeze=int, collect=gc.collect)
    )
    replaced = (*run.STOP_SIGNALS, signal.SIGXCPU)
    before = {number: signal.getsignal(number) for number in replaced}
    yield
    clear_priority()
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def set_clock(monkeypatch):
    """Return a function that sets the system clock of all nodes ahead by a time [s]."""

    def set_ahead(step):
        monkeypatch.setattr(Clock, 'time', staticmethod(lambda: time.time() + step))

    return set_ahead
