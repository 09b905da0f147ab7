from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.cycle import (
    ANSWERS_DUE,
    COMMANDS_DUE,
    CycleClock,
    FIRST_ANSWER_DUE,
    LATE_WINDOW,
    LATENESS_BOUNDS,
    MIN_GAP,
    OTHERS_DUE,
    SYNC_MISSING,
    SYNC_OVERDUE,
    SyncConsumer,
    SyncProducer,
)

T = 0.01
ALL = 3


def producer() -> SyncProducer:
    clock = SyncProducer(T, ALL)
    clock.start(0.0)
    return clock


def consumer() -> SyncConsumer:
    clock = SyncConsumer(T, ALL)
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

def test_the_loop_sends_sync_once_a_period():
    clock = producer()
    for number in range(5):
        assert sync_due(clock, T * number)
        clock.begin(T * number, 0.0)
        clock.finish(T * (number + 0.1))
        assert not sync_due(clock, T * (number + 0.99))
    assert clock.statistics.cycles == 5
    assert clock.statistics.skipped == 0


@pytest.mark.parametrize('make', [producer, consumer])
@pytest.mark.parametrize('end', [None, lambda clock: clock.finish(0.1 * T), CycleClock.stop],
                         ids=['before the first SYNC', 'done', 'stopped'])
def test_no_step_is_due_without_a_sync_nor_twice_nor_when_stopped(make, end):
    clock = make()
    if end is not None:
        clock.begin(0.0, 0.0)
        end(clock)
    assert not step_due(clock, 9 * T, answers=ALL)
    assert sync_due(clock, 9 * T) is (end is not CycleClock.stop)


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
def test_the_step_comes_with_the_last_answer_or_when_there_is_no_more_time(make, times):
    clock = make()
    clock.begin(0.0, 0.0)
    for share, answers, is_due in times:
        assert step_due(clock, share * T, answers) is is_due


def test_what_is_due_waits_a_little_longer_while_frames_wait_to_be_read():
    clock = consumer()
    assert not sync_due(clock, 2 * T, all_read=False)
    assert sync_due(clock, SYNC_MISSING * T, all_read=False)
    clock.receive(0.0, 0.0)
    assert not step_due(clock, ANSWERS_DUE * T, all_read=False)
    assert step_due(clock, COMMANDS_DUE * T, all_read=False)


def test_a_late_step_waits_for_the_frames_that_came_before_it_was_due():
    clock = producer()
    clock.begin(0.0, 0.0)
    assert clock.may_wait(now=5.0 * T, time=0.5 * T)
    assert not clock.may_wait(now=5.0 * T, time=FIRST_ANSWER_DUE * T)
    assert step_due(clock, 5.0 * T, answers=ALL)
    assert not clock.may_wait(now=5.0 * T, time=0.5 * T)


def test_frames_that_come_faster_than_they_are_read_delay_a_step_for_a_period_at_most():
    clock = producer()
    for sent in (0.0, 10.0 * T):
        clock.begin(sent, 0.0)
        assert clock.may_wait(now=sent + 5.0 * T, time=sent)
        assert clock.may_wait(now=sent + 5.9 * T, time=sent + 0.5 * T)
        assert not clock.may_wait(now=sent + 6.1 * T, time=sent + 0.5 * T)
        clock.finish(sent + 6.1 * T)


def test_late_commands_go_out_and_delay_the_next_sync():
    clock = producer()
    clock.begin(0.0, 0.0)
    assert clock.finish(1.5 * T)
    assert clock.statistics.late == 1
    assert not sync_due(clock, (1.49 + MIN_GAP) * T)
    assert sync_due(clock, (1.51 + MIN_GAP) * T)


@given(st.lists(st.floats(0.0, 0.1), min_size=1, max_size=50))
def test_late_syncs_are_never_squeezed_together_to_catch_up(delays):
    clock = producer()
    now, last = 0.0, -1.0
    for delay in delays:
        now = max(now, clock.next_event) + delay
        assert sync_due(clock, now)
        assert now - last >= COMMANDS_DUE * T - 1e-9
        clock.begin(now, 0.0)
        clock.finish(now)
        last = now


def test_periods_without_sync_are_counted():
    clock = producer()
    clock.begin(0.0, 0.0)
    clock.finish(0.0)
    clock.begin(4.5 * T, 0.0)
    assert clock.statistics.skipped == 3


@pytest.mark.parametrize(('pause', 'held'), [(1.0, 0), (1.4, 0), (2.0, 1), (5.1, 4)])
def test_a_late_sync_is_a_command_that_the_drives_have_held(pause, held):
    clock = producer()
    for time in (0.0, pause * T):
        assert clock.held == 0.0  # the first are no later than any
        clock.begin(time, 0.0)
        clock.finish(time)
    assert clock.held == pytest.approx(held * T)


# --- SYNC sent by the kernel

def test_syncs_of_the_kernel_without_commands_are_those_that_the_drives_have_held():
    clock, held = consumer(), []
    for number, share in enumerate((0.1, 0.9, 0.9, 0.1, 0.1), start=1):
        clock.receive(T * number, 0.0)
        if clock.finish(T * (number + share)):
            held.append(round(clock.held / T))
    assert held == [0, 2, 0]


