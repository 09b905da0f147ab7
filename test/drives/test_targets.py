"""Last check of targets before the bus, and the driver's following error."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis import make_axes
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.guard import Unguarded
from facade_manipulator.drives.states import AxisCommand, Mode
from facade_manipulator.drives.targets import STEP_MARGIN, TargetSupervisor
from facade_manipulator.errors import ManipulatorError

ACTIVE = GroupState.ACTIVE
OFF, ON = (AxisCommand(word, Mode.CYCLIC_SYNCHRONOUS_POSITION) for word in (0x00, 0x0F))
HERE = (-43_000, 43_000, 0)
START = (-0.1, 0.1, 0.0)
SETTINGS = ControllerSettings()
T = SETTINGS.period
LARGEST_STEP = STEP_MARGIN * 0.6 * T
WINDOW = DEFAULT_AXES[0].following_error_window


class Source:
    """Source of targets that move at a constant speed from their reset position, or are given."""

    at_rest = True

    def __init__(self) -> None:
        self.speed = 0.0
        self.wanted = None
        self.positions = None

    def reset(self, positions) -> None:
        self.positions = positions

    def hold(self) -> None:
        self.speed = 0.0

    def sample(self, reach_time: float):
        self.positions = tuple(q + self.speed * T for q in self.positions)
        return self.wanted or self.positions


class Drives:
    """Targets, group and axes of three drives that are initially switched off."""

    def __init__(self, lag: float = 0.0, axes=DEFAULT_AXES) -> None:
        settings = replace(SETTINGS, drive_lag=lag)
        self.axes = make_axes(axes, settings)
        for axis, counts in zip(self.axes, HERE, strict=True):
            axis.feedback.counts = counts
        self.source = Source()
        self.group = Group(self.axes, settings)
        self.targets = TargetSupervisor(self.group, settings, self.source, Unguarded())
        self.choose(GroupState.INACTIVE, OFF)

    def choose(self, state: GroupState, command: AxisCommand = ON) -> None:
        self.group.state = state
        self.group.follows = command is ON
        self.command(command)
        self.targets.choose(0.0)

    def command(self, command: AxisCommand) -> None:
        for axis in self.axes:
            axis.output.take(command)

    @property
    def counts(self) -> tuple[int, ...]:
        return tuple(axis.output.target for axis in self.axes)

    def supervise(self) -> str:
        """Return the cause of a stop, or ''."""
        self.targets.supervise(0.0)
        return self.group.reason


FOLLOWING = (
    GroupState.ACTIVATING,
    GroupState.ACTIVE,
    GroupState.DEACTIVATING,
    GroupState.HALTED,
)
states = st.sampled_from(sorted(GroupState, key=str))
numbers = st.one_of(st.floats(-0.6, 0.6), st.floats())


@given(st.lists(st.tuples(states, st.tuples(numbers, numbers, numbers)), max_size=30))
def test_steps_to_the_drives_stay_within_the_bound(cycles):
    drives = Drives()
    for state, drives.source.wanted in cycles:
        before = drives.counts
        try:
            drives.choose(state, ON if state in FOLLOWING else OFF)
        except ManipulatorError:
            assert drives.counts == before
            drives.choose(GroupState.STOPPED, AxisCommand(0x02, ON.mode))
            continue
        if state in FOLLOWING:
            largest = LARGEST_STEP * DEFAULT_AXES[0].counts_per_metre + 1
            for count, previous in zip(drives.counts, before, strict=True):
                assert abs(count - previous) <= largest


def test_enabled_drives_hold_their_targets_without_following():
    drives = Drives()
    drives.command(ON)
    for axis in drives.axes:
        axis.feedback.counts = 0
    drives.targets.choose(0.0)
    assert drives.counts == HERE


@pytest.mark.parametrize('state', [GroupState.HOMING, *FOLLOWING])
def test_unknown_carriage_position_stops_all(state):
    drives = Drives()
    drives.group.state = state
    drives.group.follows = state in FOLLOWING
    assert 'has sent its position' in drives.supervise()


@pytest.mark.parametrize('missed', [0, SETTINGS.max_missed_cycles])
@pytest.mark.parametrize('lag', [0.0, 0.013])
@pytest.mark.parametrize(
    ('off', 'message'),
    [
        ((0.0, 0.0, 0.0), ''),
        ((0.0, 0.96 * WINDOW, 0.0), ''),
        ((0.0, -1.04 * WINDOW, 0.0), 'q2 (node 2) is 0.'),
        ((0.0, 0.0, 1.04 * WINDOW), 'q3 (node 3) is -0.'),
        ((0.52 * WINDOW, 0.0, -0.52 * WINDOW), 'q1 and q3 differ by 0.0156 m'),
    ],
)
def test_following_error_uses_the_latched_target(lag, missed, off, message):
    """Each missing answer makes the latched target one cycle older."""
    wide = replace(DEFAULT_AXES[0], following_error_window=2.0 * WINDOW)
    drives = Drives(lag, (wide, *DEFAULT_AXES[1:]))
    drives.source.speed = 0.3
    for cycle in range(30):
        drives.group.state = ACTIVE
        way = 0.3 * T * max(cycle - missed - 1.0 - lag / T, 0.0)
        for axis, start, error in zip(drives.axes, START, off, strict=True):
            axis.feedback.position = start + way + error * (cycle == 29)
            axis.answers.cycles_old = missed
        reason = drives.supervise()
        drives.choose(ACTIVE)
    assert message in reason
    assert bool(message) is bool(reason)


def test_target_is_requested_for_the_arrival_time():
    drives = Drives(lag=0.013)
    asked = []
    drives.source.sample = lambda time: asked.append(time) or START
    drives.group.state = ACTIVE
    drives.group.follows = True
    clock = SimpleNamespace(smooth_time=100.0, held=0.0)
    drives.command(ON)
    drives.targets.command(clock, 0.0)
    assert asked == pytest.approx([100.0 + 2.0 * T + 0.013])
