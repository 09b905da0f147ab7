"""Which positions of a drive are believed, cycle after cycle and after a lost bus."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.encoder import Encoder

AXIS, T = DEFAULT_AXES[0], 0.01


def moving(speed=0.0):
    """Return a homed encoder whose carriage has reached a speed; its next position and time."""
    encoder, position = Encoder(AXIS, T), 0.0
    encoder.begin_homing()
    encoder.end_homing(True)
    for cycle in range(1, 20):
        assert encoder.receive(AXIS.to_counts(position), cycle * T) == ''
        position += speed * T * min(cycle / 10, 1.0)
    return encoder, position, 20 * T


@pytest.mark.parametrize(('speed', 'off', 'is_believed'), [
    (0.0, 0.0021, True), (0.0, -0.0021, True), (0.0, 0.0024, False), (0.0, -0.0024, False),
    (0.4, 0.0040, True), (0.4, -0.0040, True), (0.4, 0.0045, False), (-0.4, 0.0045, False)])
def test_position_away_from_its_speed_is_a_jump(speed, off, is_believed):
    encoder, expected, time = moving(speed)
    distrust = encoder.receive(AXIS.to_counts(expected + off), time)
    assert ('has jumped by' in distrust) is not is_believed
    assert encoder.homed is is_believed
    assert encoder.speed == pytest.approx(speed + off / T, abs=1e-3)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 9)), max_size=40))
def test_possible_motion_with_late_answers_is_believed(pushes):
    encoder, position, time = moving()
    speed = 0.0
    for share, cycles in pushes:
        pause, push = cycles * T, share * AXIS.max_acceleration
        position += speed * pause + 0.5 * push * pause ** 2
        speed += push * pause
        time += pause
        assert encoder.receive(AXIS.to_counts(position), time - T) == ''
    assert encoder.homed


def test_small_jumps_count_together_until_homing():
    encoder, position, time = moving()
    for jump in range(7):
        if jump in (2, 4):
            encoder.begin_homing()
            encoder.end_homing(True)
        position += 0.002
        distrust = ''.join([  # a jump, and a halt after it
            encoder.receive(AXIS.to_counts(position), time + (3 * jump + more) * T)
            for more in range(3)])
        assert bool(distrust) is (jump == 6)
    assert 'has slipped by 0.01' in distrust and not encoder.homed


def test_position_lost_while_homing_stays_lost():
    encoder, *_ = moving()
    encoder.begin_homing()
    encoder.distrust()
    encoder.end_homing(True)
    assert not encoder.homed
    encoder.begin_homing()
    encoder.end_homing(True)
    assert encoder.homed
