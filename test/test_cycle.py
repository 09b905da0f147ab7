from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cycle import (
    ANSWERS_DUE,
    COMMANDS_DUE,
    CycleClock,
    LATENESS_BOUNDS,
    SYNC_OVERDUE,
)

T = 0.01


def own() -> CycleClock:
    clock = CycleClock(T, hears_sync=False)
    clock.start(0.0)
    return clock


def heard() -> CycleClock:
    clock = CycleClock(T, hears_sync=True)
    clock.start(0.0)
    return clock


def test_the_loop_sends_sync_once_a_period():
    clock = own()
    for number in range(5):
        assert clock.sync_due(T * number, all_read=True)
        clock.begin(T * number, 0.0, heard=False)
        assert not clock.sync_due(T * (number + 0.99), all_read=True)
        clock.finish(T * (number + 0.1), all_fresh=True)
    assert clock.statistics.cycles == 5
    assert clock.statistics.skipped == 0


def test_the_step_comes_with_the_last_answer_or_when_there_is_no_more_time():
    clock = own()
    clock.begin(0.0, 0.0, heard=False)
    assert clock.step_due(0.1 * T, all_fresh=True, all_read=False)
    assert not clock.step_due(0.6 * T, all_fresh=False, all_read=True)
    assert clock.step_due(ANSWERS_DUE * T, all_fresh=False, all_read=True)
    assert not clock.step_due(ANSWERS_DUE * T, all_fresh=False, all_read=False)
    assert clock.step_due(COMMANDS_DUE * T, all_fresh=False, all_read=False)
    assert clock.next_event() == ANSWERS_DUE * T


def test_no_step_is_due_twice():
    clock = own()
    clock.begin(0.0, 0.0, heard=False)
    clock.finish(0.1 * T, all_fresh=True)
    assert not clock.step_due(5 * T, all_fresh=True, all_read=True)


@pytest.mark.parametrize(('share', 'in_time'), [(0.1, True), (0.79, True), (0.81, False)])
def test_commands_later_than_four_fifths_of_the_period_are_late(share, in_time):
    clock = own()
    clock.begin(0.0, 0.0, heard=False)
    assert clock.finish(share * T, all_fresh=True) is in_time
    assert clock.statistics.late == (not in_time)
    assert clock.late_in_a_row == (not in_time)


def test_being_in_time_once_ends_the_row_of_late_cycles():
    clock = own()
    for number, share in enumerate((0.9, 0.9, 0.1)):
        clock.begin(2 * T * number, 0.0, heard=False)
        clock.finish(2 * T * number + share * T, all_fresh=True)
    assert clock.late_in_a_row == 0
    assert clock.statistics.late == 2


@given(st.lists(st.floats(0.0, 0.1), min_size=1, max_size=50))
def test_late_syncs_are_never_squeezed_together_to_catch_up(delays):
    clock = own()
    now, last = 0.0, -1.0
    for delay in delays:
        now = max(now, clock.next_event()) + delay
        assert clock.sync_due(now, all_read=True)
        assert now - last >= COMMANDS_DUE * T - 1e-9
        clock.begin(now, 0.0, heard=False)
        clock.finish(now, all_fresh=True)
        last = now


def test_periods_without_sync_are_counted():
    clock = own()
    clock.begin(0.0, 0.0, heard=False)
    clock.finish(0.0, all_fresh=True)
    clock.begin(4.5 * T, 0.0, heard=False)
    assert clock.statistics.skipped == 3


def test_the_kernels_sync_is_replaced_when_it_is_overdue():
    clock = heard()
    assert not clock.sync_due(T, all_read=True)
    assert clock.sync_due(SYNC_OVERDUE * T, all_read=True)
    clock.begin(SYNC_OVERDUE * T, 0.0, heard=False)
    assert clock.overdue_in_a_row == 1
    clock.begin(2 * T, 0.0, heard=True)
    assert clock.overdue_in_a_row == 0


def test_the_kernels_sync_is_not_overdue_while_frames_wait_to_be_read():
    clock = heard()
    assert not clock.sync_due(2 * T, all_read=False)
    assert clock.sync_due((SYNC_OVERDUE + 1.0) * T, all_read=False)


def test_a_sync_that_comes_too_early_is_somebody_elses():
    clock = heard()
    clock.begin(T, 0.0, heard=True)
    assert clock.is_stray(1.4 * T)
    assert not clock.is_stray(1.9 * T)
    assert clock.statistics.stray == 1


@given(st.lists(st.floats(0.0, 0.5), max_size=50))
def test_the_histogram_holds_every_step(ages):
    clock = own()
    for number, age in enumerate(ages):
        clock.begin(float(number), 0.0, heard=False)
        clock.finish(number + age, all_fresh=False)
    statistics = clock.statistics
    assert sum(statistics.lateness) == statistics.cycles == statistics.incomplete == len(ages)
    assert len(statistics.lateness) == len(LATENESS_BOUNDS) + 1