@given(st.lists(st.floats(0.0, 0.99), min_size=1, max_size=20))
def test_commands_later_than_four_fifths_of_the_period_are_late_until_one_is_in_time(shares):
    clock, row = consumer(), 0
    for number, share in enumerate(shares, start=1):
        clock.receive(T * number, 0.0)
        age = T * (number + share) - T * number
        assert clock.finish(T * (number + share)) is (age <= COMMANDS_DUE * T)
        row = 0 if age <= COMMANDS_DUE * T else row + 1
        assert clock.late_in_a_row == row
    assert clock.statistics.late >= row


@pytest.mark.parametrize('late', [0, 1, ALL])
def test_answers_that_come_after_the_step_do_not_count_for_the_next_one(late):
    for clock in (producer(), consumer()):
        clock.begin(0.0, 0.0)
        clock.finish(ANSWERS_DUE * T)
        assert not step_due(clock, 0.9 * T, answers=late)
        clock.begin(2 * T, 0.0)
        assert not step_due(clock, 2.1 * T, answers=ALL - 1)
        assert step_due(clock, 2.1 * T, answers=1)
        clock.finish(2.1 * T)
        assert clock.statistics.incomplete == 1


def test_the_kernels_sync_is_replaced_when_it_is_overdue():
    clock = consumer()
    assert not sync_due(clock, T)
    assert sync_due(clock, SYNC_OVERDUE * T)
    clock.begin(SYNC_OVERDUE * T, 0.0)
    assert clock.overdue_in_a_row == clock.statistics.skipped == 1
    clock.receive(2 * T, 0.0)
    assert clock.overdue_in_a_row == 0


def test_a_sync_that_comes_too_early_is_somebody_elses():
    clock = consumer()
    clock.receive(T, 0.0)
    assert clock.is_unexpected(1.4 * T)
    assert not clock.is_unexpected(1.9 * T)
    assert clock.statistics.unexpected == 1


@pytest.mark.parametrize('is_powered', [True, False])
def test_a_loop_that_is_late_so_often_stops_what_has_power_and_no_sync_stops_all(is_powered):
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


def test_who_sends_sync_between_ours_under_power_is_named_and_stops_all():
    clock = consumer()
    for number in range(1, 4):
        assert clock.causes(3, True) == []
        assert clock.is_unexpected((number - 0.6) * T)
        clock.receive(number * T, 0.0)
    cause, = clock.causes(3, True)
    assert 'SYNC (080h) was received between ours in 3 periods' in cause.message
    clock.receive(4 * T, 0.0)
    assert clock.causes(3, True) == []


@given(st.lists(st.floats(0.0, 0.5), max_size=50))
def test_the_histogram_holds_every_step(ages):
    clock = consumer()
    for number, age in enumerate(ages):
        clock.receive(float(number), 0.0)
        clock.finish(number + age)
    statistics = clock.statistics
    assert sum(statistics.lateness) == statistics.cycles == statistics.incomplete == len(ages)
    assert len(statistics.lateness) == len(LATENESS_BOUNDS) + 1


@pytest.mark.parametrize('late', [0, 1, LATE_WINDOW])
def test_the_share_of_late_cycles_is_that_of_the_last_window(late):
    clock, shares = consumer(), []
    for number in range(3 * LATE_WINDOW):
        clock.receive(T * number, 0.0)
        is_late = LATE_WINDOW <= number < LATE_WINDOW + late
        clock.finish(T * (number + (0.9 if is_late else 0.1)))
        shares.append(clock.statistics.late_share)
    assert shares[LATE_WINDOW - 1::LATE_WINDOW] == [0.0, late / LATE_WINDOW, 0.0]
    assert {*shares[:2 * LATE_WINDOW - 1]} == {0.0}


# --- stamps without jitter

@given(st.lists(st.floats(-0.1, 0.1), min_size=2, max_size=50), st.floats(1e9, 2e9))
def test_jitter_of_sync_hardly_reaches_the_smooth_stamps(jitter, start):
    clock = producer()
    stamps = []
    for number, share in enumerate([0.0, *jitter]):
        clock.begin(T * number, start + T * (number + share))
        clock.finish(T * (number + 0.1))
        stamps.append(clock.smooth_stamp)
    for before, after in zip(stamps, stamps[1:], strict=False):
        assert after - before == pytest.approx(T, abs=0.02 * T)


@pytest.mark.parametrize('moved', [0.4, 7.4, -3.6, 1e5 + 0.3])
def test_a_sync_at_another_place_and_a_clock_that_was_set_are_believed_at_once(moved):
    clock = producer()
    clock.begin(0.0, 100.0)
    clock.finish(0.1 * T)
    clock.begin(T, 100.0 + moved * T)
    assert clock.smooth_stamp == pytest.approx(100.0 + moved * T, abs=1e-9)


def test_periods_without_sync_leave_the_smooth_stamps_in_step():
    clock = consumer()
    for number in (0, 1, 4, 5):
        clock.receive(T * number, 100.0 + T * number)
        clock.finish(T * (number + 0.1))
        assert clock.smooth_stamp == pytest.approx(100.0 + T * number, abs=1e-9)
