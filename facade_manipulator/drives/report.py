"""Put together the snapshot that the rest of the program sees."""

from __future__ import annotations

from facade_manipulator.drives.cia402 import decode_state, State
from facade_manipulator.drives.emergency import describe
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.snapshot import AxisSnapshot
from facade_manipulator.errors import DriveStateError


def axis_snapshot(monitor: AxisMonitor, target: float | None, now: float) -> AxisSnapshot:
    """Return what is known of one axis at a time of the monotonic clock."""
    status, motion, condition = monitor.status, monitor.motion, monitor.condition
    axis = monitor.axis
    return AxisSnapshot(
        name=monitor.name,
        node_id=axis.node_id,
        serial_number=monitor.serial_number,
        position=monitor.position,
        velocity=monitor.velocity,
        force=axis.to_force(condition.torque) if condition else None,
        following_error=axis.to_metres(motion.following_error_counts) if motion else None,
        target=target,
        statusword=status.statusword if status else None,
        state=_state(status.statusword) if status else None,
        mode=status.mode if status else None,
        digital_inputs=condition.digital_inputs if condition else None,
        homed=monitor.homed,
        error_code=monitor.error_code,
        error=describe(monitor.error_code) if monitor.error_code else '',
        nmt_state=monitor.nmt_state,
        heartbeat_age=now - monitor.heartbeat_time if monitor.heartbeat_time else None,
        missed=monitor.missed,
    )


def _state(statusword: int) -> State | None:
    try:
        return decode_state(statusword)
    except DriveStateError:
        return None
