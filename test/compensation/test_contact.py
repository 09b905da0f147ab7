"""Contact with the wall: gentle touch, held force, retracts with a reason, yaw and slip."""

import cmath
from collections import deque
from dataclasses import replace
from functools import partial
import math
from types import SimpleNamespace

import numpy as np
import pytest

from facade_manipulator.compensation.contact import Contact, LateralSettings
from facade_manipulator.compensation.contact_force import ForceLaw, SPEED, WallTracker
from facade_manipulator.compensation.contact_phases import (
    ContactSettings,
    Pressing,
    PressMode,
    Surroundings,
)
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import Pose, Wrench

SETTINGS = ContactSettings(enabled=True)
PERIOD = 0.01  # s
HORIZON = 6  # cycles from decision to head
LATENCY = 1  # cycle from force to law
NOISE = 0.5  # N
WALL = -0.03  # m, from the goal
HELD = 15.0  # s, the force is held
BACK = 18.0  # s, a lost input returns
END = 25.0  # s, of a run
NOW = 1000.0
PRESSED = Wrench(3.0, -30.0, 0.5)
REFERENCE = Pose(0.1, 0.25, 0.3)


def press(
    wall_stiffness,
    duration=END,
    wall=lambda time: WALL,
    sensor=lambda time, force: force,
    around=lambda time: Surroundings(),
    moment=lambda yaw: 0.0,
    pressing=None,
    start=0.0,
    **settings,
):
    """
    Press on a brush and a wall at 100 Hz, with a head that reaches each offset on time.

    The sensor returns a reading of time and force, or None.
    """
    pressing = pressing or Pressing(replace(SETTINGS, **settings))
    random = np.random.default_rng(1)
    last = None
    offsets = []
    yaws = []
    forces = []
    desired = []
    for k in range(round(duration / PERIOD)):
        now = start + k * PERIOD
        reached = max(k - HORIZON, 0)
        pressing.step(now, now + HORIZON * PERIOD, PERIOD, around(now))
        offsets.append(pressing.normal.shift)
        yaws.append(pressing.theta.offset)
        desired.append(pressing.desired)
        forces.append(wall_stiffness * max(offsets[reached] - wall(now), 0.0))
        felt = forces[max(k - LATENCY, 0)]
        reading = sensor(now, felt + NOISE * random.standard_normal())
        if reading is not None:
            felt_moment = moment(yaws[reached]) if felt else 0.0
            stamp = now - LATENCY * PERIOD
            pressing.add_measurement(stamp, reading, felt_moment, last == reading)
            last = reading
    return SimpleNamespace(
        pressing=pressing,
        offsets=np.array(offsets),
        yaws=np.array(yaws),
        forces=np.array(forces),
        desired=np.array(desired),
    )


@pytest.mark.parametrize('stiffness', [600.0, 2000.0, 5000.0])
@pytest.mark.parametrize('share', [0.5, 1.0])
def test_force_is_held_on_contacts_up_to_brush_stiffness(stiffness, share):
    run = press(share * stiffness, stiffness=stiffness)
    held = run.forces[-500:]
    assert run.pressing.mode is PressMode.HOLDING
    assert run.pressing.is_force_reached
    assert held.mean() == pytest.approx(SETTINGS.force, rel=0.03)
    assert held.std() < 1.0
    assert run.forces.max() < 1.2 * SETTINGS.force
    assert abs(np.diff(run.offsets)).max() <= 2.0 * SPEED * PERIOD + 1e-12


def test_approach_is_slow_and_ends_at_the_range():
    run = press(600.0, 40.0, wall=lambda time: 1.0)
    assert run.offsets[[0, -1]] == pytest.approx(-SETTINGS.retreat)
    assert run.offsets.max() == pytest.approx(SETTINGS.range)
    assert run.pressing.mode is PressMode.RETRACTED
    assert np.diff(run.offsets).max() <= 0.004 * PERIOD + 1e-12


