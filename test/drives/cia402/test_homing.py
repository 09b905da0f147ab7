from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cia402.axis import Feedback
from facade_manipulator.drives.cia402.homing import (
    AxisHoming,
    HomingSequence,
    SETTLING_CYCLES,
)
from facade_manipulator.drives.cia402.states import Controlword, Status
from facade_manipulator.errors import DriveFaultError, DriveTimeoutError, ManipulatorError

IDLE = 0x0627
UNDER_WAY = 0x0227
SUCCESS = 0x0027 | Status.HOMING_ATTAINED | Status.TARGET_REACHED
FAILED = 0x0027 | Status.HOMING_ERROR
START = Controlword.HOMING_START


def run(homing: AxisHoming, statuswords, home_error: float = 0.0, period: float = 0.01):
    return [
        homing.advance(Feedback(word, home_error=home_error), period * number)
        for number, word in enumerate(statuswords)]


@pytest.mark.parametrize('method', [17, 35, 37])
def test_success_at_another_position_than_the_home_position_is_a_failure(method):
    homing = AxisHoming('q1', timeout=1.0, method=method)
    homing.watch(Feedback(IDLE))
    with pytest.raises(DriveFaultError, match=r'q1: homing ended \+0.1 m from the configured'):
        run(homing, [UNDER_WAY] + [SUCCESS] * (SETTLING_CYCLES + 1), home_error=0.1)
    assert not homing.homed


def test_a_position_that_follows_the_success_a_cycle_later_is_waited_for():
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(IDLE))
    run(homing, [UNDER_WAY, SUCCESS], home_error=0.1)
    assert run(homing, [SUCCESS]) == [0]
    assert homing.homed


def test_homing_raises_bit_4_until_the_drive_reports_success():
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(IDLE))
    assert run(homing, [IDLE, UNDER_WAY, UNDER_WAY, SUCCESS, SUCCESS]) == [
        START, START, START, 0, 0]
    assert homing.homed


def test_success_left_over_from_an_earlier_homing_does_not_count():
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(SUCCESS))
    assert run(homing, [SUCCESS, SUCCESS, UNDER_WAY]) == [START] * 3
    assert not homing.homed
    assert homing.advance(Feedback(SUCCESS), 0.1) == 0
    assert homing.homed


def test_a_drive_that_never_takes_the_old_success_back_runs_into_the_time_out():
    homing = AxisHoming('q1', timeout=0.5)
    homing.watch(Feedback(SUCCESS))
    homing.advance(Feedback(SUCCESS), 0.0)
    with pytest.raises(DriveTimeoutError, match='q1: homing took longer than 0.5 s'):
        homing.advance(Feedback(SUCCESS), 0.6)


@pytest.mark.parametrize('method', [35, 37])
def test_a_method_without_motion_may_be_over_before_anybody_sees_the_bit_clear(method):
    homing = AxisHoming('q1', timeout=1.0, method=method)
    homing.watch(Feedback(SUCCESS))
    for cycle in range(SETTLING_CYCLES):
        assert homing.advance(Feedback(SUCCESS), 0.01 * cycle) == START
    assert homing.advance(Feedback(SUCCESS), 0.1) == 0
    assert homing.homed


def test_a_method_without_motion_is_not_over_while_the_position_is_another():
    homing = AxisHoming('q1', timeout=0.5, method=37)
    homing.watch(Feedback(SUCCESS))
    with pytest.raises(DriveTimeoutError):
        run(homing, [SUCCESS] * 100, home_error=0.1)


@pytest.mark.parametrize('word', [
    0x0027 | Status.HOMING_ATTAINED, 0x0027 | Status.TARGET_REACHED, SUCCESS | FAILED])
def test_half_a_success_is_none(word):
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(IDLE))
    homing.advance(Feedback(UNDER_WAY), 0.0)
    homing.advance(Feedback(word), 0.01)
    assert not homing.homed


def test_an_error_left_over_from_an_earlier_homing_is_given_time_to_go():
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(FAILED))
    run(homing, [FAILED] * (SETTLING_CYCLES - 1) + [UNDER_WAY, SUCCESS])
    assert homing.homed


def test_a_homing_error_is_told_with_the_statusword():
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(IDLE))
    with pytest.raises(DriveFaultError, match=r'q1: homing failed.*2027h'):
        run(homing, [FAILED] * (SETTLING_CYCLES + 2))


def test_axes_of_one_rank_home_together_and_lower_ranks_first():
    sequence = HomingSequence((
        AxisHoming('q1', 1.0, rank=2), AxisHoming('q2', 1.0, rank=1),
        AxisHoming('q3', 1.0, rank=2)))
    for number in range(3):
        sequence.axes[number].watch(Feedback(IDLE))

    def advance(*words):
        return [sequence.advance(number, Feedback(word), 0.0) for number, word in enumerate(words)]

    assert advance(IDLE, UNDER_WAY, IDLE) == [0, START, 0]
    assert sequence.due == 1
    advance(IDLE, SUCCESS, IDLE)
    assert advance(UNDER_WAY, SUCCESS, UNDER_WAY) == [START, 0, START]
    advance(SUCCESS, SUCCESS, SUCCESS)
    assert sequence.done
    assert sequence.due is None


@given(st.lists(st.integers(0, 0xFFFF), max_size=40), st.integers(0, 0xFFFF))
def test_no_sequence_of_statuswords_counts_as_homed_without_the_bit_seen_clear(words, before):
    homing = AxisHoming('q1', timeout=0.3)
    homing.watch(Feedback(before))
    try:
        run(homing, words)
    except ManipulatorError:
        assert not homing.homed
        return
    if homing.homed:
        attained = [bool(word & Status.HOMING_ATTAINED) for word in [before, *words]]
        assert False in attained
        assert any(word & (SUCCESS & ~0x27 | Status.HOMING_ERROR) == SUCCESS & ~0x27
                   for word in words)
