"""Series of rejections of one input."""

import math

import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.rejections import Rejections


def test_series_keeps_its_first_message():
    rejections = Rejections()
    rejections.add(1.0, InputError('stale', '0.4 s old; next: a'))
    rejections.add(
        1.0 + 0.9 * Rejections.PAUSE, InputError('stale', '0.5 s old; next: a')
    )
    assert rejections.message(1.0 + 1.8 * Rejections.PAUSE) == '0.4 s old; next: a'


def test_message_changes_after_a_pause_of_its_reason():
    rejections = Rejections()
    rejections.add(0.0, InputError('stale', 'old; next: a'))
    messages = []
    for step in range(1, 13):
        now = step * 0.25 * Rejections.PAUSE
        rejections.add(now, InputError('frame', f'other {step}; next: b'))
        messages.append(rejections.message(now))
    assert messages == ['old; next: a'] * 4 + ['other 1; next: b'] * 8


@pytest.mark.parametrize('pause', [1.1 * Rejections.PAUSE, math.inf])
def test_series_ends_with_a_pause(pause):
    rejections = Rejections()
    rejections.add(1.0, InputError('stale', 'old; next: a'))
    assert rejections.message(1.0 + pause) == ''


def test_series_after_a_pause_has_the_new_message():
    rejections = Rejections()
    rejections.add(1.0, InputError('stale', 'old; next: a'))
    rejections.add(1.0 + 2.0 * Rejections.PAUSE, InputError('frame', 'other; next: b'))
    assert rejections.message(1.0 + 2.0 * Rejections.PAUSE) == 'other; next: b'


def test_valid_message_ends_the_series():
    rejections = Rejections()
    rejections.add(1.0, InputError('stale', 'old; next: a'))
    rejections.clear()
    assert rejections.message(1.0) == ''


def test_series_of_a_second_publisher_has_the_newest_names():
    rejections = Rejections()
    rejections.add(1.0, InputError('publishers', 'publishers (a, unknown); next: c'))
    rejections.add(1.1, InputError('publishers', 'publishers (a, b); next: c'))
    assert rejections.message(1.2) == 'publishers (a, b); next: c'