@pytest.mark.parametrize(
    'wall, stiffness, mode, reason',
    [
        (1.0, 600.0, PressMode.RETRACTED, 'no wall within 80 mm (contact.range)'),
        (0.07, 600.0, PressMode.HOLDING, 'the force needs an offset above 80 mm'),
        (0.0, 600.0, PressMode.HOLDING, ''),
        (-0.04, 600.0, PressMode.HOLDING, ''),
    ],
)
def test_force_out_of_range_is_a_hindrance(wall, stiffness, mode, reason):
    pressing = press(stiffness, 60.0, wall=lambda time: wall).pressing
    assert pressing.mode is mode
    assert pressing.is_force_reached is not bool(reason)
    assert pressing.is_hindered is bool(reason)
    assert pressing.outcome.startswith(
        f'{mode.value}: {reason}' if reason else mode.value
    )


@pytest.mark.parametrize('stiffness', [600.0, 2000.0, 5000.0])
def test_noise_of_a_dead_sensor_ends_in_a_retract(stiffness):
    """The readings change, but without the force: the head compresses the brush unnoticed."""
    run = press(
        stiffness,
        80.0,
        stiffness=stiffness,
        wall=lambda time: -0.01,
        sensor=lambda time, force: NOISE * math.sin(1e3 * time),
    )
    largest = stiffness * (SETTINGS.range + 0.01)
    assert run.forces.max() <= largest + 1e-6
    assert (run.forces > 0.9 * largest).sum() * PERIOD < 3.0
    assert run.forces[-3000:].max() == 0.0
    assert run.pressing.mode is PressMode.RETRACTED
    assert 'no wall within 80 mm (contact.range)' in run.pressing.reason
    assert 'next: check the force sensor' in run.pressing.reason


def test_normal_approach_to_the_wall_has_no_hindrance():
    pressing = Pressing(SETTINGS)
    hindered = []
    for k in range(200):
        press(600.0, 0.1, pressing=pressing, start=0.1 * k)
        hindered.append(pressing.outcome if pressing.is_hindered else '')
    assert pressing.mode is PressMode.HOLDING
    assert {*hindered[2:]} == {''}  # after the first reading of the sensor


def test_force_rises_smoothly_over_the_ramp_time():
    desired = press(600.0).desired
    ramp = desired[(desired > 0.0) & (desired < SETTINGS.force)]
    assert len(ramp) * PERIOD == pytest.approx(SETTINGS.ramp_time, abs=0.05)
    assert ramp[0] == pytest.approx(0.1 * SETTINGS.force, rel=0.01)
    assert (np.diff(ramp) > 0.0).all()


def test_noise_of_the_predicted_disturbance_is_removed():
    """The gondola is at rest; the prediction errs by 0.6 mm RMS below 1 Hz."""

    def error(time):
        return 6e-4 * (math.sin(2.0 * time) + math.sin(5.1 * time + 1.0))

    def around(time):
        return Surroundings(rail_y=error(time + HORIZON * PERIOD))

    def wall(time):
        return WALL + error(time)

    run = press(5000.0, 40.0, stiffness=5000.0, wall=wall, around=around)
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces[2500:].std() < 0.5 < 0.2 * 5000.0 * 6e-4


def press_with_prediction_errors(
    stiffness, ratio, hidden=0.0, duration=60.0, phase=1.0
):
    """Press with a latency [s] that no stamp shows, and errors of the prediction of 0.5 mm RMS."""

    def error(time):
        return 5e-4 * (math.sin(2.0 * time) + math.sin(5.1 * time + phase))

    readings = deque([0.0] * round(hidden / PERIOD))

    def late(_, force):
        readings.append(force)
        return readings.popleft()

    def wall(time):
        return WALL + error(time)

    def around(time):
        return Surroundings(rail_y=error(time + HORIZON * PERIOD))

    assumed = max(stiffness / ratio, ContactSettings.LEAST_STIFFNESS)
    return press(
        stiffness, duration, sensor=late, stiffness=assumed, wall=wall, around=around
    )


@pytest.mark.parametrize('stiffness', [600.0, 2000.0, 5000.0])
@pytest.mark.parametrize('ratio', [1.0 / 3.0, 1.0, 2.0, 3.0])
def test_contact_up_to_three_times_the_parameter_is_held(stiffness, ratio):
    run = press_with_prediction_errors(stiffness, ratio)
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces.max() < 1.5 * SETTINGS.force
    assert run.forces[-1500:].std() < 0.1 * SETTINGS.force


