"""The newest values of a signal, found by their time."""

from bisect import bisect_right

from hypothesis import given
from hypothesis import strategies as st

from facade_manipulator.motion.timed_buffer import KEPT_TIME, TimedBuffer

TIMES = st.lists(st.floats(0.0, KEPT_TIME), min_size=1, max_size=30, unique=True)


def filled(times):
    buffer = TimedBuffer()
    for time in times:
        buffer.append(time, -time)
    return buffer


@given(TIMES.map(sorted), st.floats(-1.0, KEPT_TIME + 1.0))
def test_neighbours_of_a_time_are_found(times, time):
    index = bisect_right(times, time)
    before = (times[index - 1], -times[index - 1]) if index else None
    after = (times[index], -times[index]) if index < len(times) else None
    assert filled(times).around(time) == (before, after)


@given(TIMES)
def test_value_replaces_those_at_its_time_and_later(times):
    buffer = filled(times)
    kept = [time for time, _ in buffer.newest(len(times))]
    assert kept == sorted(kept) and kept[-1] == times[-1]
    assert buffer.around(times[-1]) == ((times[-1], -times[-1]), None)


def test_values_older_than_the_kept_time_are_forgotten():
    buffer = filled([0.0, 1.0, 1.0 + KEPT_TIME])
    assert buffer.newest(9) == ((1.0, -1.0), (1.0 + KEPT_TIME, -1.0 - KEPT_TIME))
    assert buffer.around(0.5)[0] is None


def test_empty_buffer_has_no_values():
    buffer = filled([1.0])
    buffer.clear()
    assert buffer.newest() == ()
    assert buffer.around(1.0) == (None, None)


def test_reader_keeps_its_values():
    buffer = filled([1.0])
    read = buffer.newest()
    buffer.append(0.5, 0.0)
    assert read == ((1.0, -1.0),)
    assert buffer.newest() == ((0.5, 0.0),)
