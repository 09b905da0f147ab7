"""What the master commands, checked from outside: it shares nothing with it but the bus."""

from __future__ import annotations

import struct

import can

from facade_manipulator.drives.axis_settings import AxisSettings

COMMANDS = struct.Struct('<Hbi')  # controlword, mode of operation, target position
ENABLED, CYCLIC_POSITION = 0x0F, 8
MOST_COMPLAINTS = 20


class CommandWatch:
    """
    Check every command that enables a drive: inside its stroke, and no farther than it can go.

    The margin is the largest step in a period [s] as a multiple of the speed limit.
    """

    def __init__(self, axes: tuple[AxisSettings, ...], period: float, margin: float = 1.1) -> None:
        self.enabling = 0  #: commands with power that were checked
        self.complaints: list[str] = []  #: what was wrong; the first of it
        #: range of the targets of each axis [m]
        self.least, self.greatest = [9.9] * len(axes), [-9.9] * len(axes)
        self._axes = {0x200 + axis.node_id: (n, axis) for n, axis in enumerate(axes)}
        self._last: dict[int, float] = {}
        self._steps = [margin * axis.max_speed * period + 1e-5 for axis in axes]

    def take(self, frames: list[can.Message]) -> None:
        """Check the frames that an independent listener has received."""
        for frame in frames:
            if frame.arbitration_id in self._axes and _is_plain(frame):
                self._check(frame.arbitration_id, bytes(frame.data))

    def _check(self, cob_id: int, data: bytes) -> None:
        number, axis = self._axes[cob_id]
        controlword, mode, counts = COMMANDS.unpack(data)
        if controlword & 0x0F != ENABLED or mode != CYCLIC_POSITION:
            self._last.pop(cob_id, None)
            return
        target = axis.to_metres(counts)
        self.enabling += 1
        self.least[number] = min(self.least[number], target)
        self.greatest[number] = max(self.greatest[number], target)
        step = abs(target - self._last.get(cob_id, target))
        self._last[cob_id] = target
        if step > self._steps[number]:
            self._complain(f'{cob_id:03X}h: a step of {step:.6f} m')
        if not axis.lower_limit - 1e-5 <= target <= axis.upper_limit + 1e-5:
            self._complain(f'{cob_id:03X}h: a target of {target:.6f} m')

    def _complain(self, message: str) -> None:
        if len(self.complaints) < MOST_COMPLAINTS:
            self.complaints.append(message)


def _is_plain(frame: can.Message) -> bool:
    return not (frame.is_extended_id or frame.is_remote_frame or frame.is_error_frame)
