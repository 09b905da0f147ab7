"""Causes that stop all three axes: frames, targets, measured positions, the operator, errors."""

from __future__ import annotations

from dataclasses import replace
import math

from bus_world import (
    at_rest,
    axes_at,
    configured,
    HOME,
    SETTINGS,
    SITUATIONS,
    SWITCH_HOMING,
)
import pytest

from facade_manipulator.canopen import cob_ids, pdo
from facade_manipulator.control_loop.loop_channel import LoopSetup
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller import REQUESTS
from facade_manipulator.drives.exchange import LONGEST_WAIT
from facade_manipulator.drives.snapshot import ControllerState, Remedy
from facade_manipulator.drives.states import Controlword, POWERED_STATES, State
from facade_manipulator.errors import BusError, DriveError, LimitError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.limits import MotionLimits

# --- frames

RPDOS = tuple(pdo.RPDO1.cob_id(node) for node in (1, 2, 3))
OVERCURRENT = b'\x10\x23' + bytes(6)


def is_quick_stop(frame) -> bool:
    return frame.cob_id in RPDOS and frame.data[0] == Controlword.QUICK_STOP


def test_restarted_node_receives_no_process_data(make_rig):
    rig = make_rig(settings=replace(SETTINGS, step_timeout=0.4))
    at_rest(rig)
    rig.forge(0, bytes([129, 2]))  # NMT reset
    rig.until(lambda: 'restarted' in rig.snapshot.cause)
    rig.cycles(3)
    rig.frames()
    rig.cycles(5)
    sent = {frame.cob_id for frame in rig.frames()}
    assert 0x202 not in sent
    assert {0x201, 0x203} <= sent


@pytest.mark.parametrize('share', [0.05, 0.3, 0.78, 0.85, 0.95, 0.99])
def test_stop_shortly_before_sync_waits_for_this_sync(make_rig, share):
    """Otherwise one drive might latch it now and its neighbour a period later, at full speed."""
    rig = make_rig(has_kernel_sync=True)
    at_rest(rig)
    sync = rig.bus.next_sync
    period = rig.settings.period
    ahead = sync + share * period - rig.clock.now
    rig.later(ahead, lambda: rig.forge(cob_ids.EMERGENCY + 1, OVERCURRENT))
    rig.frames()
    rig.cycles(4)
    stops = [frame for frame in rig.frames() if is_quick_stop(frame)]
    times = [frame.time - sync for frame in stops[:3]]
    assert max(times) - min(times) < 0.01 * period
    assert (times[0] >= period) is (share > 0.8)


# --- targets and measured positions


def fail(positions):
    raise RuntimeError('out of ideas')


@pytest.mark.parametrize(
    ('distort', 'message'),
    [
        (lambda p: (p[0], math.inf, p[2]), 'q2 = inf is not a finite number'),
        (fail, 'RuntimeError: out of ideas'),
    ],
)
def test_bad_target_or_failing_source_stops_all(rig, distort, message):
    at_rest(rig)
    sample = rig.follower.sample
    rig.follower.sample = lambda time: distort(HOME)
    rig.until_stopped()
    assert message in rig.snapshot.cause
    rig.follower.sample = sample
    rig.request('clear_faults', 'activate')


def test_target_beyond_the_check_stops_and_prevents_activation(make_rig):
    bounds = [HOME[0] + 0.005]

    def check(positions):
        if positions[0] > bounds[-1]:
            raise LimitError('q1', positions[0], bounds[-1], 'm', 'above')

    rig = make_rig(check_targets=check)
    rig.stream()
    at_rest(rig)
    rig.until_stopped()
    assert 'q1 = -0.09' in rig.snapshot.cause
    assert rig.carriages[0] < HOME[0] + 0.006
    rig.request('clear_faults')
    bounds.append(-0.2)
    assert 'is above the limit -0.2 m' in rig.rejection('activate')
    assert rig.state is ControllerState.INACTIVE


def lose_the_bus(rig):
    rig.bus_error = BusError('can0 is bus-off; next: restart it')


def spoil_the_mechanism(rig):
    near = (HOME[0], HOME[0] + 0.001, HOME[2])
    guard = rig.controller.targets.guard
    guard.check_measured = lambda _: guard.check_targets(near)