def is_steady_or_retracts(run):
    """Return whether the force is held well, or an unsteady force made the head retract."""
    if run.pressing.mode is PressMode.HOLDING:
        errors = run.forces[-1000:] - SETTINGS.force
        return math.sqrt((errors**2).mean()) < 0.15 * SETTINGS.force
    reason = run.pressing.reason
    return 'the force chatters' in reason or 'the force oscillates' in reason


@pytest.mark.parametrize('stiffness', [600.0, 1000.0, 2000.0, 5000.0])
@pytest.mark.parametrize('hidden', [0.05, 0.1, 0.2, 0.3, 0.45, 0.6])
def test_hidden_latency_never_exceeds_45_newtons(stiffness, hidden):
    run = press_with_prediction_errors(stiffness, 1.0, hidden, 40.0, phase=hidden)
    assert run.forces.max() < 1.5 * SETTINGS.force
    assert is_steady_or_retracts(run)
    assert hidden > 0.05 or run.pressing.mode is PressMode.HOLDING


@pytest.mark.parametrize('stiffness', [2500.0, 5000.0])
@pytest.mark.parametrize('ratio', [0.25, 4.0, 5.0, 6.0])
def test_wrong_stiffness_never_exceeds_45_newtons(stiffness, ratio):
    run = press_with_prediction_errors(stiffness, ratio, 0.0, 40.0)
    assert run.forces.max() < 1.5 * SETTINGS.force
    assert is_steady_or_retracts(run)


@pytest.mark.parametrize(('step', 'speed'), [(0.01, 0.016), (-0.003, SPEED)])
def test_head_moves_slower_towards_the_wall_than_away(step, speed):
    """On 1.25 N/mm, a force that rises by 20 N/s needs 16 mm/s; the wall moves after 15 s."""

    def wall(time):
        return WALL + step * (time > HELD)

    run = press(1250.0, 18.0, stiffness=1250.0, wall=wall)
    moved = abs(np.diff(run.offsets[round(HELD / PERIOD) :]))
    assert moved.max() <= speed * PERIOD + 1e-12
    assert moved.max() > 0.9 * min(speed, 0.02) * PERIOD


def test_first_touch_and_small_force_do_not_oscillate():
    run = press(5000.0, stiffness=5000.0, force=10.0)
    assert run.pressing.mode is PressMode.HOLDING
    assert not run.pressing.last_reason


@pytest.mark.parametrize('stiffness', [600.0, 5000.0])
@pytest.mark.parametrize('force', [5.0, 16.0])
def test_lowered_force_is_reached_without_a_retract(stiffness, force):
    pressing = press(stiffness, 20.0, stiffness=stiffness).pressing
    pressing.settings = replace(pressing.settings, force=force)
    is_held_at_once = pressing.is_force_reached
    run = press(stiffness, 10.0, pressing=pressing, start=20.0)
    assert run.pressing.mode is PressMode.HOLDING
    assert not run.pressing.last_reason
    assert run.forces[-300:].mean() == pytest.approx(force, abs=0.5)
    assert not is_held_at_once
    assert run.pressing.is_force_reached


@pytest.mark.parametrize('stiffness', [600.0, 5000.0])
@pytest.mark.parametrize('start', [8.0, 25.0])
def test_raised_force_rises_within_the_ramp_time(stiffness, start):
    """The operator raises the force while it is held, or during its first rise."""
    pressing = press(stiffness, start, stiffness=stiffness).pressing
    before = pressing.desired
    pressing.settings = replace(pressing.settings, force=60.0)
    run = press(stiffness, 14.0, pressing=pressing, start=start)
    rises = np.diff(run.desired, prepend=before)
    steepest = 0.5 * math.pi * (60.0 - before) / SETTINGS.ramp_time
    assert rises.max() < 1.05 * steepest * PERIOD
    assert run.desired[round(4.0 / PERIOD)] < 50.0
    assert run.desired[-1] == 60.0
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces[-100:].mean() == pytest.approx(60.0, rel=0.03)
    assert not run.pressing.last_reason


