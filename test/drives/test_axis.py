"""Supervision of one drive by its answers, without bus and clock."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.emcy import Fault
from facade_manipulator.canopen.pdo import RPDO1, TPDO1, TPDO2, TPDO3
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.encoder import Encoder
from facade_manipulator.drives.feedback import REST_SPEED
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.states import Mode

AXIS = AxisSettings()
SETTINGS = ControllerSettings()
T = SETTINGS.period
ENABLED = 0x1227
LIMITED = 0x1A27
LOCAL = 0x1027
IGNORES = 0x0227
FAULTY = 0x0008


def made(**details):
    """Return a supervised axis that is homed."""
    axis = Axis('q1', AXIS, replace(load_profile('simulated'), **details), SETTINGS)
    axis.begin_supervision(0.0)
    axis.encoder.end_homing(True)
    return axis


def answer(axis, cycle, position=0.0, word=ENABLED):
    """Pass the answer of a drive to a SYNC to its axis."""
    status = TPDO1.codec.pack(
        word, Mode.CYCLIC_SYNCHRONOUS_POSITION, AXIS.to_counts(position)
    )
    for tpdo, data in (TPDO1, status), (TPDO2, bytes(8)):
        axis.receive_tpdo(tpdo, data, cycle * T, cycle * T)


def test_answer_is_complete_with_every_tpdo_of_sync():
    """Otherwise the following errors of different cycles would be compared."""
    axis = made()
    answer(axis, 1)
    axis.end_cycle(T, may_rest=True)
    axis.receive_tpdo(TPDO1, bytes(TPDO1.codec.size), 2 * T, 2 * T)
    assert axis.answers.newest == T
    axis.receive_tpdo(TPDO2, bytes(TPDO2.codec.size), 2 * T, 2 * T)
    assert axis.answers.newest == 2 * T


@pytest.mark.parametrize(
    ('words', 'disobedience'),
    [
        ((ENABLED,) * 5, ''),
        ((ENABLED, IGNORES), 'bit 12 is 0'),
        ((ENABLED, LOCAL), 'bit 9 is 0'),
        ((LOCAL, LOCAL), ''),  # a drive without this bit
        ((ENABLED, LIMITED), ''),  # a drive that catches up may be at its limits
        ((ENABLED, 0x0250), ''),  # a drive that is not enabled need not follow
    ],
)
def test_drive_that_reports_disobedience_is_stopped(words, disobedience):
    axis = made()
    for cycle, word in enumerate(words, 1):
        answer(axis, cycle, word=word)
        axis.end_cycle(cycle * T, may_rest=True)
    assert disobedience in axis.feedback.disobedience
    assert bool(disobedience) is bool(axis.feedback.disobedience)


@pytest.mark.parametrize('step', [0.3, 9.0])
def test_clock_set_forward_keeps_heartbeats_valid(step):
    axis = made()
    for number in range(1, 40):
        now = 0.05 * number
        axis.receive_heartbeat(Frame(0x701, b'\x05', now - step * (number == 20), now))
        assert axis.silence.cause(now) is None
    assert axis.silence.cause(now + 0.2).message == (
        'q1 (node 1) sent no heartbeat for 200 ms, above the limit 150 ms '
        '(controller.heartbeat_timeout)'
    )


def test_silence_just_above_its_limit_is_printed_with_decimals():
    axis = made()
    axis.receive_heartbeat(Frame(0x701, b'\x05', 1.0, 1.0))
    assert axis.silence.cause(1.1502).message == (
        'q1 (node 1) sent no heartbeat for 150.2 ms, above the limit 150 ms '
        '(controller.heartbeat_timeout)'
    )


def test_jump_just_above_its_limit_is_printed_with_more_digits():
    encoder, _, _ = moving()
    distrust = encoder._judge(0.00225 * (1.0 + 1e-6), 0.00225)
    assert 'has jumped by 0.002250002 m, above the limit 0.00225 m' in distrust


def test_drive_silent_before_its_supervision_is_reported():
    axis = Axis('q1', AXIS, load_profile('simulated'), SETTINGS)
    assert not axis.snapshot(None, 1.0).is_silent
    axis.receive_heartbeat(Frame(0x701, b'\x7f', 1.0, 1.0))
    assert not axis.snapshot(None, 1.1).is_silent
    assert axis.snapshot(None, 1.2).is_silent


def test_carriage_at_rest_has_constant_positions():
    axis = made()
    for cycle in range(1, 6):  # in the last cycle it no longer moves
        answer(axis, cycle, 0.004 * min(cycle, 4) * T)
        axis.end_cycle(cycle * T, may_rest=True)
        assert axis.feedback.at_rest is (cycle in (1, 5))


@pytest.mark.parametrize('sends_velocity', [True, False])
@pytest.mark.parametrize(('counts', 'rests'), [(1, True), (2, False)])
def test_count_that_toggles_in_each_cycle_is_no_motion(sends_velocity, counts, rests):
    settings = replace(AXIS, pulses_per_revolution=200, gear_ratio=1.0)
    others = (TPDO2,) if sends_velocity else ()
    profile = replace(load_profile('simulated'), pdos=(RPDO1, TPDO1, *others))
    axis = Axis('q1', profile.applied(settings), profile, SETTINGS)
    assert axis.settings.si_per_unit.position / T > REST_SPEED
    axis.begin_supervision(0.0)
    for cycle in range(1, 6):
        status = TPDO1.codec.pack(
            ENABLED, Mode.CYCLIC_SYNCHRONOUS_POSITION, counts * (cycle % 2)
        )
        axis.receive_tpdo(TPDO1, status, cycle * T, cycle * T)
        if sends_velocity:
            axis.receive_tpdo(TPDO2, bytes(8), cycle * T, cycle * T)
        axis.end_cycle(cycle * T, may_rest=True)
    assert axis.feedback.at_rest is rests


def emergency(code):
    data = code.to_bytes(2, 'little') + bytes(6)
    return lambda axis: axis.receive_emergency(Frame(0x081, data, 1.0, 1.0))


def error_code(word, code):
    def send(axis):
        answer(axis, 1, word=word)
        return axis.receive_tpdo(TPDO3, TPDO3.codec.pack(code, 0, 0), T, T)

    return send


@pytest.mark.parametrize(
    ('send', 'message'),
    [
        (
            lambda axis: axis.receive_heartbeat(Frame(0x701, b'\x7f', 1.0, 1.0)),
            'is no longer operational (NMT state 127)',
        ),
        (emergency(0), ''),
        (error_code(FAULTY, 0x2310), 'current'),
        (error_code(FAULTY, 0), ''),
        (error_code(ENABLED, 0x2310), ''),
    ],
)
def test_heartbeat_or_error_code_of_a_fault_stops(send, message):
    axis = made()
    cause = send(axis)
    if message:
        assert message in cause.message
        assert cause.axis == 'q1'
    else:
        assert cause is None


def test_warning_stops_nothing_until_the_drive_faults():
    """
    Warnings are emergency messages to Kollmorgen (AKD, 1080h, 3180h, 4390h) and Faulhaber.

    Faulhaber's 43F0h (communications manual 7000.05050, table 9) sets 'current' in 1001h, so
    this register does not help. Other makers set only bit 7 of the statusword.
    """
    axis = made(errors={'43F0': Fault('it is warm', 'let it cool', is_warning=True)})
    assert emergency(0x43F0)(axis) is None
    warned = axis.snapshot(None, T)
    expected = 'it reports a warning: it is warm (error code 43F0h): let it cool'
    assert warned.warning == expected
    assert warned.error_code == 0
    assert error_code(FAULTY, 0x43F0)(axis).message.startswith(
        'q1 (node 1): it is warm'
    )
    emergency(0)(axis)
    assert axis.errors.warning == ''
    assert emergency(0x4310)(axis) is not None


# --- which positions of a drive are believed


def moving(speed=0.0):
    """Return a homed encoder at a speed [m/s], with the next position and time."""
    encoder = Encoder(AXIS, T)
    position = 0.0
    encoder.begin_homing()
    encoder.end_homing(True)
    for cycle in range(1, 20):
        assert encoder.receive(AXIS.to_counts(position), cycle * T) == ''
        position += speed * T * min(cycle / 10, 1.0)
    return encoder, position, 20 * T


@pytest.mark.parametrize(
    ('speed', 'off', 'is_believed'),
    [
        (0.0, 0.0021, True),
        (0.0, -0.0021, True),
        (0.0, 0.0024, False),
        (0.0, -0.0024, False),
        (0.4, 0.0040, True),
        (0.4, -0.0040, True),
        (0.4, 0.0045, False),
        (-0.4, 0.0045, False),
    ],
)
def test_position_that_contradicts_its_speed_is_a_jump(speed, off, is_believed):
    encoder, expected, time = moving(speed)
    distrust = encoder.receive(AXIS.to_counts(expected + off), time)
    assert ('has jumped by' in distrust) is not is_believed
    assert encoder.homed is is_believed
    assert encoder.speed == pytest.approx(speed + off / T, abs=1e-3)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 9)), max_size=40))
def test_possible_motion_with_late_answers_is_accepted(pushes):
    encoder, position, time = moving()
    speed = 0.0
    for share, cycles in pushes:
        pause = cycles * T
        push = share * AXIS.max_acceleration
        position += speed * pause + 0.5 * push * pause**2
        speed += push * pause
        time += pause
        assert encoder.receive(AXIS.to_counts(position), time - T) == ''
    assert encoder.homed


def test_small_jumps_accumulate_until_homing():
    encoder, position, time = moving()
    for jump in range(7):
        if jump in (2, 4):
            encoder.begin_homing()
            encoder.end_homing(True)
        position += 0.002
        distrust = ''
        for _ in range(3):  # a jump, and a halt after it
            distrust += encoder.receive(AXIS.to_counts(position), time)
            time += T
        assert bool(distrust) is (jump == 6)
    assert 'has slipped by 0.01' in distrust
    assert not encoder.homed


def test_position_lost_during_homing_stays_lost():
    encoder, *_ = moving()
    encoder.begin_homing()
    encoder.distrust()
    for is_homed in (False, True):
        encoder.end_homing(True)
        assert encoder.homed is is_homed
        encoder.begin_homing()
