"""Not only the targets: the carriages as measured keep their gap."""

from __future__ import annotations

from dataclasses import replace

from drive_faults import at_rest
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES

CLOSE = (-0.022, 0.022, 0.0)  # m, where a pose closes too
AXES = tuple(replace(axis, home_position=home)
             for axis, home in zip(DEFAULT_AXES, CLOSE, strict=True))


def test_carriage_lagging_into_the_gap_stops_all(make_rig):
    rig = make_rig(axes=AXES)
    rig.drives[2].motor.lag = 0.035
    at_rest(rig)
    rig.stream()
    rig.until_stopped()
    assert 'the measured mechanism: q3 - q1 = 0.01' in rig.snapshot.cause
    assert 'below the bound 0.015 m' in rig.snapshot.cause
    assert rig.carriages[2] - rig.carriages[0] > 0.004


def test_measured_positions_are_checked_in_every_cycle(make_rig):
    checked = []
    rig = make_rig(check_actual=checked.append)
    rig.request('configure', 'home')
    assert not checked
    rig.stream()
    rig.request('activate')
    before, cycles = len(checked), rig.snapshot.cycle.cycles
    rig.cycles(20)
    assert len(checked) - before == rig.snapshot.cycle.cycles - cycles
    assert checked[-1] == pytest.approx(rig.carriages, abs=0.01)
