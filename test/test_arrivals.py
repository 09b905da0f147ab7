"""When messages came, whatever happens to the clock."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from facade_manipulator.arrivals import Arrivals


@pytest.mark.parametrize('step', [0.0, 3600.0, -3600.0])
def test_a_clock_that_is_set_puts_nothing_into_another_time(monkeypatch, step):
    clock = SimpleNamespace(monotonic=lambda: 20.0, time=lambda: 1020.0)
    monkeypatch.setattr('facade_manipulator.arrivals.time', clock)
    arrivals = Arrivals()
    clock.monotonic, clock.time = lambda: 20.1, lambda: 1020.1 + step
    arrivals.begin()
    assert arrivals.time(1020.04) == pytest.approx({0.0: 20.04, 3600.0: 20.0, -3600.0: 20.1}[step])
