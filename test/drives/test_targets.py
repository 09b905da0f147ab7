from dataclasses import replace
import math
from types import SimpleNamespace

from drive_parts import Source
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import AXIS_NAMES as NAMES
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.group import AxisCommand, Group
from facade_manipulator.drives.monitor import AxisMonitor, STATUSWORD
from facade_manipulator.drives.states import Mode, Status
from facade_manipulator.drives.targets import (
    MAX_SLIP,
    MechanismChecks,
    STEP_MARGIN,
    TargetSupervisor,
)
from facade_manipulator.drives.units import Measured
from facade_manipulator.errors import (
    InputError,
    ManipulatorError,
    SetpointLimitError,
    StrokeLimitError,
)

CSP = Mode.CYCLIC_SYNCHRONOUS_POSITION
OFF, ON, HOMING = AxisCommand(0x00, CSP), AxisCommand(0x0F, CSP), AxisCommand(0x1F, Mode.HOMING)
HERE = (-43_000, 43_000, 0)
SETTINGS = ControllerSettings()
LARGEST_STEP = STEP_MARGIN * 0.6 * SETTINGS.period


def targets(source=None, check=lambda positions: None) -> TargetSupervisor:
    return TargetSupervisor(DEFAULT_AXES, SETTINGS, MechanismChecks(source or Source(), check))


def supervised(state: ControllerState, position: float | None) -> Group:
    """Return a group in a state, supervised once although nothing was commanded yet."""
    group = Group(NAMES)
    group.state = state
    monitors = tuple(AxisMonitor(name, axis, SETTINGS)
                     for name, axis in zip(NAMES, DEFAULT_AXES, strict=True))
    for one in monitors:
        one.measured = Measured(position)
    targets().supervise(group, monitors, 0.0)
    return group


def elsewhere(counts: int) -> tuple[int, ...]:
    return tuple(value + counts for value in HERE)


def test_carriage_elsewhere_at_power_on_is_rejected():
    one = targets()
    one.choose(ControllerState.ACTIVATING, AxisCommand(0x07, CSP), HERE, 0.0)
    with pytest.raises(SetpointLimitError, match='distance of q1 from its target'):
        one.choose(ControllerState.HOLDING, ON, elsewhere(round(1.1 * MAX_SLIP * 430_000)), 0.0)


AT_END = tuple(axis.to_counts(0.499) for axis in DEFAULT_AXES)


@pytest.mark.parametrize(('here', 'wanted', 'error', 'message'), [
    (HERE, (math.nan, 0.1, 0.0), InputError, 'target of q1 = nan m is not a finite number'),
    (HERE, (-0.1, -math.inf, 0.0), InputError, 'target of q2 = -inf m is not a finite'),
    (HERE, (-0.1, 0.1 + 1.01 * LARGEST_STEP, 0.0), SetpointLimitError,
     'step of the target of q2 in one cycle = 0.006666 m is above the bound 0.0066 m'),
    (AT_END, (0.499, 0.499, 0.501), StrokeLimitError,
     'target of q3 = 0.501 m is above the bound 0.5 m')])
def test_rejected_target_keeps_the_last_one(
        here, wanted, error, message):
    source = Source()
    one = targets(source)
    one.choose(ControllerState.INACTIVE, OFF, here, 0.0)
    one.choose(ControllerState.HOLDING, ON, here, 0.0)
    source.distort = lambda positions: wanted
    with pytest.raises(error, match=message):
        one.choose(ControllerState.ACTIVE, ON, here, 0.0)
    assert one.counts == here


states = st.sampled_from(sorted(ControllerState, key=str))
numbers = st.one_of(st.floats(-0.6, 0.6), st.floats())


