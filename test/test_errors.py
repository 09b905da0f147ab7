"""Messages for an operator: one text, one next step."""

import pytest

from facade_manipulator.errors import InputError, joined


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


@pytest.mark.parametrize('lateness', [0.0, -0.0, 1e-9, 4e-4, 6e-4, 0.05, 3.0])
def test_order_is_explained_without_a_zero_duration(lateness):
    message = str(InputError.out_of_order('imu', lateness))
    assert '0.000' not in message and '-' not in message
    assert ('stamp of' in message) == (lateness < 5e-4)
