"""A restart, a bad target, a stop or an error of the driver itself stops all three axes."""

from __future__ import annotations

from dataclasses import replace
import math

from bus_world import HOME, SETTINGS
from drive_faults import at_rest, configured, SITUATIONS
from drive_parts import Source
from frames import decode_rpdo1
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import POWERED_STATES
from facade_manipulator.errors import LimitError
from facade_manipulator.motion.limits import MotionLimits

# --- another master commands the network

RESET_NODE_2 = bytes([129, 2])


def test_node_that_restarts_is_not_homed(rig):
    configured(rig)
    assert rig.snapshot.unhomed == ()
    rig.forge(0, RESET_NODE_2)
    rig.until(lambda: 'restarted' in rig.all_causes)
    assert rig.snapshot.unhomed == ('q2',)


def test_restarted_node_is_sent_no_process_data(make_rig):
    rig = make_rig(settings=replace(SETTINGS, step_timeout=0.4))
    at_rest(rig)
    rig.forge(0, RESET_NODE_2)
    rig.until(lambda: 'restarted' in rig.snapshot.cause)
    rig.cycles(3)
    rig.frames()
    rig.cycles(5)
    sent = {frame.cob_id for frame in rig.frames()}
    assert 0x202 not in sent
    assert {0x201, 0x203} <= sent


# --- the source of the targets, the operator

def fail(positions):
    raise RuntimeError('out of ideas')


@pytest.mark.parametrize(('distort', 'message'), [
    (lambda p: (p[0], math.inf, p[2]), 'target of q2 = inf m is not a finite number'),
    (fail, 'RuntimeError: out of ideas')])
def test_bad_target_or_failing_source_stops_all(make_rig, distort, message):
    source = Source()
    rig = make_rig(source=source)
    at_rest(rig)
    rig.frames()
    source.distort = distort
    rig.until_stopped()
    assert message in rig.snapshot.cause
    for frame in rig.frames():
        if (node := frame.cob_id - pdo.RPDO1.cob_id(0)) in (1, 2, 3):
            target = decode_rpdo1(frame.data).target_counts
            assert DEFAULT_AXES[node - 1].to_metres(target) == pytest.approx(
                HOME[node - 1], abs=1e-4)
    source.distort = None
    rig.request('clear_faults', 'activate')


def test_callers_check_of_targets_is_the_last_word(make_rig):
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
    assert 'is above the bound -0.2 m' in rig.rejection('activate')
    assert rig.state is ControllerState.INACTIVE


def test_no_power_comes_on_while_forbidden(rig):
    rig.controller.forbid_power('the red button is pressed')  # before there is a bus
    inactive_without_home = rig.request('configure')
    assert 'power: confirmed off' in inactive_without_home
    for request in ('home', 'activate'):
        assert 'the red button is pressed' in rig.rejection(request)
    rig.controller.forbid_power('')
    rig.request('home', 'activate')


@pytest.mark.parametrize('situation', ['active at rest', 'active in motion', 'stopping'])
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


def test_power_is_not_cut_while_carriages_brake(make_rig):
    rig = make_rig(axes=WEAK, limits=SLOW, settings=replace(SETTINGS, ramp_timeout=10.0))
    rig.stream(amplitude=0.1, rate=1.0)
    at_rest(rig)
    rig.until(lambda: min(axis.velocity for axis in rig.snapshot.axes) > FAST)
    rig.follower.hold = lambda: None  # the ramp never ends
    rig.ask('close')
    rig.until(lambda: not POWERED_STATES & {*rig.drive_states}, 15.0)
    speeds = [abs(drive.motor.velocity) for drive in rig.drives]
    assert DEFAULT_AXES[0].to_metres(max(speeds)) < 0.02


def test_stopped_drives_are_asked_once_for_errors(make_rig):
    rig = make_rig()
    SITUATIONS['active in motion'](rig)
    rig.drives[1].inject_fault(0x8611)
    rig.drives[2].is_silent = True  # holds nothing up
    rig.until_stopped()
    notes = rig.until(lambda: [note for note in rig.snapshot.notes
                                if 'after the stop' in note])
    assert [note.split()[0] for note in notes] == ['q1', 'q2']
    assert '603Fh 8611h, 1003h:01 00008611h' in notes[1]
    rig.drives[2].is_silent = False
