"""State of one cycle: positions for users, reported changes, and states of the drives."""

import re

import pytest

from facade_manipulator.drives.outcome import outcome_of
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.drives.states import (
    decode_state,
    describe_state,
    State,
    STATUSWORDS,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES

ENABLED = 0x0027
WITH_TARGET_REACHED = 0x0427
FAULT = 0x0008
CAUSES = tuple(Cause(message, 'clear the faults') for message in ('first', 'second'))


def snapshot(*changes, **others):
    """Return a snapshot whose first axes have the given changes."""
    usual = {'position': 0.1, 'homed': True, 'heartbeat_age': 1.0}
    axes = []
    for number, name in enumerate(AXIS_NAMES):
        change = changes[number] if number < len(changes) else {}
        details = {'statusword': ENABLED} | usual | change
        axes.append(AxisSnapshot(name, number + 1, **details))
    details = {'state': ControllerState.ACTIVE, 'stamp': 1000.0} | others
    return ControllerSnapshot(axes=tuple(axes), **details)


def reported(one):
    """Return the values whose change the driver publishes."""
    return outcome_of(one), one.component_states()


@pytest.mark.parametrize(
    'one',
    [
        snapshot({'homed': False}),
        snapshot({}, {}, {'position': None}),
        snapshot(stamp=None),
        snapshot({'is_silent': True}),
    ],
)
def test_unknown_carriage_position_gives_no_joint_states(one):
    assert one.joints() is None


@pytest.mark.parametrize(
    ('other', 'is_same'),
    [
        (snapshot({'statusword': WITH_TARGET_REACHED}), True),
        (snapshot({'missed': 7, 'heartbeat_age': 3.0}), True),
        (snapshot(stamp=1001.0), True),
        (snapshot(state=ControllerState.HALTED), False),
        (snapshot({'statusword': FAULT}), False),
        (snapshot({'homed': False}), False),
        (snapshot({'error_code': 0x2310}), False),
        (snapshot({'statusword': None}), False),
        (snapshot(causes=CAUSES), False),
        (snapshot(next_step='activate'), False),
        (snapshot(bus_error='no such device'), False),
    ],
)
def test_reported_change_depends_only_on_states_and_causes(other, is_same):
    assert (reported(other) == reported(snapshot())) is is_same


@pytest.mark.parametrize(
    ('pattern', 'state'),
    [
        ('x0xx0000', State.NOT_READY_TO_SWITCH_ON),
        ('x1xx0000', State.SWITCH_ON_DISABLED),
        ('x01x0001', State.READY_TO_SWITCH_ON),
        ('x01x0011', State.SWITCHED_ON),
        ('x01x0111', State.OPERATION_ENABLED),
        ('x00x0111', State.QUICK_STOP_ACTIVE),
        ('x0xx1111', State.FAULT_REACTION_ACTIVE),
        ('x0xx1000', State.FAULT),
    ],
)
def test_statusword_patterns_of_cia_402_have_their_states(pattern, state):
    for ignored in '01':
        assert decode_state(int(pattern.replace('x', ignored), 2)) is state


def test_no_statusword_has_two_states():
    for word in range(0x10000):
        names = [s for s, (mask, value) in STATUSWORDS.items() if word & mask == value]
        assert names == ([] if decode_state(word) is None else [decode_state(word)])


def test_statusword_without_state_is_described_by_its_wrong_bits():
    assert re.fullmatch(
        r'no state of CiA 402 \(statusword 0267h\); '
        'it would be operation enabled with bit 6 = 0',
        describe_state(0x0267),
    )
    for word in range(0x10000):
        _, _, wrong = describe_state(word).partition(' with ')
        changed = word
        for bit, value in re.findall(r'bit (\d+) = (\d)', wrong):
            changed = changed & ~(1 << int(bit)) | int(value) << int(bit)
        assert decode_state(changed) is not None
