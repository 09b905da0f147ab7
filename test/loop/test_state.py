"""The state of a cycle survives the channel unchanged."""

import pickle

from hypothesis import given, settings
from hypothesis import strategies as st

from facade_manipulator.drives.canopen.bus import BusStatistics
from facade_manipulator.drives.canopen.pdo import ConditionFrame, MotionFrame, StatusFrame
from facade_manipulator.drives.cia402.cause import Cause
from facade_manipulator.drives.cia402.settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.controller.cycle import CycleStatistics
from facade_manipulator.drives.controller.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.loop.state import pack_state, StreamStatus, unpack_state

INT = st.integers(-2**31, 2**31 - 1)
TEXT = st.text(max_size=10)


def maybe(strategy):
    return st.none() | strategy


def axis(number):
    return st.builds(
        AxisSnapshot, st.just(AXIS_NAMES[number]), st.just(DEFAULT_AXES[number]),
        maybe(st.builds(StatusFrame, INT, INT, INT)), maybe(st.builds(MotionFrame, INT, INT)),
        maybe(st.builds(ConditionFrame, INT, INT, INT)), st.booleans(), INT, maybe(INT),
        maybe(st.floats(0.0, 1.0)), INT, maybe(INT), maybe(st.floats(-1.0, 1.0)))


SNAPSHOTS = st.builds(
    ControllerSnapshot, st.sampled_from(ControllerState), maybe(st.floats(0.0, 2e9)),
    st.tuples(axis(0), axis(1), axis(2)),
    st.lists(TEXT.map(Cause), max_size=2).map(tuple), TEXT,
    st.lists(TEXT, max_size=2).map(tuple), INT.map(CycleStatistics), INT.map(BusStatistics),
    TEXT, st.floats(0.0, 1.0))
STATUSES = st.builds(StreamStatus, TEXT, INT, INT, TEXT, st.just((0.01, 0.02)), INT)


@settings(max_examples=50)
@given(SNAPSHOTS, STATUSES)
def test_a_state_arrives_as_it_was_sent(snapshot, status):
    packed = pickle.loads(pickle.dumps(pack_state(snapshot, status)))
    assert unpack_state(packed, DEFAULT_AXES) == (snapshot, status)
    assert type(unpack_state(packed, DEFAULT_AXES)[0].axes[0]) is AxisSnapshot