@pytest.mark.parametrize(
    ('spoil', 'step'),
    [
        (lose_the_bus, 'restart it, then cleanup, configure, home, activate'),
        (spoil_the_mechanism, f'{Remedy.TRACKING}, then clear_faults, activate'),
    ],
)
def test_stop_for_an_error_has_one_next_step(rig, spoil, step):
    at_rest(rig)
    spoil(rig)
    rig.run(0.1)
    assert '; next: ' not in rig.snapshot.cause
    assert rig.snapshot.next_step == step


CLOSE = (-0.022, 0.022, 0.0)  # m, where a pose closes too
CLOSE_AXES = axes_at(CLOSE)


def test_carriage_lagging_into_the_gap_stops_all(make_rig):
    rig = make_rig(axes=CLOSE_AXES)
    rig.drives[2].motor.lag = 0.035
    at_rest(rig)
    rig.stream()
    rig.until_stopped()
    assert 'the measured mechanism: q3 - q1 = 0.01' in rig.snapshot.cause
    assert 'below the limit 0.015 m' in rig.snapshot.cause
    assert rig.carriages[2] - rig.carriages[0] > 0.004


# --- the operator and an own error


@pytest.mark.parametrize('is_latched', [False, True])
@pytest.mark.parametrize('is_configured', [False, True])
def test_next_step_clears_only_a_latched_prohibition(rig, is_configured, is_latched):
    following = 'configure, home, activate'
    if is_configured:
        rig.request('configure')
        following = 'home, activate'
    rig.controller.forbid_power('no message', 'send false', is_latched)
    clear = 'clear_faults, ' if is_latched else ''
    assert rig.snapshot.next_step == f'send false, then {clear}{following}'
    rig.controller.forbid_power('')
    assert rig.snapshot.next_step == following


def test_later_prohibition_replaces_the_earlier_cause(rig):
    at_rest(rig)
    rig.controller.forbid_power('no message', 'send false', is_latched=False)
    rig.until_stopped()
    rig.controller.stop('another')
    rig.controller.forbid_power('the red button is pressed')
    rig.run(0.1)
    messages = [one.message for one in rig.snapshot.causes]
    assert messages == ['the red button is pressed', 'another']


def test_power_stays_off_while_forbidden(rig):
    rig.controller.forbid_power('the red button is pressed')  # before there is a bus
    inactive_without_home = rig.request('configure')
    assert 'power: confirmed off' in inactive_without_home
    for request in ('home', 'activate'):
        assert 'the red button is pressed' in rig.rejection(request)
    rig.controller.forbid_power('')
    rig.request('home', 'activate')


@pytest.mark.parametrize(
    'situation', ['active at rest', 'active in motion', 'stopping']
)
def test_powered_drives_stop_when_power_is_forbidden(rig, situation):
    SITUATIONS[situation](rig)
    rig.controller.forbid_power('the red button is pressed')
    rig.until_stopped()
    assert rig.snapshot.cause in ('the red button is pressed', 'the operator stops')
    rig.until(lambda: rig.snapshot.power == 'confirmed off')
    rig.request('clear_faults')
    assert 'the red button is pressed' in rig.rejection('activate')
    rig.course = None
    rig.controller.forbid_power('')
    rig.request('activate')


def forbid_for_a_moment(rig):
    rig.controller.forbid_power('the red button is pressed')
    rig.controller.forbid_power('')


def stop(rig):
    rig.controller.stop('the red button is pressed')


CREEP = MotionLimits(speed=0.03, acceleration=0.3)  # permitted at every rate
STOPS = pytest.mark.parametrize('press', [forbid_for_a_moment, stop])
HALTED = {'halted': lambda rig: (at_rest(rig), rig.request('halt'))}
WITH_POWER = HALTED | {
    name: SITUATIONS[name] for name in ('homing', 'active at rest', 'active in motion')
}


