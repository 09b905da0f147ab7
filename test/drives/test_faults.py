"""Every fault in every situation: all drives stop, and the driver names the way back."""

from __future__ import annotations

from bus_world import Rig
from cycle_checks import POWERED
from drive_faults import CLEAR, FAULTS, HOME, SITUATIONS, SLOW_HOMING
import pytest

from facade_manipulator.drives import group
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State

QUICK = 'active in motion'
CASES = [pytest.param(name, situation, marks=[] if situation == QUICK else pytest.mark.long)
         for name in FAULTS for situation in SITUATIONS]


@pytest.mark.parametrize(('name', 'situation'), CASES)
def test_fault_stops_all_drives_and_names_the_way_back(name, situation, monkeypatch):
    monkeypatch.setattr(group, 'RESET_WINDOW', 3.0)  # s, in which nothing would happen
    fault = FAULTS[name]
    rig = Rig(axes=SLOW_HOMING if situation == 'homing' else DEFAULT_AXES)
    SITUATIONS[situation](rig)
    before, jobs = rig.state, list(rig.jobs)
    fault.inject(rig)
    if situation not in fault.shows:
        rig.run(0.3 + fault.delay)
        assert rig.state is before and fault.cause not in rig.all_causes
    else:
        rig.until(lambda: fault.cause in rig.all_causes)
        rig.until(lambda: State.OPERATION_ENABLED not in rig.drive_states)
        rig.run(0.5)
        assert rig.state in (ControllerState.STOPPED, ControllerState.BUS_LOST)
        first = rig.snapshot.causes[0].message
        assert (fault.cause if situation != 'stopping' else 'the operator stops') in first
        step = HOME if situation == 'homing' and fault.next_step == CLEAR else fault.next_step
        assert step in rig.snapshot.next_step
        assert not fault.unhomes or 'q2' in rig.snapshot.unhomed
        assert rig.rejection('activate') and all(job.done() for _, job in jobs)
        assert not (fault.cuts_power and POWERED & {*rig.drive_states})
    rig.course = None
    rig.repair()
    if rig.state is ControllerState.HOMING:
        rig.request('halt')
    rig.recover()
    assert rig.drive_states == [State.OPERATION_ENABLED] * 3
    rig.close()
