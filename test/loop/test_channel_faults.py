"""Whatever happens to the node, or to the loop, the carriages move on or stop in order."""

from __future__ import annotations

from dataclasses import replace

from channel_faults import FAULTS, IsolatedNode, prove
from loop_bench import CONTROLLER
import pytest
from support import patiently

HASTY = replace(CONTROLLER, watchdog_timeout=0.8)


@pytest.mark.realtime
@pytest.mark.parametrize('name', FAULTS)
def test_the_carriages_go_on_or_stop_in_order(name):
    patiently(lambda: try_out(FAULTS[name]))


def try_out(fault):
    node = IsolatedNode(HASTY)
    try:
        return prove(node, fault)
    finally:
        node.close()
