"""Messages for an operator: one text, one next step."""

import pytest

from facade_manipulator.errors import joined


@pytest.mark.parametrize(
    'messages, expected',
    [
        (('halted',), 'halted'),
        (('halted; next: a', ''), 'halted; next: a'),
        (('halted; next: a', 'late; next: b'), 'halted; late; next: a, then b'),
        (('halted', 'late; next: b', 'two'), 'halted; late; two; next: b'),
        (('halted; next: a', 'late; next: a'), 'halted; late; next: a'),
        ((), ''),
    ],
)
def test_joined_messages_have_one_next_step(messages, expected):
    assert joined(*messages) == expected