@pytest.mark.long
@STOPS
@pytest.mark.parametrize('request_', [None, *sorted({*REQUESTS} - {'close'})])
@pytest.mark.parametrize('situation', WITH_POWER)
def test_stop_takes_effect_whatever_follows_at_once(
    make_rig, situation, request_, press
):
    rig = make_rig(axes=SWITCH_HOMING if situation == 'homing' else DEFAULT_AXES)
    WITH_POWER[situation](rig)
    press(rig)
    answer = rig.ask(request_) if request_ else None
    rig.until(lambda: State.OPERATION_ENABLED not in rig.drive_states, 0.1)
    rig.run(1.0)  # home and activate give power within 0.3 s
    assert State.OPERATION_ENABLED not in rig.drive_states
    if request_ == 'clear_faults':
        assert 'cleared (the red button is pressed)' in answer.result()


@STOPS
@pytest.mark.parametrize('request_', ['home', 'activate'])
def test_stop_cancels_the_request_just_before_the_stop(rig, request_, press):
    configured(rig)
    job = rig.ask(request_)
    press(rig)
    with pytest.raises(DriveError, match='the red button is pressed'):
        rig.finish(job)
    rig.run(0.5)
    assert State.OPERATION_ENABLED not in rig.drive_states


@STOPS
@pytest.mark.parametrize('rate', [10, 50, 100, 500])
def test_stop_reaches_the_bus_within_20_ms(make_rig, rate, press):
    rig = make_rig(settings=replace(SETTINGS, rate=rate), limits=CREEP)
    at_rest(rig)
    pressed = rig.clock.now + 0.0307
    rig.later(pressed - rig.clock.now, lambda: press(rig))
    rig.frames()
    rig.run(0.2)
    (first, *_) = [frame.time for frame in rig.frames() if is_quick_stop(frame)]
    assert pressed <= first <= pressed + LONGEST_WAIT + 0.001


def test_unforeseen_error_stops_drives_not_the_thread(make_rig):
    trouble = []

    def observe(snapshot):
        if trouble:
            raise KeyError(trouble.pop())

    rig = make_rig()
    rig.controller.observe = observe
    at_rest(rig)
    trouble.append('surprise')
    rig.until_stopped()
    assert "the control loop failed: KeyError: 'surprise'" in rig.snapshot.cause
    rig.request('clear_faults', 'activate')


# --- the power goes off when nothing moves

WEAK = tuple(replace(axis, stop_deceleration=0.5) for axis in DEFAULT_AXES)
SLOW = MotionLimits(speed=0.15, acceleration=0.1)
FAST = 0.08  # m/s


def test_power_stays_on_while_carriages_brake(make_rig):
    rig = make_rig(
        axes=WEAK, limits=SLOW, settings=replace(SETTINGS, ramp_timeout=10.0)
    )
    rig.stream(amplitude=0.1, rate=1.0)
    at_rest(rig)
    rig.until(lambda: min(axis.velocity for axis in rig.snapshot.axes) > FAST)
    rig.follower.hold = lambda: None  # the ramp never ends
    rig.ask('close')
    rig.until(lambda: not POWERED_STATES & {*rig.drive_states}, 15.0)
    speeds = [abs(drive.motor.velocity) for drive in rig.drives]
    assert DEFAULT_AXES[0].to_metres(max(speeds)) < 0.02


SLOWEST = MotionLimits(speed=0.0455, acceleration=0.01, jerk=0.1)


@pytest.mark.long
@pytest.mark.parametrize('request_', ['halt', 'deactivate'])
def test_slowest_permitted_braking_ends_without_a_stop(make_rig, request_):
    rig = make_rig(limits=SLOWEST)
    setup = LoopSetup(Geometry(), SETTINGS, DEFAULT_AXES, limits=SLOWEST)
    setup.stopping.check()
    rig.course = lambda time: ([0.005 * time**2] * 3, [0.01 * time] * 3)
    at_rest(rig)
    rig.until(lambda: rig.follower.motion.velocity[0] > 0.0445, 20.0)
    rig.request(request_)
    assert not rig.snapshot.causes


class RestlessSource:
    """Follower of setpoints whose targets never rest."""

    at_rest = False

    def __init__(self, follower):
        self._follower = follower

    def __getattr__(self, name):
        return getattr(self._follower, name)


def test_power_off_waits_for_targets_at_rest(rig):
    """Carriages that reverse are at rest for a moment."""
    at_rest(rig)
    rig.controller.targets.source = RestlessSource(rig.follower)
    rig.ask('deactivate')
    rig.run(0.5)
    assert rig.drive_states == [State.OPERATION_ENABLED] * 3
