from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cycle import (
    ANSWERS_DUE,
    COMMANDS_DUE,
    CycleClock,
    FIRST_ANSWER_DUE,
    OTHERS_DUE,
    SYNC_MISSING,
    SYNC_OVERDUE,
)

T = 0.01
ALL = 3


def producer() -> CycleClock:
    clock = CycleClock(T, ALL, has_kernel_sync=False)
    clock.start(0.0)
    return clock


def consumer() -> CycleClock:
    clock = CycleClock(T, ALL, has_kernel_sync=True)
    clock.start(0.0)
    return clock


def sync_due(clock, now, all_read=True) -> bool:
    return not clock.is_open and is_due(clock, now, all_read)


def step_due(clock, now, answers=0, all_read=True) -> bool:
    """Let some more drives answer; return whether the loop steps then."""
    for _ in range(answers):
        clock.answer(now)
    return clock.is_open and is_due(clock, now, all_read)


def is_due(clock, now, all_read) -> bool:
    return now >= clock.next_event and (all_read or not clock.may_wait(now, now))


# --- SYNC sent by the loop


@pytest.mark.parametrize(('make', 'times'), [
    (producer, [(0.1, 2, False), (ANSWERS_DUE - 0.01, 0, False), (ANSWERS_DUE, 0, True)]),
    (producer, [(0.1, 2, False), (0.6, 1, True)]),
    (consumer, [(ANSWERS_DUE - 0.01, 2, False), (ANSWERS_DUE, 0, True)]),
    # nobody answers: this computer is late, not all drives dead
    (producer, [(FIRST_ANSWER_DUE - 0.1, 0, False), (FIRST_ANSWER_DUE, 0, True)]),
    (consumer, [(ANSWERS_DUE, 0, True)]),
    # after a late first answer the others are given time to follow
    (producer, [(2.0, 1, False), (1.99 + OTHERS_DUE, 0, False), (2.01 + OTHERS_DUE, 0, True)]),
])
def test_step_comes_with_last_answer_or_in_time(make, times):
    clock = make()
    clock.begin(0.0, 0.0)
    for share, answers, is_due in times:
        assert step_due(clock, share * T, answers) is is_due


def test_step_waits_for_frames_still_to_be_read():
    clock = consumer()
    assert not sync_due(clock, 2 * T, all_read=False)
    assert sync_due(clock, SYNC_MISSING * T, all_read=False)
    clock.receive(0.0, 0.0)
    assert not step_due(clock, ANSWERS_DUE * T, all_read=False)
    assert step_due(clock, COMMANDS_DUE * T, all_read=False)


def test_late_step_waits_for_frames_that_came_earlier():
    clock = producer()
    clock.begin(0.0, 0.0)
    assert clock.may_wait(now=5.0 * T, time=0.5 * T)
    assert not clock.may_wait(now=5.0 * T, time=FIRST_ANSWER_DUE * T)
    assert step_due(clock, 5.0 * T, answers=ALL)
    assert not clock.may_wait(now=5.0 * T, time=0.5 * T)


@given(st.lists(st.floats(0.0, 0.1), min_size=1, max_size=50))
def test_late_syncs_are_never_squeezed_together(delays):
    clock = producer()
    now, last = 0.0, -1.0
    for delay in delays:
        now = max(now, clock.next_event) + delay
        assert sync_due(clock, now)
        assert now - last >= COMMANDS_DUE * T - 1e-9
        clock.begin(now, 0.0)
        clock.finish(now)
        last = now


# --- SYNC sent by the kernel


@pytest.mark.parametrize('late', [0, 1, ALL])
def test_answers_after_the_step_do_not_count(late):
    for clock in (producer(), consumer()):
        clock.begin(0.0, 0.0)
        clock.finish(ANSWERS_DUE * T)
        assert not step_due(clock, 0.9 * T, answers=late)
        clock.begin(2 * T, 0.0)
        assert not step_due(clock, 2.1 * T, answers=ALL - 1)
        assert step_due(clock, 2.1 * T, answers=1)
        clock.finish(2.1 * T)
        assert clock.statistics.incomplete == 1


def test_overdue_kernel_sync_is_replaced():
    clock = consumer()
    assert not sync_due(clock, T)
    assert sync_due(clock, SYNC_OVERDUE * T)
    clock.begin(SYNC_OVERDUE * T, 0.0)
    assert clock.overdue_in_a_row == clock.statistics.skipped == 1
    clock.receive(2 * T, 0.0)
    assert clock.overdue_in_a_row == 0


def test_early_sync_is_foreign():
    clock = consumer()
    clock.receive(T, 0.0)
    assert clock.is_unexpected(1.4 * T)
    assert not clock.is_unexpected(1.9 * T)
    assert clock.statistics.unexpected == 1


@pytest.mark.parametrize('is_powered', [True, False])
def test_late_loop_or_missing_sync_stops_drives(is_powered):
    late, overdue = consumer(), consumer()
    for number in range(1, 4):
        assert late.causes(3, is_powered) == overdue.causes(3, is_powered) == []
        late.receive(number * T, 0.0)
        late.finish((number + 0.9) * T)
        overdue.begin(number * T, 0.0)
        overdue.finish((number + 0.1) * T)
    assert [one.message for one in late.causes(3, is_powered)] == [
        'the control loop was late 3 cycles in a row, bound 3'] * is_powered
    cause, = overdue.causes(3, is_powered)
    assert cause.configure_again and 'sent no SYNC for 3 periods, bound 3' in cause.message


def test_foreign_sync_between_ours_stops_drives():
    clock = consumer()
    for number in range(1, 4):
        assert clock.causes(3, True) == []
        assert clock.is_unexpected((number - 0.6) * T)
        clock.receive(number * T, 0.0)
    cause, = clock.causes(3, True)
    assert 'SYNC (080h) was received between ours in 3 periods' in cause.message
    clock.receive(4 * T, 0.0)
    assert clock.causes(3, True) == []


# --- stamps without jitter

@given(st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=50), st.floats(1e9, 2e9))
def test_smooth_stamps_have_little_jitter(jitter, start):
    clock = producer()
    stamps = []
    for number, share in enumerate([0.0, *jitter]):
        clock.begin(T * number, start + T * (number + share))
        clock.finish(T * (number + 0.1))
        stamps.append(clock.smooth_stamp)
    for before, after in zip(stamps, stamps[1:], strict=False):
        assert after - before == pytest.approx(T, abs=0.02 * T)


@pytest.mark.parametrize('moved', [0.4, 7.4, -3.6, 1e5 + 0.3])
def test_moved_sync_and_set_clock_are_believed_at_once(moved):
    clock = producer()
    clock.begin(0.0, 100.0)
    clock.finish(0.1 * T)
    clock.begin(T, 100.0 + moved * T)
    assert clock.smooth_stamp == pytest.approx(100.0 + moved * T, abs=1e-9)
