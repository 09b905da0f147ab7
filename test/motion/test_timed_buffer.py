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
    items = [None, *((each, -each) for each in times), None]
    assert filled(times).around(time) == (items[index], items[index + 1])


@given(TIMES)
def test_value_replaces_those_at_its_time_and_later(times):
    kept = [time for time, _ in filled(times).newest(len(times))]
    assert kept == [time for time in sorted(times) if time == times[-1] or (
        time < times[-1] and time < min(times[times.index(time) + 1:]))]


def test_old_values_are_forgotten_and_read_ones_kept():
    buffer = filled([0.0, 1.0, 1.0 + KEPT_TIME])
    read = buffer.newest(9)
    buffer.clear()
    assert read == ((1.0, -1.0), (1.0 + KEPT_TIME, -1.0 - KEPT_TIME))
    assert buffer.newest() == () and buffer.around(1.0) == (None, None)
