"""
The state of a cycle on the channel: plain tuples, ten times faster than pickled classes.

What never changes, names and settings of the axes, is sent once, when the loop starts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from facade_manipulator.drives.canopen import (
    BusStatistics,
    ConditionFrame,
    MotionFrame,
    StatusFrame,
)
from facade_manipulator.drives.cia402 import AXIS_NAMES, AxisSettings
from facade_manipulator.drives.controller import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
    CycleStatistics,
)

FRAMES = (StatusFrame, MotionFrame, ConditionFrame)
_FIRST_PLAIN = 2 + len(FRAMES)  # of an AxisSnapshot's fields, after name, settings and frames


class StreamStatus(NamedTuple):
    """
    How the setpoints are followed; see `facade_manipulator.motion.SetpointFollower`.

    Attributes
    ----------
    activity : str
    limited_cycles, brakes : int
    last_brake : str
    margins : tuple of float
        1st and 50th percentile of how early setpoints come [s]; empty before the first.
    dropped : int
        States that did not fit into the channel, because the node was busy.

    """

    activity: str = 'holding'
    limited_cycles: int = 0
    brakes: int = 0
    last_brake: str = ''
    margins: tuple[float, ...] = ()
    dropped: int = 0


def pack_state(snapshot: ControllerSnapshot, status: StreamStatus) -> tuple:
    """Return what `unpack_state` makes the same state of."""
    axes = tuple([
        (*[frame and tuple(frame) for frame in one[2:_FIRST_PLAIN]], *one[_FIRST_PLAIN:])
        for one in snapshot.axes])
    return (tuple(status), axes, snapshot.state.value, tuple(snapshot.cycle), tuple(snapshot.bus),
            snapshot.stamp, snapshot.causes, snapshot.next_step, snapshot.notes,
            snapshot.bus_error, snapshot.bus_load)


def unpack_state(
    packed: tuple, settings: tuple[AxisSettings, ...]
) -> tuple[ControllerSnapshot, StreamStatus]:
    """Return the state that was packed, with the settings of the axes."""
    status, axes, state, cycle, bus, stamp, causes, next_step, notes, error, load = packed
    return ControllerSnapshot(
        ControllerState(state), stamp,
        tuple(_unpack_axis(*each) for each in zip(AXIS_NAMES, settings, axes, strict=True)),
        causes, next_step, notes, CycleStatistics(*cycle), BusStatistics(*bus), error, load,
    ), StreamStatus(*status)


def _unpack_axis(name: str, settings: AxisSettings, packed: tuple[Any, ...]) -> AxisSnapshot:
    frames = [values and kind(*values) for kind, values in zip(FRAMES, packed, strict=False)]
    return AxisSnapshot(name, settings, *frames, *packed[len(FRAMES):])
