"""Late control loop with power on: the drives hold, and no drive stops."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
import math

from bus_world import at_rest, SETTINGS
import numpy as np
import pytest

from facade_manipulator.canopen import cob_ids
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.motion.follower import SetpointFollower
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.motor import SimulationSettings

pytestmark = pytest.mark.long

HIGHER = MotionLimits()
SLOWER = MotionLimits(speed=0.1, acceleration=0.5)
SMOOTHER = MotionLimits(jerk=3.0)
RATE = 3.3  # rad/s, by which the carriages reach 0.4 m/s


@pytest.mark.parametrize('pause', [pytest.param(0.03, marks=pytest.mark.long), 0.09])
def test_late_loop_leaves_no_carriage_behind(rig, pause):
    at_rest(rig)
    rig.stream(amplitude=0.12, rate=RATE)
    for phase in (0.5, 1.75, 1.25):
        rig.run(phase * math.pi / RATE)
        rig.stall(pause)
        rig.run(0.5)
        assert rig.state is ControllerState.ACTIVE, rig.all_causes
        assert not rig.snapshot.unhomed
        assert rig.follower.activity.value == 'following'


@pytest.mark.parametrize('phase', [0.5, 2.5])
def test_second_sync_after_a_stall_keeps_home_positions(make_rig, phase):
    """The loop sends a SYNC because it has not read the kernel's SYNC; both are 1 ms apart."""
    settings = replace(SETTINGS, drive_lag=0.0)
    prompt = SimulationSettings(lag=0.0)
    drives = [SimulatedDrive(axis, prompt) for axis in DEFAULT_AXES]
    rig = make_rig(settings=settings, has_kernel_sync=True, drives=drives)
    at_rest(rig)
    rig.stream(amplitude=0.12, rate=RATE)
    rig.run(phase * math.pi / RATE)
    rig.stall(0.03)
    rig.run(0.3)
    assert rig.state is ControllerState.ACTIVE, rig.all_causes
    assert rig.snapshot.unhomed == ()


def latched_targets(rig) -> list[int]:
    """Return the targets of q2 [counts] that its drive latches at each SYNC from now on."""
    latched = []

    def listen(cob_id, _):
        if cob_id == cob_ids.SYNC:
            latched.append(rig.drives[1].objects.values[0x607A, 0])
        return []

    rig.nodes.append(listen)
    return latched


def delay_step(rig, seconds: float, count: int = 1) -> None:
    """Let the choice of targets take a time [s] in the next cycles."""
    sample = rig.follower.sample
    left = [count]

    def slow_sample(reach_time):
        targets = sample(reach_time)
        if left[0]:
            left[0] -= 1
            rig.pass_time(seconds)
        return targets

    rig.follower.sample = slow_sample


@pytest.mark.parametrize(
    ('duration', 'count', 'late'),
    [
        (0.4, 2, 0),
        (0.6, 2, 0),
        (0.75, 1, 1),
        (0.75, 2, 2),
        (0.99, 2, 2),
        (1.01, 2, 2),
        (1.2, 1, 1),
        (1.2, 2, 2),
        (1.7, 1, 2),
    ],
)
def test_step_that_ends_late_makes_no_double_step(make_rig, duration, count, late):
    rig = make_rig(has_kernel_sync=True)
    at_rest(rig)
    rig.stream(amplitude=0.12, rate=RATE)
    rig.run(0.5 * math.pi / RATE)
    latched = latched_targets(rig)
    late_before = rig.snapshot.cycle.late
    rig.checks.is_late = True
    delay_step(rig, duration * SETTINGS.period, count)
    rig.cycles(8)
    largest = max(abs(after - before) for before, after in pairwise(latched))
    fastest = MotionLimits().speed * SETTINGS.period
    assert rig.axes[1].to_metres(largest) <= 1.01 * fastest
    assert rig.snapshot.cycle.late - late_before == late
    assert rig.state is ControllerState.ACTIVE, rig.all_causes


def test_three_late_steps_in_a_row_stop_the_drives(make_rig):
    rig = make_rig(has_kernel_sync=True)
    at_rest(rig)
    rig.checks.is_late = True
    delay_step(rig, 0.9 * SETTINGS.period, 3)
    rig.until_stopped()
    assert 'the control loop was late 3 cycles in a row' in rig.all_causes


def streamed(rig, *steps):
    """Return the commanded positions [m] while the system clock is set by some steps [s]."""
    commanded = []

    def sample(reach_time):
        commanded.append(SetpointFollower.sample(rig.follower, reach_time))
        return commanded[-1]

    at_rest(rig)
    rig.follower.sample = sample
    rig.stream()
    for step in steps:
        rig.clock.offset += step
        rig.run(0.5)
        assert rig.state is ControllerState.ACTIVE, rig.all_causes
    return np.array(commanded)


@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_system_clock_step_neither_moves_nor_stops_the_drives(
    make_rig, has_kernel_sync
):
    steps = [0.0, -0.3, -30.0, -0.05, 0.05, 5.0, -0.15, 0.3, 30.0, -0.4]
    rigs = [make_rig(has_kernel_sync=has_kernel_sync) for _ in range(2)]
    expected = streamed(rigs[0], *[0.0] * len(steps))
    commanded = streamed(rigs[1], *steps)
    assert commanded == pytest.approx(expected, abs=1e-5)
    assert rigs[1].follower.brakes == 0


def maximum_speed(rig):
    """Return the speed of the fastest carriage [m/s]."""
    return max(abs(axis.velocity) for axis in rig.snapshot.axes)


@pytest.mark.parametrize('lower', [SLOWER, SMOOTHER])
def test_lowering_limits_at_full_speed_only_brakes(rig, lower):
    at_rest(rig)
    rig.stream(amplitude=0.12, rate=RATE)
    for _ in range(6):
        rig.run(0.13)
        fastest = max(lower.speed, maximum_speed(rig))
        rig.follower.change_limits(lower)
        rig.run(0.2)
        assert maximum_speed(rig) <= fastest + 0.01
        rig.follower.change_limits(HIGHER)
        rig.run(0.4)
