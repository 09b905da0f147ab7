"""What tests of the control loop share."""

from __future__ import annotations

from loop_bench import LoopBench
import pytest


@pytest.fixture
def make_bench(simulated_time):
    made = []

    def make(setup=None, **details):
        made.append(LoopBench(setup, **details))
        return made[-1]

    yield make
    for bench in made:
        bench.close()
