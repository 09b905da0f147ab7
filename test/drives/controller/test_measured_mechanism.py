"""Not only what is commanded: the carriages as measured keep their gap, and together."""

from __future__ import annotations

from dataclasses import replace

from drive_rig import at_rest, MOVING
import pytest

from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.guard import measured_guard

FAST = 0.25  # m/s
CLOSE = (-0.022, 0.022, 0.0)  # m, where a pose closes too
# so wide that the drives themselves do not stop first
AXES = tuple(replace(axis, home_position=home, following_error_window=0.04)
             for axis, home in zip(DEFAULT_AXES, CLOSE, strict=True))


def test_a_carriage_that_lags_into_the_gap_stops_all_before_it_touches(make_rig):
    rig = make_rig(axes=AXES, check_actual=measured_guard(Geometry(), 0.005))
    rig.source.speed = FAST
    gaps = []

    def watch(snapshot):
        positions = [axis.position for axis in snapshot.axes]
        if None not in positions and snapshot.state is not ControllerState.HOMING:
            gaps.append(positions[2] - positions[0])

    with rig.simulator.access() as drives:
        drives[2].motor.lag = 0.06
    at_rest(rig)
    rig.controller.observe = watch
    rig.until_stopped()
    cause = rig.controller.snapshot().cause
    assert 'the measured mechanism: q3 - q1 = 0.01' in cause
    assert 'below the bound 0.015 m' in cause
    assert min(gaps) > 0.004


def test_the_measured_positions_are_checked_in_every_cycle_that_moves(make_rig):
    checked = []
    rig = make_rig(check_actual=checked.append)
    rig.do('configure')
    assert not checked
    rig.do('home')
    assert not checked
    rig.source.speed = MOVING
    rig.do('activate')
    before, cycles = len(checked), rig.controller.snapshot().cycle.cycles
    rig.cycles(20)
    passed = rig.controller.snapshot().cycle.cycles - cycles
    assert len(checked) - before == pytest.approx(passed, abs=2)
    assert checked[-1] == pytest.approx(rig.carriages, abs=0.01)
