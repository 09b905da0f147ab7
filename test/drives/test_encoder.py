"""What is believed of a position, cycle after cycle and after a lost bus."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.encoder import Encoder

AXIS, T, SILENCE = DEFAULT_AXES[0], 0.01, 0.15
ACCELERATION = AXIS.max_acceleration


def moving(speed=0.0):
    """Return an encoder that was homed and whose carriage has come to a speed; where it is."""
    made, cycles = Encoder(AXIS, T), 20
    made.begin_homing()
    made.end_homing(True)
    position = 0.0
    for cycle in range(1, cycles):
        assert made.receive(AXIS.to_counts(position), cycle * T) == ''
        position += speed * T * min(cycle / 10, 1.0)
    return made, position, cycles * T


@pytest.mark.parametrize(('speed', 'off', 'is_believed'), [
    (0.0, 0.0021, True), (0.0, -0.0021, True), (0.0, 0.0024, False), (0.0, -0.0024, False),
    (0.4, 0.0040, True), (0.4, -0.0040, True), (0.4, 0.0045, False), (-0.4, 0.0045, False)])
def test_position_away_from_its_speed_is_a_jump(
        speed, off, is_believed):
    one, expected, time = moving(speed)
    said = one.receive(AXIS.to_counts(expected + off), time)
    assert ('has jumped by' in said) is not is_believed
    assert one.homed is is_believed
    assert one.speed == pytest.approx(speed + off / T, abs=1e-3)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 9)), max_size=40))
def test_possible_motion_with_late_answers_is_believed(pushes):
    one, position, time = moving()
    speed = 0.0
    for share, cycles in pushes:
        pause, push = cycles * T, share * ACCELERATION
        position += speed * pause + 0.5 * push * pause ** 2
        speed += push * pause
        time += pause
        assert one.receive(AXIS.to_counts(position), time - T) == ''
    assert one.homed


def test_answers_to_two_syncs_at_once_show_no_jump():
    one, position, time = moving(0.4)
    for cycle in range(20):
        for after in (0.0, 0.0008, 0.004):
            counts = AXIS.to_counts(position + 0.4 * (cycle * T + after))
            assert one.receive(counts, time + cycle * T + after) == ''
            assert one.counts == counts
    assert 'has jumped by' in one.receive(counts + AXIS.to_counts(0.012), time + 20 * T)


def test_small_jumps_count_together_until_homing():
    one, position, time = moving()
    for jump in range(20):
        if jump in (2, 4):  # each is a jump, and a halt after it
            one.begin_homing()
            one.end_homing(True)
        position += 0.002
        said = [one.receive(AXIS.to_counts(position), time + (3 * jump + more) * T)
                for more in range(3)]
        if any(said):
            break
    assert jump == 6 and 'has slipped by 0.01' in ''.join(said) and not one.homed


def test_position_lost_while_homing_stays_lost():
    one, *_ = moving()
    one.begin_homing()
    assert not one.homed
    one.distrust()
    one.end_homing(True)
    assert not one.homed
    one.begin_homing()
    one.end_homing(True)
    assert one.homed
