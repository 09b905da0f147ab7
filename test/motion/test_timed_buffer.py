"""Newest values of a signal, searched by time."""

from bisect import bisect_right

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.motion.timed_buffer import KEPT_TIME, TimedBuffer

TIMES = st.floats(-1.0, 2.0 * KEPT_TIME)


@given(st.lists(TIMES, max_size=30) | st.lists(TIMES, max_size=30).map(sorted), TIMES)
def test_buffered_values_are_found_by_time(times, time):
    buffer = TimedBuffer()
    kept = []
    # A value replaces those at and after its time, and old values are forgotten.
    for stamp in times:
        before = buffer.newest(99)
        buffer.append(stamp, -stamp)
        assert before == tuple(kept)
        kept = [item for item in kept if stamp - KEPT_TIME <= item[0] < stamp]
        kept.append((stamp, -stamp))
    index = bisect_right([stamp for stamp, _ in kept], time)
    items = [None, *kept, None]
    assert buffer.newest(99) == tuple(kept)
    assert buffer.around(time) == (items[index], items[index + 1])
    buffer.clear()
    assert buffer.newest() == ()
    assert buffer.around(time) == (None, None)


def test_value_between_two_is_interpolated_linearly():
    buffer = TimedBuffer()
    buffer.append(1.0, 10.0)
    buffer.append(2.0, 20.0)
    assert buffer.interpolated(1.25) == pytest.approx(12.5)
    assert buffer.interpolated(0.9) is None
    assert buffer.interpolated(2.0) is None


def test_value_is_interpolated_by_the_given_function():
    buffer = TimedBuffer(lambda *arguments: arguments)
    buffer.append(1.0, 'a')
    buffer.append(2.0, 'b')
    assert buffer.interpolated(1.5) == ((1.0, 'a'), (2.0, 'b'), 1.5)
