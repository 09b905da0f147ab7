"""Due times of SYNC and of the step of a cycle, and delays that stop the drives."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cycle import (
    ANSWERS_DUE,
    COMMANDS_DUE,
    CycleClock,
    FIRST_ANSWER_DUE,
    MIN_GAP,
    OTHERS_DUE,
    SYNC_MISSING,
    SYNC_OVERDUE,
)

T = 0.01
ALL = 3


def started(has_kernel_sync: bool = False) -> CycleClock:
    clock = CycleClock(T, ALL, has_kernel_sync)
    clock.start(0.0)
    return clock


def is_due(clock, now, answers=0, is_step=True, all_read=True) -> bool:
    """Return whether the step, or else SYNC, is due at a time [s], after further answers."""
    for _ in range(answers):
        clock.answer(now)
    if clock.is_open is not is_step or now < clock.next_event:
        return False
    return all_read or not clock.let_wait(now, now)


@pytest.mark.parametrize(
    ('has_kernel_sync', 'times'),
    [
        (
            False,
            [(0.1, 2, False), (ANSWERS_DUE - 0.01, 0, False), (ANSWERS_DUE, 0, True)],
        ),
        (False, [(0.1, 2, False), (0.6, 1, True)]),
        (True, [(ANSWERS_DUE - 0.01, 2, False), (ANSWERS_DUE, 0, True)]),
        (True, [(ANSWERS_DUE, 0, True)]),
        # without any answer this computer is late, not all drives dead
        (False, [(FIRST_ANSWER_DUE - 0.1, 0, False), (FIRST_ANSWER_DUE, 0, True)]),
        # after a late first answer the others are given time to follow
        (
            False,
            [
                (2.0, 1, False),
                (1.99 + OTHERS_DUE, 0, False),
                (2.01 + OTHERS_DUE, 0, True),
            ],
        ),
    ],
)
def test_step_is_due_with_last_answer_or_in_time(has_kernel_sync, times):
    clock = started(has_kernel_sync)
    clock.begin(0.0, 0.0)
    for share, answers, expected in times:
        assert is_due(clock, share * T, answers) is expected


def test_due_events_wait_for_unread_frames():
    clock = started(has_kernel_sync=True)
    assert not is_due(clock, 2.0 * T, is_step=False, all_read=False)
    assert is_due(clock, SYNC_MISSING * T, is_step=False, all_read=False)
    clock.receive(0.0, 0.0)
    assert not is_due(clock, ANSWERS_DUE * T, all_read=False)
    assert is_due(clock, COMMANDS_DUE * T, all_read=False)
    late = started()
    late.begin(0.0, 0.0)
    assert late.let_wait(5.0 * T, 0.5 * T)
    assert not late.let_wait(5.0 * T, FIRST_ANSWER_DUE * T)
    assert is_due(late, 5.0 * T, answers=ALL)
    assert not late.let_wait(5.0 * T, 0.5 * T)


@given(st.lists(st.floats(0.0, 0.1), min_size=1, max_size=50))
def test_late_syncs_keep_their_minimum_distance(delays):
    clock = started()
    now = 0.0
    last = -1.0
    for delay in delays:
        now = max(now, clock.next_event) + delay
        assert is_due(clock, now, is_step=False)
        assert now - last >= COMMANDS_DUE * T - 1e-9
        clock.begin(now, 0.0)
        clock.finish(now)
        last = now


@pytest.mark.parametrize(('step', 'skipped'), [(0.7, 0), (1.5, 0), (2.95, 2)])
def test_late_loop_counts_periods_without_sync(step, skipped):
    clock = started()
    clock.begin(0.0, 0.0)
    clock.finish(step * T)
    clock.begin(clock.next_event, 0.0)
    assert clock.statistics.skipped == skipped


@pytest.mark.parametrize('late', [0, 1, ALL])
@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_answers_after_the_step_do_not_count(late, has_kernel_sync):
    clock = started(has_kernel_sync)
    clock.begin(0.0, 0.0)
    clock.finish(ANSWERS_DUE * T)
    assert not is_due(clock, 0.9 * T, answers=late)
    clock.begin(2 * T, 0.0)
    assert not is_due(clock, 2.1 * T, answers=ALL - 1)
    assert is_due(clock, 2.1 * T, answers=1)
    clock.finish(2.1 * T)
    assert clock.statistics.incomplete == 1


@pytest.mark.parametrize('end', [0.5, 0.95, 1.4])
def test_loop_sync_follows_late_commands_by_a_gap(end):
    clock = started()
    clock.begin(0.0, 0.0)
    clock.finish(0.1 * T)
    assert clock.finish_commands(end * T)
    assert clock.next_event == pytest.approx(max(1.0, end + MIN_GAP) * T)


def late(clock, number):
    clock.receive(number * T, 0.0)
    clock.finish((number + 0.9) * T)


def overdue(clock, number):
    assert is_due(clock, (number - 1 + SYNC_OVERDUE) * T, is_step=False)
    clock.begin(number * T, 0.0)
    clock.finish((number + 0.1) * T)


@pytest.mark.parametrize(
    ('happen', 'message', 'is_powered'),
    [
        (late, 'the control loop was late 3 cycles in a row (limit 3)', True),
        (late, None, False),
        (overdue, 'the kernel sent no SYNC for 3 periods (limit 3)', False),
    ],
)
def test_three_late_or_overdue_syncs_stop_drives(happen, message, is_powered):
    clock = started(has_kernel_sync=True)
    for number in range(1, 4):
        assert clock.causes(3, is_powered) == []
        happen(clock, number)
    causes = [cause.message for cause in clock.causes(3, is_powered)]
    assert causes == [] if message is None else message in causes[0]
    clock.receive(5 * T, 0.0)
    clock.finish(5 * T)
    clock.finish_commands(5 * T)
    assert clock.causes(3, is_powered) == []


def receive_syncs(clock, times) -> list[str]:
    """Receive SYNCs at times [s]; return the causes of a stop after the last one."""
    for time in sorted(times):
        if clock.accept_sync(time):
            clock.receive(time, 0.0)
    return [cause.message for cause in clock.causes(3, False)]


@given(st.floats(0.5, 25.0), st.floats(0.0, 1.0), st.floats(0.0, 3.0))
def test_foreign_sync_of_any_period_is_found(period, phase, start):
    clock = started(has_kernel_sync=True)
    kernel = [number * T for number in range(1, 500)]
    foreign = [start + (phase + number * period) * T for number in range(500)]
    foreign = [time for time in foreign if time < start + 1.0]
    before = [time for time in kernel if time < start]
    assert receive_syncs(clock, before) == []
    during = [time for time in kernel if start <= time < start + 1.0]
    (message,) = receive_syncs(clock, [*during, *foreign])
    assert message.startswith(
        'another master is on the bus: SYNC (080h) was received between our SYNCs '
    )


@given(st.lists(st.floats(0.0, 2.9), min_size=1, max_size=400))
def test_late_kernel_syncs_are_not_foreign(delays):
    clock = started(has_kernel_sync=True)
    times = []
    sent = 0.0
    for number, delay in enumerate(delays, 1):
        sent = max(sent, (number + delay * (number % 5 == 0)) * T)
        times.append(sent)
        assert receive_syncs(clock, [sent]) == []


@pytest.mark.parametrize('step', [0.004, 0.05, 0.3, 0.9, 5.0])
def test_kernel_sync_before_a_clock_step_is_ours(step):
    clock = started(has_kernel_sync=True)
    before = [number * T for number in range(1, 150)]
    assert receive_syncs(clock, before) == []
    assert receive_syncs(clock, [150 * T - step]) == []  # it was read after the step
    for number in range(151, 300):
        assert receive_syncs(clock, [number * T]) == []


def test_foreign_sync_that_ended_is_forgotten_after_a_second():
    clock = started(has_kernel_sync=True)
    kernel = [number * T for number in range(1, 400)]
    foreign = [1.003, 1.013, 1.023, 1.033]
    assert receive_syncs(clock, [one for one in kernel if one < 1.05] + foreign)
    assert receive_syncs(clock, [one for one in kernel if 1.05 < one < 2.06]) == []


@given(st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=50), st.floats(0.0, 1e7))
def test_smooth_times_have_little_jitter(jitter, start):
    clock = started()
    times = []
    for number, share in enumerate([0.0, *jitter]):
        clock.begin(start + T * (number + share), 0.0)
        clock.finish(start + T * (number + share + 0.1))
        times.append(clock.smooth_time)
    for before, after in pairwise(times):
        assert after - before == pytest.approx(T, abs=0.02 * T)


@pytest.mark.parametrize('moved', [0.4, 7.4, 1e5 + 0.3])
def test_moved_sync_is_accepted_at_once(moved):
    clock = started()
    clock.begin(0.0, 100.0)
    clock.finish(0.1 * T)
    clock.begin(moved * T, 100.0)
    assert clock.smooth_time == pytest.approx(moved * T, abs=1e-9)


@pytest.mark.parametrize('step', [-30.0, -0.3, -0.05, 0.05, 0.3, 30.0])
def test_system_clock_step_leaves_smooth_times_unchanged(step):
    clock = started()
    for number in range(3):
        clock.begin(T * number, 100.0 + T * number + (step if number == 2 else 0.0))
        clock.finish(T * (number + 0.1))
    assert clock.smooth_time == pytest.approx(2.0 * T, abs=1e-9)