def test_fade_of_the_correction_does_not_change_the_force():
    def fade(time):
        return 0.03 * (1.0 - math.exp(-2.0 * max(time - HELD, 0.0)))

    def wall(time):
        return WALL + fade(time)

    def around(time):
        speed = (fade(time + 0.06) - fade(time + 0.05)) / PERIOD
        return Surroundings(rail_y=fade(time + HORIZON * PERIOD), fading_y=speed)

    run = press(5000.0, stiffness=5000.0, wall=wall, around=around)
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces.max() < 1.2 * SETTINGS.force


@pytest.mark.parametrize(
    ('sensor', 'reason'),
    [
        (lambda time, force: force if time < HELD else 20.0, 'is frozen at 20.0 N'),
        (lambda time, force: 0.0, 'is frozen'),
        (lambda time, force: -force, 'the wall pulls'),
        (lambda time, force: force + 40.0 * (time > HELD), 'is above the limit 60 N'),
        (
            lambda time, force: force + 12.0 * (time > HELD) * (-1) ** int(20.0 * time),
            'the force chatters',
        ),
    ],
)
def test_fault_makes_the_head_retract_with_its_reason(sensor, reason):
    run = press(600.0, sensor=sensor)
    assert run.pressing.mode is PressMode.RETRACTED
    assert not run.pressing.is_force_reached
    assert reason in run.pressing.reason == run.pressing.last_reason
    assert run.pressing.outcome == f'retracted: {run.pressing.reason}'
    assert run.offsets[-1] <= -SETTINGS.retreat
    assert run.forces.max() < 80.0


def test_old_reading_is_ignored_after_a_clock_step():
    pressing = press(600.0).pressing
    press(600.0, 1.0, pressing=pressing, start=END - 1.5, sensor=lambda *_: None)
    assert pressing.mode is PressMode.RETRACTED
    assert 'no contact_wrench for 0.2 s' in pressing.last_reason


def test_rejected_wrench_is_reported_with_its_cause():
    pressing = press(600.0).pressing

    def reject(time: float, _: float) -> None:
        error = InputError('frame', "contact_wrench is in frame 'map'; next: a")
        pressing.rejections.add(time, error)

    press(600.0, 1.0, pressing=pressing, start=END, sensor=reject)
    assert pressing.mode is PressMode.RETRACTED
    reason = "no valid contact_wrench for 0.2 s: contact_wrench is in frame 'map'"
    assert pressing.reason == f'{reason}; next: a'
    press(600.0, 3.0, pressing=pressing, start=END + 1.0, sensor=lambda *_: None)
    silence = 'no contact_wrench for 0.2 s; next: check the force sensor'
    assert pressing.reason == silence


def distance_after_a_step(stiffness):
    """Return the tracked distance [m], 50 ms after the wall has moved by 1 mm."""
    tracker = WallTracker()
    for k in range(6):
        wall = 1e-3 * (k > 0)
        tracker.note_place(k * PERIOD, 0.0)
        tracker.add_measurement(k * PERIOD, -stiffness * wall, stiffness)
    return tracker.distance(5 * PERIOD)


def test_wall_is_tracked_slower_on_a_soft_brush():
    """The noise of the distance is that of the force, divided by the stiffness."""
    assert 0.0 < distance_after_a_step(600.0) < 0.7 * distance_after_a_step(5000.0)


def test_brush_that_bottoms_out_makes_the_head_retract():
    pressing = press(600.0, force=40.0).pressing
    run = press(1e5, 10.0, pressing=pressing, start=END, wall=lambda time: WALL + 0.066)
    assert run.pressing.mode is PressMode.RETRACTED
    assert run.pressing.reason


def stuck(time, force):
    return 20.0 if HELD < time < HELD + 1.0 else force


