"""Causes of stops that no frame brings: requested, silence, a late loop, homing carriages."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from facade_manipulator.drives.cia402 import (
    BUS_REMEDY,
    Cause,
    COMPUTER_REMEDY,
    Group,
    HomingSequence,
    HomingState,
    Phase,
    STOPPED_PHASES,
)
from facade_manipulator.drives.controller.cycle import CycleClock
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.targets import HomingCheck
from facade_manipulator.errors import ManipulatorError


class Supervision:
    """
    Checks that are due once a cycle.

    Parameters
    ----------
    settings : ControllerSettings
    check_homing : callable
        See `facade_manipulator.drives.controller.targets.MechanismChecks`.

    Attributes
    ----------
    stops : deque of Cause
        Stops asked for; any thread may append.
    homing : HomingSequence or None
        The last homing.

    """

    def __init__(self, settings: ControllerSettings, check_homing: HomingCheck) -> None:
        self.stops: deque[Cause] = deque(maxlen=16)
        self.homing: HomingSequence | None = None
        self._settings = settings
        self._check_homing = check_homing

    def causes(self, group: Group, monitors: Sequence[AxisMonitor]) -> list[Cause]:
        """Return why to stop, as far as neither bus nor clock is the reason."""
        causes = [self.stops.popleft() for _ in range(len(self.stops))]
        if group.phase is Phase.HOMING:
            causes += self._homing_causes(monitors)
        return causes

    def timing_causes(
        self, group: Group, monitors: Sequence[AxisMonitor], clock: CycleClock, read_until: float,
    ) -> list[Cause]:
        """
        Return why to stop because somebody was late or silent; nothing once the drives stop.

        `read_until` is the time [s] up to which all received frames have been read: what still
        waits to be read may be the very answer that seems to be missing.
        """
        if group.phase in STOPPED_PHASES:
            return []
        return [*_silences(monitors, read_until), *self._late_causes(group, clock)]

    def _homing_causes(self, monitors: Sequence[AxisMonitor]) -> list[Cause]:
        homed = tuple(axis.state is HomingState.HOMED for axis in self.homing.axes)
        try:
            self._check_homing(tuple(monitor.position for monitor in monitors), homed)
        except ManipulatorError as error:
            return [Cause(f'homing stopped: {error}', 'move the carriages apart by hand, clear '
                          'the faults, then home')]
        return []

    def _late_causes(self, group: Group, clock: CycleClock) -> list[Cause]:
        bound = self._settings.max_missed_cycles
        causes = []
        if clock.late_in_a_row >= bound and group.is_powered:
            causes.append(Cause(
                f'the control loop was late {clock.late_in_a_row} cycles in a row, bound {bound}',
                COMPUTER_REMEDY))
        if clock.overdue_in_a_row >= bound:
            causes.append(Cause(
                f'the kernel sent no SYNC for {clock.overdue_in_a_row} periods, bound {bound}',
                'clean up and configure again', configure_again=True))
        return causes


def _silences(monitors: Sequence[AxisMonitor], now: float) -> list[Cause]:
    """Return one cause for the bus, rather than three for the drives, when all are silent."""
    causes = [cause for monitor in monitors if (cause := monitor.silence(now)) is not None]
    if len(causes) == len(monitors):
        return [Cause(f'no drive answers any more: {causes[0].message}', BUS_REMEDY)]
    return causes
