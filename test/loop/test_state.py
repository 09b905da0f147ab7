"""The state of a cycle as it goes through the channel."""

import pickle

from facade_manipulator.drives.canopen.bus import BusStatistics, Condition
from facade_manipulator.drives.cia402.cause import Cause
from facade_manipulator.drives.cia402.settings import AXIS_NAMES
from facade_manipulator.drives.controller.cycle import CycleStatistics
from facade_manipulator.drives.controller.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.loop.control_loop import pack_state, StreamStatus, unpack_state

CAUSES = tuple(Cause(message, 'clear the faults') for message in ('first', 'second'))


def test_what_was_packed_and_pickled_is_the_same_again():
    axes = tuple(AxisSnapshot(name, number, 0x0027, velocity=-0.2, homed=True)
                 for number, name in enumerate(AXIS_NAMES, 1))
    one = ControllerSnapshot(
        ControllerState.ACTIVE, 1000.0, axes, causes=CAUSES, notes=('a note',), bus_load=0.1,
        bus=BusStatistics(7, condition=Condition.PASSIVE), cycle=CycleStatistics(3, worst=0.01))
    status = StreamStatus('following', margins=(0.01, 0.02))
    again, status_again = unpack_state(*pickle.loads(pickle.dumps(pack_state(one, status))))
    assert (again, status_again) == (one, status)
    assert (again.state, again.bus.condition) == (ControllerState.ACTIVE, Condition.PASSIVE)
    assert [type(part) for part in (*again.axes, again.cycle, status_again)] == [
        AxisSnapshot] * 3 + [CycleStatistics, StreamStatus]