def test_fault_is_cleared_between_two_cycles():
    """The operator may disable and enable pressing within a cycle, or without a goal."""
    pressing = press(600.0, 40.0, sensor=stuck).pressing
    assert pressing.reason
    pressing.change_settings(replace(SETTINGS, enabled=False))
    pressing.change_settings(SETTINGS)
    assert pressing.outcome == (
        'not pressing: the head presses from its next goal on; next: send a goal'
    )
    pressing.follow_goal()
    again = press(600.0, pressing=pressing, start=40.0)
    assert again.pressing.mode is PressMode.HOLDING


def test_fault_lasts_until_pressing_is_disabled_and_enabled():
    pressing = press(600.0, 40.0, sensor=stuck).pressing
    assert pressing.mode is PressMode.RETRACTED
    pressing.change_settings(replace(SETTINGS, enabled=False))
    off = press(600.0, 5.0, pressing=pressing, start=40.0)
    assert pressing.mode == PressMode.OFF
    assert pressing.outcome == 'not pressing'
    assert off.offsets[-1] == -SETTINGS.retreat
    assert pressing.is_force_reached
    pressing.change_settings(SETTINGS)
    press(600.0, 1.0, pressing=pressing, start=45.0)
    assert pressing.mode is PressMode.OFF
    pressing.follow_goal()
    again = press(600.0, pressing=pressing, start=46.0)
    assert again.pressing.mode is PressMode.HOLDING


@pytest.mark.parametrize('stiffness', [600.0, 2000.0, 5000.0])
def test_disabled_pressing_leaves_the_wall_before_its_goal(stiffness):
    """The goal lies 35 mm behind the wall, where the head must not go without a force law."""
    pressing = press(
        stiffness, 25.0, stiffness=stiffness, wall=lambda _: -0.035
    ).pressing
    assert pressing.mode is PressMode.HOLDING
    pressing.change_settings(replace(pressing.settings, enabled=False))
    run = press(stiffness, 10.0, pressing=pressing, start=25.0, wall=lambda _: -0.035)
    assert run.forces.max() < 35.0
    assert run.offsets[-1] == pytest.approx(-SETTINGS.retreat)
    assert run.forces[-1] == 0.0


@pytest.mark.parametrize(
    ('lost', 'reason'),
    [
        (
            {'sensor': lambda time, force: None if HELD < time < BACK else force},
            'no contact_wrench',
        ),
        (
            {
                'around': lambda time: Surroundings(
                    silence='the estimator is silent' * (HELD < time < BACK)
                )
            },
            'the estimator is silent',
        ),
    ],
)
def test_lost_input_ends_in_a_retract_and_another_approach(lost, reason):
    run = press(600.0, 40.0, **lost)
    assert run.offsets[round(HELD / PERIOD) :].min() <= -SETTINGS.retreat
    assert run.pressing.mode is PressMode.HOLDING
    assert reason in run.pressing.last_reason
    assert not run.pressing.reason


def test_head_searches_for_a_wall_that_falls_away():

    def falling(time):
        return WALL + min(max(0.1 * (time - 20.0), 0.0), 0.02)

    run = press(2000.0, 45.0, stiffness=2000.0, wall=falling)
    assert run.pressing.mode is PressMode.HOLDING
    assert run.forces[2050:].max() < 45.0


@pytest.mark.parametrize('bias', [8.0, -8.0])
def test_bias_of_the_sensor_is_removed_off_the_wall(bias):
    run = press(600.0, sensor=lambda time, force: force + bias)
    mean = run.forces[-500:].mean()
    assert mean == pytest.approx(SETTINGS.force, rel=0.04)


@pytest.mark.parametrize(
    ('bias', 'beyond', 'reason'),
    [
        (15.0, 0.0, 'N is beyond 10 N'),
        (0.0, 0.06, 'the zero of contact_wrench is being measured'),
    ],
)
def test_head_waits_until_the_zero_is_known(bias, beyond, reason):
    run = press(
        600.0,
        8.0,
        sensor=lambda time, force: force + bias,
        around=lambda time: Surroundings(beyond=beyond),
    )
    pressing = run.pressing
    assert pressing.mode is PressMode.RETRACTED
    assert reason in pressing.reason


def test_offset_stops_at_the_workspace_limit():
    limited = Surroundings(saturation_error=Pose(0.0, 0.001, 0.0))
    run = press(600.0, 8.0, wall=lambda time: 1.0, around=lambda time: limited)
    assert np.ptp(run.offsets) == 0.0


