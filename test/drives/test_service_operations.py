"""What the self-test says of bus, cycle and faults, by their counters."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from facade_manipulator.canopen.bus import BusStatistics, Condition
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.cycle import CycleStatistics
from facade_manipulator.drives.service_operations import SelfTest

GROUP = SimpleNamespace(causes=(Cause('q1 is hot', 'wait'), Cause('q2 is too', 'wait')))


def self_test(group=None):
    return SelfTest(SimpleNamespace(bus_load=0.4, group=group))


def exchange(bus=None, cycle=None):
    return SimpleNamespace(
        bus=SimpleNamespace(statistics=bus), clock=SimpleNamespace(statistics=cycle))


@pytest.mark.parametrize(('changes', 'passes'), [
    ({}, True), ({'error_frames': 3}, True), ({'overflows': 1}, False),
    ({'condition': Condition.WARNING}, False),
    ({'condition': Condition.PASSIVE, 'overflows': 1}, False)])
def test_a_bus_passes_whose_controller_is_well_and_has_lost_no_frame(changes, passes):
    found = self_test()._bus(exchange(bus=BusStatistics(7)._replace(**changes)))
    assert (found.name, found.passed) == ('bus', passes)
    assert 'worst-case load 40 %' in found.message


@pytest.mark.parametrize(('incomplete', 'late', 'skipped', 'passes'), [
    (0, 0, 0, True), (1, 1, 1, True), (3, 0, 0, True), (0, 0, 3, True),
    (2, 1, 1, False), (1, 2, 1, False), (1, 1, 2, False), (4, 0, 0, False)])
def test_a_cycle_passes_of_which_at_most_one_in_a_thousand_was_bad(
        incomplete, late, skipped, passes):
    found = self_test()._cycle(exchange(cycle=CycleStatistics(
        3000, incomplete, late, skipped, worst=0.0125)))
    assert (found.name, found.passed) == ('cycle', passes)
    assert 'at most 12.5 ms after SYNC' in found.message


@pytest.mark.parametrize(('group', 'says'), [
    (None, 'nothing has stopped'), (SimpleNamespace(causes=()), 'nothing has stopped'),
    (GROUP, 'q1 is hot')])
def test_what_has_stopped_the_drives_is_a_finding(group, says):
    found = self_test(group)._stop()
    assert found.passed is (group is not GROUP) and says in found.message
    assert ('q2 is too' in found.message) is (group is GROUP)
