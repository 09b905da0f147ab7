"""Homing of all three axes under the drive controller."""

from __future__ import annotations

from dataclasses import replace

from drive_faults import configured
import pytest

from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.errors import DriveError, DriveStateError, LimitError


def test_homing_by_switch_finds_the_home_position(make_rig):
    axes = tuple(
        replace(axis, homing_method=17, home_position=position, homing_speed=0.5,
                homing_acceleration=10.0)
        for axis, position in zip(DEFAULT_AXES, (-0.45, -0.25, -0.35), strict=True))
    rig = make_rig(axes=axes)
    rig.request('configure')
    assert 'is not homed' not in rig.request('home')
    assert rig.snapshot.unhomed == ()


def test_axes_of_higher_rank_home_later(make_rig):
    axes = tuple(replace(axis, homing_rank=rank)
                 for axis, rank in zip(DEFAULT_AXES, (2, 1, 3), strict=True))
    order = []

    def check(positions, homed):
        if homed not in order:
            order.append(homed)

    rig = make_rig(axes=axes, check_homing=check)
    configured(rig)
    assert order[:3] == [
        (False, False, False), (False, True, False), (True, True, False)]


def test_homing_stops_before_a_collision(make_rig):
    def check(positions, homed):
        raise LimitError('q2 - q3', 0.01, 0.02, 'm', 'below')

    rig = make_rig(check_homing=check)
    rig.request('configure')
    with pytest.raises(DriveError, match='homing stopped: q2 - q3 = 0.01 m.*q1 is not homed'):
        rig.request('home')
    rig.until_stopped()


def slow_homing() -> tuple:
    return tuple(replace(axis, homing_method=17, homing_speed=0.02) for axis in DEFAULT_AXES)


def test_halt_gives_homing_up(make_rig):
    rig = make_rig(axes=slow_homing())
    rig.request('configure')
    homing = rig.ask('home')
    rig.until(lambda: State.OPERATION_ENABLED in rig.drive_states)
    rig.until(lambda: rig.rejection('halt') is None)
    with pytest.raises(DriveStateError, match='cancelled by halt'):
        rig.finish(homing)
    assert rig.state is ControllerState.INACTIVE
    assert rig.snapshot.unhomed == AXIS_NAMES
