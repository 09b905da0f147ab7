"""Compensator: corrected poses for goals on the wall, disturbances and head poses."""

from contextlib import suppress
import math

from compensation.compensated_head import CompensatedHead, PERIOD, START
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from facade_manipulator.compensation.contact import LateralSettings
from facade_manipulator.compensation.contact_phases import ContactSettings, PressMode
from facade_manipulator.compensation.correction import CorrectionMode
from facade_manipulator.compensation.pose_compensator import (
    CompensationSettings,
    Compensator,
    CompensatorSettings,
)
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.kinematics import (
    add,
    Geometry,
    Mechanism,
    Pose,
    relative,
    Wrench,
)
from facade_manipulator.parameters import parameter_fields

pytestmark = pytest.mark.long

GOAL = Pose(0.05, 0.25, 0.05)
ASIDE = Pose(-0.1, 0.25, 0.0)
RAIL = Pose(0.02, -0.005, 0.01)
BEHIND_WALL = Pose(0.0, 0.22, 0.0)
STIFF_BRUSH = ContactSettings(enabled=True, stiffness=5000.0)


def sway(time):
    x = 0.08 * math.sin(0.7 * time)
    return Pose(x, 0.01 * math.sin(1.2 * time), 0.0)


@settings(max_examples=25)  # each checks twenty cycles
@given(
    st.floats(-0.1, 0.1),
    st.floats(-0.03, 0.03),
    st.floats(-0.08, 0.08),
    st.floats(-0.1, 0.1),
    st.floats(0.23, 0.27),
    st.floats(-0.05, 0.05),
)
def test_disturbance_and_corrected_pose_compose_to_the_reference(
    dx, dy, dtheta, x, y, theta
):
    head = CompensatedHead(Pose(dx, dy, dtheta), Pose(x, y, theta))
    for output in head.run(0.8).outputs[-20:]:
        wanted = add(output.pose, output.saturation_error)
        compensated = relative(output.disturbance, output.reference)
        assert wanted == pytest.approx(tuple(compensated), abs=1e-12)


def test_update_without_a_goal_returns_no_pose():
    run = CompensatedHead().run(0.5)
    assert set(run.outputs) == {None}
    with pytest.raises(ManipulatorError, match='no goal'):
        run.compensator.hold(run.now)


def test_lag_of_the_head_extends_the_prediction():
    run = CompensatedHead(sway, GOAL).run(12.0)
    run.compensator.following.lag = 0.04
    run.run(0.1)
    assert run.last.reach_time == run.last.time + 0.04
    expected = sway(run.last.reach_time).x
    assert run.last.disturbance.x == pytest.approx(expected, abs=5e-4)


def test_axis_is_held_at_its_workspace_limit_and_returns():

    def forth_and_back(time):
        return Pose(0.45 * math.sin(0.4 * (time - START)), 0.0, 0.0)

    run = CompensatedHead(forth_and_back, Pose(0.0, 0.25, 0.0)).run(16.0)
    for output in run.outputs[::7]:
        Mechanism(Geometry()).certify(output.pose)
    errors = abs(np.array([output.saturation_error for output in run.outputs]))
    assert errors[:, 0].max() > 1e-3 > errors[-1, 0]
    assert errors[:, 1].max() == 0.0
    changes = np.diff(run.all('pose'), 2, axis=0)
    assert abs(changes).max() < 1e-3
    assert run.on_wall.x == pytest.approx(0.0, abs=5e-3)


def test_every_part_with_a_live_parameter_can_change():
    defaults = CompensatorSettings()
    compensator = Compensator(Geometry(), defaults)
    for part, settings_of_part in defaults._asdict().items():
        if any(info.live for info in parameter_fields(type(settings_of_part)).values()):
            getattr(compensator, f'change_{part}')(settings_of_part)


@pytest.mark.parametrize('follows', [True, False])
def test_path_restarts_at_a_head_that_does_not_follow(follows):
    lag = 0.0 if follows else None
    run = CompensatedHead(goal=Pose(0.1, 0.25, 0.0), head=ASIDE, lag=lag)
    away = abs(run.run(4.0).all('pose')[:, 0] - ASIDE.x)
    if follows:
        assert run.compensator.initialisations == 1
        assert run.last.pose == pytest.approx((0.1, 0.25, 0.0), abs=1e-9)
        return
    assert run.compensator.initialisations > 2
    assert away.max() < 0.2
    assert away[200:].min() < 1e-6


def test_goal_error_vanishes_under_a_constant_disturbance():
    run = CompensatedHead(RAIL, lag=0.0)
    compensator = run.compensator
    assert compensator.goal_error(run.now) is None
    compensator.set_goal(GOAL)
    run.run(5.0)
    assert run.last.time == pytest.approx(run.now + CompensationSettings().lead)
    assert run.on_wall == pytest.approx(tuple(GOAL), abs=2e-4)
    assert max(map(abs, compensator.goal_error(run.now))) < 1e-4
    assert compensator.path_time(run.now) < 0.0
    aside = relative(RAIL, GOAL._replace(x=GOAL.x - 0.03))
    compensator.following.add_head(run.now, run.now + 1e-3, aside)
    assert compensator.goal_error(run.now).x == pytest.approx(0.03, abs=1e-4)
    # the pose of the head is too old
    assert compensator.goal_error(run.now + 5.0) is None


