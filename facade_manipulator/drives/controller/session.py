"""
The drives, the bus they are on, and what became of both; used in the control thread alone.

A session outlives its bus: when the bus is lost the group stays stopped, the home positions are
kept, and the bus is looked for again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
import time

import can

from facade_manipulator.drives.canopen import BusStatistics, Condition
from facade_manipulator.drives.cia402 import (
    AXIS_NAMES,
    AxisSettings,
    BUS_REMEDY,
    Cause,
    check_axes,
    Group,
    HomingSequence,
    HomingState,
    load_profile,
    Phase,
    STOPPED_PHASES,
    Triple,
)
from facade_manipulator.drives.controller.bus_load import check_bus_load
from facade_manipulator.drives.controller.configuration import object_writes
from facade_manipulator.drives.controller.connection import connect, Connection, open_frames
from facade_manipulator.drives.controller.cycle import CycleStatistics
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.realtime import Collector
from facade_manipulator.drives.controller.recorder import FaultRecorder
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.targets import Targets, TargetSource
from facade_manipulator.errors import BusError, DriveStateError, ManipulatorError

HomingCheck = Callable[[Triple, tuple[bool, bool, bool]], None]
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 2.0


@dataclass
class LostBus:
    """A bus that is gone: why, when to try again, since when the new one is healthy."""

    message: str
    next_try: float
    pause: float
    healthy_since: float | None = None


class Session:
    """
    Three drives and their bus.

    Parameters
    ----------
    settings : ControllerSettings
    axes : tuple of AxisSettings
        q1, q2, q3.
    open_bus : callable
        Returns an open python-can bus or raises.
    source : TargetSource
    check_targets, check_homing : callable
        See `facade_manipulator.drives.controller.controller.DriveController`.
    on_cycle : callable
        Called with the time after each cycle.
    bitrate : int
        Of the bus [bit/s].
    recorder : FaultRecorder, optional

    Attributes
    ----------
    connection : Connection or None
        The open bus.
    group : Group or None
        The state machine, once the drives are configured.
    lost : LostBus or None
        Set while a bus that was configured is gone.
    homing : HomingSequence or None
        The last homing.
    notes : tuple of str
        What was skipped at configure.

    """

    def __init__(
        self, settings: ControllerSettings, axes: tuple[AxisSettings, ...],
        open_bus: Callable[[], can.BusABC], source: TargetSource,
        check_targets: Callable[[Triple], None], check_homing: HomingCheck,
        on_cycle: Callable[[float], None], bitrate: int = 1_000_000,
        recorder: FaultRecorder | None = None,
    ) -> None:
        check_axes(axes)
        self.settings = settings
        self.bus_load = check_bus_load(settings, bitrate)
        self._profiles = tuple(load_profile(axis.profile) for axis in axes)
        self.axes = tuple(
            replace(axis, velocity_unit=profile.velocity_unit)
            for axis, profile in zip(axes, self._profiles, strict=True))
        for profile, axis in zip(self._profiles, self.axes, strict=True):
            object_writes(profile, axis, settings)
        self.targets = Targets(AXIS_NAMES, self.axes, settings, source, check_targets)
        self.check_targets = check_targets
        self.worker = ThreadPoolExecutor(1, thread_name_prefix='drive objects')
        self.stops: deque[Cause] = deque(maxlen=16)
        self.fed = 0.0
        self.recorder = recorder
        self._check_homing = check_homing
        self._open_bus = open_bus
        self._on_cycle = on_cycle
        self._collector = Collector(settings.rate)
        self._forget()

    def _forget(self) -> None:
        self.connection: Connection | None = None
        self.group: Group | None = None
        self.lost: LostBus | None = None
        self.homing: HomingSequence | None = None
        self.notes: tuple[str, ...] = ()
        self.stops.clear()
        self.monitors = tuple(
            AxisMonitor(name, axis, self.settings)
            for name, axis in zip(AXIS_NAMES, self.axes, strict=True))

    @property
    def is_powered(self) -> bool:
        """Tell whether the drives are meant to have power."""
        return self.group is not None and self.group.is_powered

    @property
    def is_stopped(self) -> bool:
        """Tell whether something has stopped the drives and was not cleared yet."""
        group = self.group
        return group is not None and group.cause is not None and group.phase in STOPPED_PHASES

    @property
    def is_off(self) -> bool:
        """Tell whether all drives have confirmed that they have no power."""
        return self.has_done(Phase.OFF)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Why the drives are stopped, the first cause first; empty while they are not."""
        group = self.group
        return () if group is None or group.cause is None else (
            group.cause, *group.further_causes)

    @property
    def unhomed(self) -> list[str]:
        """Names of the axes that must be homed."""
        return [monitor.name for monitor in self.monitors if not monitor.homed]

    @property
    def cycle_statistics(self) -> CycleStatistics:
        """Counters of the cycle."""
        return self.connection.stream.clock.statistics if self.connection else CycleStatistics()

    @property
    def bus_statistics(self) -> BusStatistics:
        """Counters of the bus."""
        return self.connection.bus.statistics if self.connection else BusStatistics()

    def has_done(self, phase: Phase) -> bool:
        """Tell whether all drives are where a phase wants them."""
        return self.group is not None and self.group.phase is phase and self.group.is_settled

    def positions(self) -> Triple:
        """
        Return where the carriages are [m].

        Raises
        ------
        DriveStateError
            A drive has not told it yet.

        """
        positions = tuple(monitor.position for monitor in self.monitors)
        if None in positions:
            raise DriveStateError('not every drive has told its position yet: try again')
        return positions

    # --- the bus: opened, lost, back, closed

    def open(self) -> None:
        """
        Open the bus.

        Raises
        ------
        BusError
            Why it cannot be opened.

        """
        tap = self.recorder.add if self.recorder is not None else None
        frames = open_frames(self._open_bus, tap)
        if self.settings.own_garbage_collection:
            self._collector.start()  # its first, full collection takes longer than a heartbeat
        self.connection = connect(
            frames, self.monitors, self._profiles, self.settings, self.targets, self._causes,
            self._finish_cycle)

    def start_cycle(self, now: float) -> None:
        """Let the cycle run, with all drives switched off."""
        settings = self.settings
        self.group = Group(
            AXIS_NAMES, settings.step_timeout, settings.ramp_timeout, settings.hold_cycles,
            settings.max_resets_per_minute, now)
        self.connection.stream.start(self.group, time.monotonic())

    def close(self) -> None:
        """Leave the drives in NMT pre-operational, close the bus, forget everything."""
        if self.connection is not None:
            self.connection.leave()
        self._collector.stop()
        self._forget()

    def lose(self, error: BusError, now: float) -> None:
        """Fall silent, so that the drives stop by themselves, and look for the bus again."""
        if self.connection is not None:
            self.connection.close()
            self.connection = None
        if self.group is not None:
            pause = min(2.0 * self.lost.pause, LONGEST_PAUSE) if self.lost else FIRST_PAUSE
            self.lost = LostBus(str(error), now + pause, pause)
            self.group.stop(Cause(str(error), BUS_REMEDY), now)

    def try_to_reopen(self, now: float) -> None:
        """
        Open a lost bus and listen; nothing is sent yet.

        Raises
        ------
        BusError
            It is still gone.

        """
        self.open()
        self.connection.stream.speaks = False
        self.lost.healthy_since = now

    def watch_recovery(self, now: float) -> None:
        """Speak again on a bus that has been healthy for a while; the drives stay stopped."""
        if self.lost is None or self.connection is None:
            return
        if self.connection.bus.statistics.condition >= Condition.PASSIVE:
            self.lost.healthy_since = now
        if now - self.lost.healthy_since >= self.settings.reopen_after:
            self.lost = None
            for monitor in self.monitors:
                monitor.forget()
            self.group.give_time(now)
            self.connection.stream.speaks = True
            self.connection.stream.start(self.group, now)

    # --- once per cycle

    def _causes(self, now: float) -> list[Cause]:
        """Return why to stop, as far as it does not come from the drives."""
        causes = [self.stops.popleft() for _ in range(len(self.stops))]
        silence, bound = now - self.fed, self.settings.watchdog_timeout
        if self.is_powered and silence > bound:
            causes.append(Cause(
                f'the executor has not run for {1e3 * silence:.0f} ms, '
                f'bound {1e3 * bound:.0f} ms'))
        if self.group.phase is Phase.HOMING:
            causes += self._homing_causes()
        return causes

    def _homing_causes(self) -> list[Cause]:
        homed = tuple(axis.state is HomingState.HOMED for axis in self.homing.axes)
        try:
            self._check_homing(self.positions(), homed)
        except ManipulatorError as error:
            return [Cause(f'homing stopped: {error}', 'move the carriages apart by hand, clear '
                          'the faults, then home')]
        return []

    def _finish_cycle(self, now: float) -> None:
        self._on_cycle(now)
        self._collector.use_slack()
