"""What is told of a cycle: carriages and outcome, for less than the whole snapshot."""

import pytest

from facade_manipulator.drives.canopen.pdo import ConditionFrame, MotionFrame, StatusFrame
from facade_manipulator.drives.cia402.cause import Cause
from facade_manipulator.drives.cia402.settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.controller.monitor import AxisMonitor, Told
from facade_manipulator.drives.controller.report import Record
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import ControllerState

ENABLED, WITH_TARGET_REACHED, FAULT = 0x0027, 0x0427, 0x0008
CAUSES = tuple(Cause(message, 'clear the faults') for message in ('first', 'second'))
MONITORS = tuple(
    AxisMonitor(name, axis, ControllerSettings())
    for name, axis in zip(AXIS_NAMES, DEFAULT_AXES, strict=True))


def drive(statusword=ENABLED, **changes):
    told = Told(
        StatusFrame(statusword, 8, 12345), MotionFrame(-321, 7), ConditionFrame(0, 55, 0),
        homed=True, error_code=0, nmt_state=5, heartbeat_time=1.0, missed=0, serial_number=4711)
    return told._replace(**changes)


def record(*told, **changes):
    told = (*told, *[drive()] * (len(MONITORS) - len(told)))
    return Record(
        state=ControllerState.ACTIVE, now=2.0, stamp=1000.0, monitors=MONITORS, told=told,
        targets=None, causes=(), next_step='', notes=(), clock=None, bus=None, bus_error='',
        bus_load=0.1)._replace(**changes)


def test_the_joints_are_those_of_the_snapshot():
    one = record(drive(), drive(status=StatusFrame(ENABLED, 8, -99)))
    joints, axes = one.joints(), one.snapshot().axes
    assert joints.stamp == 1000.0
    assert joints.positions == tuple(axis.position for axis in axes)
    assert joints.velocities == tuple(axis.velocity for axis in axes)
    assert joints.forces == tuple(axis.force for axis in axes)
    assert joints.positions[0] != joints.positions[1]


def test_a_velocity_or_force_never_told_is_0():
    joints = record(drive(motion=None), drive(condition=None)).joints()
    assert joints.velocities[0] == joints.forces[1] == 0.0
    assert joints.velocities[1] != 0.0
    assert joints.forces[0] != 0.0


@pytest.mark.parametrize('one', [
    record(drive(homed=False)), record(drive(), drive(), drive(status=None)),
    record(stamp=0.0)], ids=['not homed', 'no position', 'no SYNC'])
def test_where_a_carriage_is_not_known_there_are_no_joints(one):
    assert one.joints() is None


@pytest.mark.parametrize('same', [
    record(drive(WITH_TARGET_REACHED)), record(drive(missed=7, heartbeat_time=3.0)),
    record(now=9.0, stamp=1001.0, bus_load=0.2)], ids=['target', 'counters', 'time'])
def test_what_says_nothing_new_leaves_the_outcome(same):
    assert same.outcome() == record().outcome()


@pytest.mark.parametrize('other', [
    record(state=ControllerState.HALTED), record(drive(FAULT)), record(drive(homed=False)),
    record(drive(error_code=0x2310)), record(drive(status=None)), record(causes=CAUSES),
    record(next_step='activate'), record(bus_error='no such device')])
def test_what_says_something_new_changes_the_outcome(other):
    assert other.outcome() != record().outcome()


def test_the_first_cause_decides():
    assert record(causes=CAUSES).outcome() == record(causes=CAUSES[:1]).outcome()
    assert record(causes=CAUSES).outcome() != record(causes=CAUSES[::-1]).outcome()
