"""The state of one cycle: carriages, and what the levels and messages depend on."""

import pytest

from facade_manipulator.drives.axis_settings import AXIS_NAMES
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.snapshot import AxisSnapshot, ControllerSnapshot, ControllerState

ENABLED, WITH_TARGET_REACHED, FAULT = 0x0027, 0x0427, 0x0008
CAUSES = tuple(Cause(message, 'clear the faults') for message in ('first', 'second'))


def snapshot(*changes, **others):
    """Return a snapshot in which the first axes differ as each of the changes says."""
    axes = [AxisSnapshot(
        name, number, ENABLED, position=0.1, velocity=-0.2, force=5.0, following_error=0.0,
        digital_inputs=0, homed=True, heartbeat_age=1.0, serial_number=4711)
        for number, name in enumerate(AXIS_NAMES, 1)]
    for number, change in enumerate(changes):
        axes[number] = axes[number]._replace(**change)
    return ControllerSnapshot(
        ControllerState.ACTIVE, 1000.0, tuple(axes), bus_load=0.1)._replace(**others)


@pytest.mark.parametrize('one', [
    snapshot({'homed': False}), snapshot({}, {}, {'position': None}), snapshot(stamp=None),
    snapshot({'is_silent': True})], ids=['not homed', 'no position', 'no SYNC', 'silent'])
def test_unknown_carriage_position_gives_no_joints(one):
    assert one.joints() is None


@pytest.mark.parametrize(('other', 'is_same'), [
    (snapshot({'statusword': WITH_TARGET_REACHED}), True),
    (snapshot({'missed': 7, 'heartbeat_age': 3.0}), True),
    (snapshot(stamp=1001.0, bus_load=0.2), True),
    (snapshot(state=ControllerState.HALTED), False), (snapshot({'statusword': FAULT}), False),
    (snapshot({'homed': False}), False), (snapshot({'error_code': 0x2310}), False),
    (snapshot({'statusword': None}), False), (snapshot(causes=CAUSES), False),
    (snapshot(next_step='activate'), False), (snapshot(bus_error='no such device'), False)])
def test_outcome_depends_on_states_and_causes_only(other, is_same):
    assert (other.outcome() == snapshot().outcome()) is is_same