@pytest.mark.parametrize(('lag', 'most'), [(0.0, 0.61), (0.04, 0.63)])
def test_hold_brakes_within_the_limits_and_stays(lag, most):
    run = CompensatedHead(RAIL, ASIDE, lag=lag).run(8.0)
    run.compensator.set_goal(GOAL)
    begin = run.run(0.6).last.reference
    place = run.compensator.hold(run.now)
    held = len(run.outputs)
    run.run(3.0)
    outputs = run.outputs[held - 3 :]
    x = np.array([output.reference.x for output in outputs])
    assert run.compensator.goal == place != GOAL
    assert begin.x < place.x < GOAL.x
    assert abs(np.diff(x, 2)).max() / PERIOD**2 < most
    assert math.dist(run.last.reference, place) < 1e-6


def test_hold_drops_a_goal_that_no_cycle_has_followed():
    run = CompensatedHead(RAIL, GOAL, ASIDE)
    assert run.compensator.hold(run.now) is None
    assert set(run.run(0.1).outputs) == {None}


def test_hold_without_a_path_to_rest_drops_the_goal(monkeypatch):
    run = CompensatedHead(RAIL, GOAL).run(0.1)
    run.compensator.contact.pressing.mode = PressMode.HOLDING

    def fail(*_):
        raise ManipulatorError('no jerk-limited path; next: choose another goal')

    monkeypatch.setattr(run.compensator._reference, 'stop', fail)
    with pytest.raises(ManipulatorError, match='no jerk-limited path; the goal was'):
        run.compensator.hold(run.now)
    assert run.run(PERIOD).last is None
    assert run.compensator.contact.pressing.mode is PressMode.OFF


@pytest.mark.parametrize('step', [-3600.0, -5.0, -0.6, 5.0, 3600.0])
def test_clock_step_keeps_correction_active_without_a_jump(step):
    run = CompensatedHead(sway, GOAL, relative(sway(START), GOAL), lag=0.0)
    before = run.run(5.0).count - run.accepted
    run.set_by = step
    run.run(6.0)
    assert run.compensator.correction.mode is CorrectionMode.ACTIVE
    assert run.on_wall == pytest.approx(tuple(GOAL), abs=4e-3)
    steps = np.diff(run.all('pose')[:, :2], axis=0)
    assert abs(steps).max() < 0.02
    assert run.count - run.accepted - before < (5 if step == -3600.0 else 100)


@pytest.mark.parametrize(
    ('variances', 'reason'),
    [
        (
            None,
            'no valid estimate for more than 0.5 s: the estimator is silent; '
            'next: check the estimator',
        ),
        (
            (0.0, 1e6, 0.0),
            'the estimate of y or theta is too uncertain; next: check the estimator',
        ),
    ],
)
def test_lost_estimate_retracts_the_head_with_its_reason(variances, reason):
    head = CompensatedHead(
        Pose(0.02, 0.0, 0.01),
        Pose(0.0, 0.25, 0.0),
        Pose(0.0, 0.27, 0.0),
        lag=0.0,
        contact=ContactSettings(enabled=True),
    )
    run = head.run(4.0)
    pressing = run.compensator.contact.pressing
    pressing.mode = PressMode.HOLDING
    pressing.ramp.desired = pressing.settings.force
    run.variances = variances
    for cycle in range(70):  # less than 1.05 s: the correction continues
        wrench = Wrench(0.0, -30.0 - 0.01 * (cycle % 3), 0.0)
        with suppress(ManipulatorError):
            run.compensator.contact.add_wrench(run.now, run.now, wrench)
        run.run(PERIOD)
    assert pressing.mode == PressMode.RETRACTED
    assert pressing.last_reason == reason


@pytest.mark.parametrize('lag', [0.0, 0.03])
def test_contact_has_the_instant_at_which_the_head_arrives(lag):
    """A force measured at a stamp belongs to the offset that the head has then."""
    run = CompensatedHead(
        goal=Pose(0.0, 0.25, 0.0), contact=ContactSettings(enabled=True)
    )
    run.compensator.following.lag = lag
    run.run(0.5)
    contact = run.compensator.contact
    newest = contact.pressing.normal.law._totals.newest()
    assert newest == ((run.last.reach_time, contact.present.y),)


def test_contact_settings_change_without_a_jump():
    run = CompensatedHead(goal=GOAL).run(1.0)
    run.compensator.change_contact(ContactSettings(enabled=True))
    run.compensator.change_lateral(LateralSettings(enabled=True))
    run.compensator.set_goal(GOAL)
    run.run(2.0).compensator.change_contact(ContactSettings())
    y = run.run(2.0).all('pose')[:, 1]
    assert y.min() == pytest.approx(GOAL.y - 0.05)
    assert y[-1] == pytest.approx(GOAL.y - 0.05)
    assert abs(np.diff(y)).max() < 0.2 * PERIOD
    run.compensator.set_goal(GOAL)
    y = run.run(2.0).all('pose')[:, 1]
    assert y[-1] == pytest.approx(GOAL.y)
    assert abs(np.diff(y)).max() < 0.2 * PERIOD


