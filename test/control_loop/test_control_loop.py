"""The control loop and its node: the loop survives the node, and ends in order."""

from __future__ import annotations

from dataclasses import replace

from bus_world import HOME
from drive_faults import at_rest, configured, in_motion
from frames import decode_rpdo1
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.states import Controlword, State
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits

OFF = [State.SWITCH_ON_DISABLED] * 3
RAMP_TIME = 3.0  # s: bound of the way to rest and power off


def end(rig):
    rig.node.has_ended = True


def hang(rig):
    rig.node.feeds = False


def close(rig):
    rig.node.say('close')


@pytest.mark.parametrize(('leave', 'errors'), [(end, 1), (hang, 1), (close, 0)])
def test_node_that_leaves_at_full_speed_ends_in_ramp(make_loop, caplog, leave, errors):
    rig = make_loop(watchdog_timeout=0.3)
    in_motion(rig)
    rig.serve(0.1)
    rig.frames()
    leave(rig)
    begin = rig.clock.now
    assert rig.serve(RAMP_TIME) and rig.clock.now < begin + RAMP_TIME
    words = [decode_rpdo1(frame.data).controlword for frame in rig.frames()
             if frame.cob_id == pdo.RPDO1.cob_id(1)]
    assert Controlword.QUICK_STOP not in words and words[-1] == Controlword.DISABLE_VOLTAGE
    assert (rig.state, rig.drive_states) == (ControllerState.CLOSED, OFF)
    assert caplog.text.count('the carriages ramp down and the power goes off') == errors


def test_node_that_hangs_after_a_stop_leaves_no_power(make_loop):
    """A loop that was starved has stopped the drives: they hold with power."""
    rig = make_loop(watchdog_timeout=0.3)
    at_rest(rig)
    rig.node.say('stop', 'the control loop stood still')
    rig.serve(1.0)
    assert rig.snapshot.cause == 'the control loop stood still'
    assert rig.state is ControllerState.STOPPED and rig.drive_states != OFF
    hang(rig)
    assert rig.serve() and rig.drive_states == OFF


def test_node_that_hangs_without_power_ends_nothing(make_loop, caplog):
    rig = make_loop(watchdog_timeout=0.1)
    configured(rig)
    hang(rig)
    assert not rig.serve(1.0)
    assert rig.state is ControllerState.INACTIVE and not caplog.text


def test_invalid_messages_end_nothing(make_loop):
    rig = make_loop()
    for message in (('nonsense',), ('request', 1, 'nonsense'), ('setpoint', 'x'), ('limits',),
                    ('disturb', 9, 'reboot')):
        rig.node.say(*message)
    rig.node.say('request', 7, 'configure')
    assert not rig.serve(5.0)
    (number, succeeded, answer), = rig.node.replies()
    assert (number, succeeded) == (7, True) and 'power: confirmed off' in answer


def test_failed_request_is_answered_with_its_reason(make_loop):
    rig = make_loop(simulates=False)
    rig.node.say('forces', 1.0, 2.0, 3.0)  # real drives know neither forces nor faults
    rig.node.say('disturb', 1, 'inject_fault', 0x8611)
    rig.node.say('request', 3, 'activate')
    rig.serve(0.1)
    (number, succeeded, answer), = rig.node.replies()
    assert (number, succeeded) == (3, False) and 'not configured' in answer


def test_faults_and_forces_reach_simulated_drives(make_loop):
    rig = make_loop()
    configured(rig)
    rig.node.say('forces', 1.0, 2.0, 3.0)
    rig.node.say('disturb', 1, 'inject_fault', 0x8611)
    rig.serve(0.2)
    assert rig.snapshot.causes[0].axis == 'q2'
    assert [drive.motor.external_force for drive in rig.drives] == [1.0, 2.0, 3.0]


def test_setpoints_are_followed_or_rejected_with_reason(make_loop):
    rig = make_loop()
    at_rest(rig)
    stamp, still = rig.clock.time() + 0.06, (0.0,) * 3
    rig.node.say('setpoint', stamp, (0.3, 0.4, 0.35), still)
    rig.serve(0.02)
    for number in range(1, 151):
        place = tuple(q + 0.0002 * number for q in HOME)
        rig.node.say('setpoint', rig.clock.time() + 0.06, place, (0.01,) * 3)
        rig.serve(0.02)
    (reason, message), = [content for kind, content in rig.node.sent if kind == 'rejected']
    assert reason == 'far_setpoint' and 'is above the bound 0.05 m' in message
    assert rig.carriages[0] > HOME[0] + 0.02
    late, typical = rig.loop._margins
    assert 0.0 < late <= typical <= 0.06


def test_limits_and_stream_are_changed_while_running(make_loop):
    rig, limits = make_loop(), MotionLimits(speed=0.1)
    rig.node.say('limits', limits)
    rig.node.say('stream', StreamSettings(first_step=0.02))
    rig.node.say('limits', replace(limits, speed=5.0))  # the carriages could touch
    rig.serve(0.1)
    assert rig.follower._limiter.limits == limits
    assert rig.follower.settings.first_step == 0.02