@given(st.lists(st.tuples(states, st.tuples(numbers, numbers, numbers)), max_size=30))
def test_no_step_to_the_drives_is_too_large(cycles):
    source = Source()
    one = targets(source)
    one.choose(ControllerState.INACTIVE, OFF, HERE, 0.0)
    for state, wanted in cycles:
        source.distort = lambda positions, wanted=wanted: wanted
        before = one.counts
        command = ON if state.is_following else OFF
        try:
            one.choose(state, command, HERE, 0.0)
        except ManipulatorError:
            assert one.counts == before
            one.choose(ControllerState.STOPPING, AxisCommand(0x02, CSP), HERE, 0.0)
            continue
        if command is ON:
            largest = LARGEST_STEP * DEFAULT_AXES[0].counts_per_metre + 1
            assert max(abs(a - b) for a, b in zip(one.counts, before, strict=True)) <= largest


@pytest.mark.parametrize('state', [
    ControllerState.HOMING, *(one for one in ControllerState if one.is_following)])
def test_unknown_carriage_position_stops_all(state):
    assert 'has sent its position' in supervised(state, None).cause.message


WINDOW = DEFAULT_AXES[0].following_error_window


@pytest.mark.parametrize('missed', [0, SETTINGS.max_missed_cycles])
@pytest.mark.parametrize('lag', [0.0, 0.013])
@pytest.mark.parametrize(('off', 'says'), [
    ((0.0, 0.0, 0.0), ''), ((0.0, 0.96 * WINDOW, 0.0), ''),
    ((0.0, -1.04 * WINDOW, 0.0), 'q2 (node 2) is 0.'),
    ((0.0, 0.0, 1.04 * WINDOW), 'q3 (node 3) is -0.'),
    ((0.52 * WINDOW, 0.0, -0.52 * WINDOW), 'q1 and q3 differ by 0.0156 m')])
def test_following_error_is_of_the_latched_target(
        lag, missed, off, says):
    """Of answers that are missing, so many cycles before that."""
    settings = replace(SETTINGS, drive_lag=lag)
    axes = (replace(DEFAULT_AXES[0], following_error_window=2.0 * WINDOW), *DEFAULT_AXES[1:])
    one, group = TargetSupervisor(axes, settings, MechanismChecks(Source())), Group(NAMES)
    monitors = [AxisMonitor(name, axis, settings)
                for name, axis in zip(NAMES, DEFAULT_AXES, strict=True)]
    group.state = ControllerState.ACTIVE
    one.choose(ControllerState.INACTIVE, OFF, HERE, 0.0)
    one.mechanism.source.speed = 0.3
    for cycle in range(30):
        way = 0.3 * SETTINGS.period * max(cycle - missed - 1.0 - lag / SETTINGS.period, 0.0)
        for monitor, start, error in zip(monitors, (-0.1, 0.1, 0.0), off, strict=True):
            monitor.measured = Measured(start + way + error * (cycle == 29))
            monitor.answers.missed_in_a_row = missed
            monitor._values[STATUSWORD] = Status.INTERNAL_LIMIT * (lag > 0.0)
        one.supervise(group, monitors, 0.0)
        one.choose(ControllerState.ACTIVE, ON, HERE, 0.0)
    assert group.cause is None if not says else says in group.cause.message
    if 'behind' in group.reason:
        assert ('bit 11' in group.reason) is (lag > 0.0)


def test_target_is_asked_for_the_arrival_time():
    asked, clock = [], SimpleNamespace(smooth_stamp=100.0, held=0.0)
    one, group = TargetSupervisor(DEFAULT_AXES, replace(SETTINGS, drive_lag=0.013),
                                  MechanismChecks(Source())), Group(NAMES)
    one.choose(ControllerState.INACTIVE, OFF, HERE, 0.0)
    one.mechanism.source.sample = lambda time: asked.append(time) or (-0.1, 0.1, 0.0)
    group.state = ControllerState.ACTIVE
    one.command(group, (ON,) * 3, HERE, clock, 0.0)
    assert asked == pytest.approx([100.0 + 2.0 * SETTINGS.period + 0.013])