@pytest.mark.parametrize(
    ('enabled', 'tilt', 'turned'),
    [(True, 0.09, 0.0567), (True, 0.02, 0.0), (False, 0.09, 0.0)],
)
def test_yaw_yields_to_a_moment_beyond_the_dead_band(enabled, tilt, turned):
    """On a brush of 50 mm, the friction of 30 N causes 0.45 N m: 0.033 rad at 13.5 N m/rad."""

    def moment(yaw):
        return 13.5 * (yaw - tilt)

    yaws = press(600.0, 30.0, yaw_enabled=enabled, moment=moment).yaws
    assert yaws[-1] == pytest.approx(turned, abs=2e-3)
    assert abs(np.diff(yaws)).max() <= Pressing.YAW_SPEED * PERIOD + 1e-12


def hold(ratio, wall, duration=30.0):
    """Return the force error on a wall with a ratio of the law's stiffness, without tracker."""
    law = ForceLaw()
    offsets = []
    forces = []
    stiffness = 2000.0
    for k in range(round(duration / PERIOD)):
        time = (k + HORIZON) * PERIOD
        speed = law.velocity(0.0, stiffness / ratio, time)
        law.move(time, law.offset + PERIOD * speed)
        offsets.append(law.offset)
        reached = offsets[max(k - HORIZON, 0)]
        forces.append(stiffness * (reached + wall(k * PERIOD)))
        if k >= LATENCY:
            law.add_measurement((k - LATENCY) * PERIOD, forces[k - LATENCY])
    return np.array(forces)


@pytest.mark.parametrize('frequency', [0.1, 0.33, 1.0, 3.0])
def test_force_law_passes_wall_motion_as_loop_gain_predicts(frequency):
    delay = PERIOD * (HORIZON + LATENCY)
    s = 2j * math.pi * frequency
    late = cmath.exp(-s * delay)
    integral = s * ForceLaw.TIME_CONSTANT * delay
    expected = abs(1.0 / (1.0 + late / (integral + 1.0 - late)))
    force = hold(1.0, lambda time: 1e-3 * math.sin(math.tau * frequency * time))
    amplitude = force[1000:].std() * math.sqrt(2.0)
    assert amplitude / 2.0 == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize(
    ('ratio', 'settles'), [(0.1, True), (1.0, True), (3.5, True), (5.0, False)]
)
def test_force_law_is_stable_up_to_four_times_stiffness(ratio, settles):
    force = abs(hold(ratio, lambda time: 1e-3 * min(time, 1.0)))
    is_settled = force[-300:].max() < 0.1 * force[:300].max()
    assert is_settled == settles


@pytest.fixture
def felt():
    return Contact(ContactSettings(), LateralSettings(enabled=True))


def test_wrench_is_turned_by_the_yaw_of_the_head(felt):
    felt.shift(NOW, NOW, 0.0, REFERENCE, Surroundings())
    felt.add_wrench(NOW, NOW, PRESSED)
    along_wall_normal = 30.0 * math.cos(0.3) - 3.0 * math.sin(0.3)
    assert felt.pressing.monitor.force == pytest.approx(along_wall_normal)
    assert felt.pressing.moment == -0.5


def test_disabled_contact_leaves_the_reference():
    felt = Contact(ContactSettings(), LateralSettings())
    felt.add_wrench(NOW, NOW, PRESSED)
    felt.add_lateral_offset(NOW, NOW, 0.02)
    assert felt.shift(NOW, NOW, 0.01, REFERENCE, Surroundings()) == REFERENCE


def slide(felt, slip, duration, saturation_error=0.0, latency=10):
    """Return the head's remaining offset after a slip [m]."""
    offsets = [0.0] * latency
    for k in range(round(duration / PERIOD)):
        now = NOW + k * PERIOD
        felt.add_lateral_offset(now, now, offsets[-latency])
        felt.shift(
            now, now, PERIOD, REFERENCE, Surroundings(Pose(saturation_error, 0.0, 0.0))
        )
        offsets.append(slip - felt.present.x)
    return np.array(offsets)