def feel(run, duration, wall=1.0):
    """Run for a time [s] with a force sensor and a brush of 5 N/mm on a wall at y [m]."""
    for cycle in range(round(duration / PERIOD)):
        run.run(PERIOD)
        force = 5000.0 * max(run.on_wall.y - wall, 0.0)
        force += 0.01 * (cycle % 3)
        wrench = Wrench(0.0, -force, 0.0)
        with suppress(InputError):
            run.compensator.contact.add_wrench(run.now, run.now, wrench)
    return run


def heights(run, first):
    """Return y of the head on the wall [m] from an output on; the rail is at rest."""
    return np.array([output.pose.y for output in run.outputs[first:]])


@pytest.mark.parametrize('wait', [0.0, 0.5, 3.0])
def test_goal_after_disabled_pressing_only_moves_the_head_back(wait):
    run = CompensatedHead(goal=BEHIND_WALL, contact=STIFF_BRUSH)
    feel(run, 25.0, wall=0.185)
    pressing = run.compensator.contact.pressing
    assert pressing.mode is PressMode.HOLDING
    run.compensator.change_contact(ContactSettings())
    first = len(run.outputs) - 1
    feel(run, wait, wall=0.185)
    run.compensator.set_goal(Pose(0.0, 0.15, 0.0))
    y = heights(feel(run, 4.0, wall=0.185), first)
    assert np.diff(y).max() < 2e-5
    assert abs(np.diff(y)).max() < 0.3 * PERIOD
    assert y[-1] == pytest.approx(0.15)


def test_pressing_enabled_live_begins_at_the_next_goal():
    run = feel(CompensatedHead(goal=BEHIND_WALL), 3.0)
    pressing = run.compensator.contact.pressing
    run.compensator.change_contact(STIFF_BRUSH)
    first = len(run.outputs)
    y = heights(feel(run, 10.0), first)
    assert np.ptp(y) < 1e-6
    assert pressing.mode is PressMode.OFF
    assert pressing.is_force_reached
    assert 'next goal' in pressing.outcome
    run.compensator.set_goal(BEHIND_WALL)
    y = heights(feel(run, 25.0, wall=0.21), first)
    assert abs(np.diff(y)).max() < 0.3 * PERIOD
    assert y.min() == pytest.approx(BEHIND_WALL.y - STIFF_BRUSH.retreat)
    assert pressing.mode is PressMode.HOLDING


@pytest.mark.parametrize(
    ('duration', 'mode'), [(3.0, PressMode.SEARCHING), (25.0, PressMode.HOLDING)]
)
@pytest.mark.parametrize('is_dropped', [False, True])
def test_hold_ends_pressing_until_the_next_goal(duration, mode, is_dropped):
    run = CompensatedHead(goal=BEHIND_WALL, contact=STIFF_BRUSH, lag=0.0)
    feel(run, duration, wall=0.185)
    pressing = run.compensator.contact.pressing
    assert pressing.mode is mode
    run.compensator.hold(run.now)
    first = len(run.outputs) - 1
    y = heights(feel(run, 10.0, wall=0.185), first)
    assert np.diff(y).max() < 2e-5
    assert pressing.mode is PressMode.OFF
    if is_dropped:
        run.compensator.drop_goal()
    run.compensator.set_goal(BEHIND_WALL)
    y = heights(feel(run, 25.0, wall=0.185), first)
    assert abs(np.diff(y)).max() < 0.3 * PERIOD
    assert pressing.mode is PressMode.HOLDING


def test_goal_after_dropped_goal_is_approached_off_the_wall():
    run = CompensatedHead(goal=BEHIND_WALL, contact=STIFF_BRUSH, lag=0.0)
    feel(run, 25.0, wall=0.185)
    pressing = run.compensator.contact.pressing
    first = len(run.outputs)
    run.compensator.drop_goal()
    run.compensator.set_goal(Pose(0.05, 0.22, 0.0))
    y = heights(feel(run, 2.0, wall=0.185), first)
    assert y.max() < 0.192
    assert y[-1] < 0.185
    feel(run, 25.0, wall=0.185)
    assert pressing.mode is PressMode.HOLDING


@pytest.mark.parametrize(
    ('settings', 'lead'),
    [
        (CompensationSettings(), 0.045),
        (CompensationSettings(rate=50.0), 0.065),
        (CompensationSettings(rate=500.0), 0.029),
        (CompensationSettings(rate=50.0, horizon=0.08), 0.08),
    ],
)
def test_lead_covers_the_delay_of_commands_unless_set(settings, lead):
    assert settings.lead == pytest.approx(lead)
