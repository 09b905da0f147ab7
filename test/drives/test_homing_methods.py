from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis import Feedback
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.homing import (
    AxisHoming,
    home_error,
    HomingSequence,
    SETTLING_CYCLES,
)
from facade_manipulator.drives.states import Controlword, Status
from facade_manipulator.errors import (
    DriveError,
    DriveTimeoutError,
    ManipulatorError,
    ParameterError,
)

IDLE = 0x0627
UNDER_WAY = 0x0227
SUCCESS = 0x0027 | Status.HOMING_ATTAINED | Status.TARGET_REACHED
FAILED = 0x0027 | Status.HOMING_ERROR
START = Controlword.HOMING_START


def run(homing: AxisHoming, statuswords, home_error: float = 0.0, period: float = 0.01):
    return [
        homing.advance(Feedback(word, home_error=home_error), period * number)
        for number, word in enumerate(statuswords)]


LATE, ELSEWHERE, BROKEN = (
    (DriveTimeoutError, 'q1: homing took longer than 1 s'),
    (DriveError, r'q1: homing ended \+0.1 m from the configured'),
    (DriveError, r'q1: homing failed.*2027h'))


@pytest.mark.parametrize(('method', 'words', 'started'), [
    # bit 4 rises until the drive reports success
    (17, [IDLE, IDLE, UNDER_WAY, UNDER_WAY, SUCCESS, SUCCESS], 3),
    # what is left over from an earlier homing is given time to go
    (17, [SUCCESS, SUCCESS, SUCCESS, UNDER_WAY, SUCCESS], 3),
    (17, [FAILED, *[FAILED] * (SETTLING_CYCLES - 1), UNDER_WAY, SUCCESS], SETTLING_CYCLES),
    # without motion it may be over before anybody sees the bit clear
    (35, [SUCCESS] * (SETTLING_CYCLES + 2), SETTLING_CYCLES),
    (37, [SUCCESS] * (SETTLING_CYCLES + 2), SETTLING_CYCLES),
])
def test_new_success_ends_homing(method, words, started):
    homing = AxisHoming('q1', timeout=1.0, method=method)
    homing.watch(Feedback(words[0]))
    assert run(homing, words[1:]) == [START] * started + [0] * (len(words) - 1 - started)
    assert homing.homed


@pytest.mark.parametrize(('method', 'words', 'home_error', 'failure'), [
    *((method, [IDLE, UNDER_WAY] + [SUCCESS] * 200, 0.1, ELSEWHERE) for method in (17, 35, 37)),
    (17, [SUCCESS] * 200, 0.0, LATE),  # the old one, which is never taken back
    (37, [SUCCESS] * 200, 0.1, LATE),
    *((17, [IDLE, UNDER_WAY] + [0x0027 | half] * 200, 0.0, LATE)
      for half in (Status.HOMING_ATTAINED, Status.TARGET_REACHED)),
    (17, [FAILED] * 200, 0.0, BROKEN),
    (17, [IDLE, UNDER_WAY] + [SUCCESS | FAILED] * 200, 0.0, (DriveError, 'homing failed')),
])
def test_other_statuswords_fail_with_the_reason(method, words, home_error, failure):
    homing = AxisHoming('q1', timeout=1.0, method=method)
    homing.watch(Feedback(words[0]))
    error, message = failure
    with pytest.raises(error, match=message):
        run(homing, words[1:], home_error)
    assert not homing.homed


def test_position_a_cycle_after_success_is_awaited():
    homing = AxisHoming('q1', timeout=1.0)
    homing.watch(Feedback(IDLE))
    run(homing, [UNDER_WAY, SUCCESS], home_error=0.1)
    assert run(homing, [SUCCESS]) == [0]
    assert homing.homed


def test_axes_of_one_rank_home_together():
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
def test_homed_needs_the_bit_seen_clear_before(words, before):
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


@pytest.mark.parametrize(('beyond', 'is_home'), [(8e-4, True), (1.2e-3, False)])
@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_drive_is_home_where_it_rested_after_switch(beyond, is_home, side):
    axis, period = AxisSettings(homing_method=17), 0.01
    speed = axis.homing_zero_speed
    rest = beyond + speed * period + speed ** 2 / (2.0 * axis.homing_acceleration)
    counts = axis.to_counts(axis.home_position + side * rest)
    assert (home_error(axis, counts, period) == 0.0) == is_home


@pytest.mark.parametrize('change', [
    {'lower_limit': 0.5}, {'home_position': -0.51}, {'home_position': 0.51}])
def test_home_position_outside_the_stroke_is_rejected(change):
    with pytest.raises(ParameterError, match=f'{next(iter(change))} = '):
        AxisSettings(**change)
    for place in (-0.5, 0.5):
        assert AxisSettings(home_position=place).home_position == place