def test_slip_is_corrected_without_ringing(felt):
    offsets = slide(felt, 0.02, 6.0)
    assert abs(offsets[-100:]).max() < 1e-4
    assert offsets.min() > -1e-3


def test_old_slip_is_ignored_after_a_clock_step(felt):
    felt.add_lateral_offset(NOW, NOW, 0.02)
    felt.shift(NOW - 1.0, NOW - 1.0, PERIOD, REFERENCE, Surroundings())
    assert felt.present.x == 0.0


def test_shift_is_bounded_in_speed_and_range_and_returns(felt):
    slide(felt, 1.0, 8.0)
    assert felt.present.x == pytest.approx(0.1)
    offsets = slide(felt, 0.0, 8.0)
    assert abs(np.diff(offsets[10:])).max() <= 0.05 * PERIOD + 1e-12
    assert abs(offsets[-1]) < 1e-4


@pytest.mark.parametrize('saturation_error', [0.01, 0.0, -0.01])
def test_disabled_regulator_returns_its_shift(felt, saturation_error):
    slide(felt, 1.0, 8.0)
    felt.lateral = LateralSettings()
    assert felt.lasting_shift.x == 0.0
    assert felt.release_time == pytest.approx(2.0)
    offsets = slide(felt, 1.0, 3.0, saturation_error)
    assert felt.present.x == felt.release_time == 0.0
    assert abs(np.diff(offsets[10:])).max() <= 0.05 * PERIOD + 1e-12


@pytest.mark.parametrize(('saturation_error', 'moves'), [(0.01, False), (-0.01, True)])
def test_shift_stops_at_the_workspace_limit(felt, saturation_error, moves):
    slide(felt, 0.02, 1.0, saturation_error)
    assert (felt.present.x > 0.0) == moves


@pytest.mark.parametrize(
    ('add', 'possible', 'not_finite'),
    [
        (Contact.add_wrench, PRESSED, Wrench(math.nan, 0.0, 0.0)),
        (Contact.add_lateral_offset, 0.0, math.nan),
    ],
)
def test_impossible_measurement_is_rejected(felt, add, possible, not_finite):
    felt.add_wrench(NOW, NOW - 0.05, PRESSED)
    felt.add_lateral_offset(NOW, NOW - 0.05, 0.0)
    for age, measured, reason in (
        (0.0, not_finite, 'not_finite'),
        (0.5, possible, 'stale'),
        (-0.1, possible, 'future'),
        (0.05, possible, 'out_of_order'),
        (0.06, possible, 'out_of_order'),
    ):
        with pytest.raises(InputError) as caught:
            add(felt, NOW, NOW - age, measured)
        assert caught.value.reason == reason


@pytest.mark.parametrize(
    ('add', 'measured', 'words'),
    [
        (
            Contact.add_wrench,
            Wrench(0.0, -1e200, 0.0),
            'contact_wrench fy = -1e+200 N is beyond the limit ±10000 N',
        ),
        (
            Contact.add_wrench,
            Wrench(0.0, -30.0, 2e4),
            'contact_wrench mz = 2e+04 N m is beyond the limit ±10000 N m',
        ),
        (
            Contact.add_lateral_offset,
            12.0,
            'lateral_offset x = 12 m is beyond the limit ±2 m',
        ),
    ],
)
def test_measurement_beyond_physical_limits_is_rejected(felt, add, measured, words):
    with pytest.raises(InputError) as caught:
        add(felt, NOW, NOW, measured)
    assert caught.value.reason == 'range'
    assert str(caught.value) == f'{words}; next: check unit and range of the sensor'
    add_possible = partial(add, felt, NOW, NOW)
    add_possible(0.0 if add is Contact.add_lateral_offset else PRESSED)


def test_largest_wrench_raises_no_error():
    felt = Contact(SETTINGS, LateralSettings())
    for k in range(100):
        force = -1e4 if k % 2 else 1e4
        felt.add_wrench(NOW + k * PERIOD, NOW + k * PERIOD, Wrench(0.0, force, 0.0))
    assert 'chatters by' in felt.pressing.monitor.fault(2e4)
