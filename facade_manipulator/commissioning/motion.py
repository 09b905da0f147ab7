"""
A few carriages under power, slowly, within a window around where they stood; no homing needed.

Whoever moves calls `Motion.step` for each cycle: SYNC, the drives' answers, then heartbeat and
targets. Heartbeats come from that loop alone, so that a process that hangs, is stopped or killed
falls silent, and the drives quick-stop by themselves (1016h, 6007h) within `HEARTBEAT_TIMEOUT`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
import math
import signal
import threading
import time
from typing import NamedTuple

from facade_manipulator.commissioning.bus import read_number, ToolBus
from facade_manipulator.commissioning.scan import only_drive
from facade_manipulator.drives.canopen import (
    decode_emergency,
    describe,
    emergency_cob_id,
    Frame,
    heartbeat_cob_id,
    MASTER_NODE_ID,
    NmtCommand,
    NmtState,
    SYNC_COB_ID,
)
from facade_manipulator.drives.cia402 import (
    AxisCommand,
    AxisSettings,
    Cause,
    Feedback,
    FOLLOWING_PHASES,
    Group,
    GroupSettings,
    load_profile,
    Phase,
)
from facade_manipulator.drives.controller import (
    ControllerSettings,
    object_writes,
    pdo_writes,
    write_objects,
)
from facade_manipulator.errors import BusError, CommissioningError

RATE = 100
PERIOD = 1.0 / RATE
HEARTBEAT_TIMEOUT = 0.1  # s
MAX_SPEED = 0.05  # m/s, of anything that this tool moves
ACCELERATION = 1.0  # m/s²
MAX_WINDOW = 0.2  # m
_MARGIN = 0.002  # m, between the window and the drive's own limits
_FOLLOWING_ERROR = 0.003  # m
_REST_SPEED = 0.002  # m/s
_MISSED = 5  # cycles
_ANSWER_TIME = 0.8 * PERIOD
_READY_TIME = 8.0  # s
CONTROLWORD, STATUSWORD, ERROR_CODE, MODE, DISPLAYED_MODE = 0x6040, 0x6041, 0x603F, 0x6060, 0x6061
TARGET, POSITION, VELOCITY, TORQUE, INPUTS = 0x607A, 0x6064, 0x606C, 0x6077, 0x60FD


class AxisSample(NamedTuple):
    """An axis at a SYNC: position since power-on [m], velocity [m/s], motor's force [N], 60FDh."""

    position: float
    velocity: float
    force: float
    inputs: int


class _Carriage:
    """An axis of a motion: what its drive is, what it sent last, what it is sent."""

    def __init__(self, name: str, axis: AxisSettings) -> None:
        self.name = name
        self.profile = load_profile(axis.profile)
        self.axis = replace(axis, velocity_unit=self.profile.velocity_unit)
        self.feedback = Feedback(0x40)
        # all with every SYNC: switches and torque are measured
        self.pdos = [replace(one, transmission=1) for one in self.profile.pdos]
        self.tpdos, self._rpdos = (
            {one.cob_id(axis.node_id): one for one in self.pdos if one.is_transmitted is sent}
            for sent in (True, False))
        self._values: dict[int, int] = {}
        self._base = 0  # counts where it stood

    def limited(self, here: float, window: float) -> AxisSettings:
        """Return its settings with limits around where it is [m]."""
        return replace(
            self.axis, home_position=here, lower_limit=here - window, upper_limit=here + window,
            limit_margin=_MARGIN, max_speed=2.0 * MAX_SPEED,
            max_acceleration=max(self.axis.max_acceleration, ACCELERATION),
            following_error_window=min(self.axis.following_error_window, _FOLLOWING_ERROR))

    def receive(self, latest: dict[int, Frame], is_following: bool) -> AxisSample:
        """Return what the newest TPDOs say; what did not come stays as it was."""
        values, axis = self._values, self.axis
        before = values.get(POSITION, 0)
        for cob_id, one in self.tpdos.items():
            if cob_id in latest:
                values.update(zip(one.indices, one.unpack(latest[cob_id].data), strict=True))
        if POSITION not in values:
            return AxisSample(0.0, 0.0, 0.0, 0)
        speed = (axis.speed_to_metres(values[VELOCITY]) if VELOCITY in values else
                 axis.to_metres(values[POSITION] - before) / PERIOD)
        if not is_following:
            self._base = values[POSITION]
        self.feedback = Feedback(
            values[STATUSWORD], values[DISPLAYED_MODE], abs(speed) < _REST_SPEED,
            values.get(ERROR_CODE, 0))
        return AxisSample(axis.to_metres(values[POSITION] - self._base), speed,
                          axis.to_force(values.get(TORQUE, 0)), values.get(INPUTS, 0))

    def encode(self, command: AxisCommand, displacement: float) -> list[tuple[int, bytes]]:
        """Return the RPDOs, with their COB-IDs, of a command and a displacement [m]."""
        values = {CONTROLWORD: command.controlword, MODE: command.mode,
                  TARGET: self._base + self.axis.to_counts(displacement)}
        return [(cob_id, one.encode(values)) for cob_id, one in self._rpdos.items()]


class Motion:
    """
    Carriages in cyclic synchronous position, powered while the context lasts, moved all alike.

    Parameters
    ----------
    bus : ToolBus
    axes : dict
        Settings by name; these drives are reset, written to and powered, the others not.
    name : str
        The one whose answers are returned.
    window : float
        How far a carriage may go from its start [m].

    """

    def __init__(
        self, bus: ToolBus, axes: dict[str, AxisSettings], name: str, window: float
    ) -> None:
        self._bus = bus
        self.window = min(window, MAX_WINDOW)
        self._carriages = [_Carriage(*item) for item in axes.items()]
        self._number = list(axes).index(name)
        self._group = Group(tuple(axes), GroupSettings(hold_cycles=5), time.monotonic())
        self._displacement = 0.0
        self._missed = 0
        self._tick = 0.0
        self._is_stopping = False

    def __enter__(self) -> Motion:
        try:
            for carriage in self._carriages:
                self._configure(carriage)
            self._tick = time.monotonic()
            self._run_until(Phase.OFF)
            self._group.enable(time.monotonic())
            self._run_until(Phase.RUNNING)
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, kind: type | None, *details: object) -> None:
        if kind is None and self._group.phase is Phase.RUNNING:
            with suppress(BusError, CommissioningError):
                self._group.disable(time.monotonic())
                self._run_until(Phase.OFF)
        self._stop()

    def _configure(self, carriage: _Carriage) -> None:
        """Reset a drive, so that it is without fault, and give it limits around where it is."""
        node_id, profile = carriage.axis.node_id, carriage.profile
        drive = only_drive(self._bus, carriage.axis, carriage.name, eds=profile.eds)
        self._bus.reset(node_id)
        self._bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, node_id)
        here = carriage.axis.to_metres(read_number(drive, POSITION, signed=True))
        settings = ControllerSettings(rate=RATE, heartbeat_timeout=HEARTBEAT_TIMEOUT)
        write_objects(drive, [
            *object_writes(profile, carriage.limited(here, self.window), settings),
            *pdo_writes(node_id, RATE, tuple(carriage.pdos))])
        self._bus.command(NmtCommand.START, node_id)
        for cob_id in (emergency_cob_id(node_id), heartbeat_cob_id(node_id)):
            self._bus.latest.pop(cob_id, None)  # its boot-up was ours

    def _run_until(self, phase: Phase) -> None:
        if not self._cycle_for(_READY_TIME, phase):
            names = ', '.join(carriage.name for carriage in self._carriages)
            raise CommissioningError(f'{names} did not reach: {phase.value}')

    def require(self, index: int, purpose: str) -> None:
        """Raise a CommissioningError if a drive does not send an object with every SYNC."""
        for carriage in self._carriages:
            if not any(index in one.indices for one in carriage.tpdos.values()):
                raise CommissioningError(
                    f'{carriage.name}: no TPDO of its profile carries {index:04X}h, {purpose}: '
                    'add it to pdos, or measure by hand')

    def step(self, displacement: float) -> AxisSample:
        """
        Command where each carriage shall be after the next cycle, from its start [m].

        Returns what the drive that is looked at sent at this cycle's SYNC. Raises a
        CommissioningError if that is outside the window or too far away, or a drive stopped: all
        are stopped; a BusError if the bus is gone: the drives stop by themselves.
        """
        change, most = displacement - self._displacement, 1.5 * MAX_SPEED * PERIOD
        name = self._carriages[self._number].name
        if not math.isfinite(displacement) or abs(displacement) > self.window:
            self._fail(f'{name} = {1e3 * displacement:.1f} mm from its start is outside the '
                       f'window of {1e3 * self.window:.0f} mm')
        if abs(change) > most:
            self._fail(f'{name}: a step of {1e3 * change:.2f} mm in a cycle is above '
                       f'{1e3 * most:.2f} mm')
        self._displacement = displacement
        return self._cycle()

    def _fail(self, message: str) -> None:
        self._group.stop(Cause(message), time.monotonic())
        raise CommissioningError(f'{message}: all carriages are stopped')

    def _cycle(self) -> AxisSample:
        self._wait_for_tick()
        self._exchange_sync()
        is_following = self._group.phase in FOLLOWING_PHASES
        samples = [one.receive(self._bus.latest, is_following) for one in self._carriages]
        for carriage in self._carriages:
            self._look_for_faults(carriage)
        commands = self._group.step(
            tuple(one.feedback for one in self._carriages), time.monotonic())
        self._bus.send(heartbeat_cob_id(MASTER_NODE_ID), bytes([NmtState.OPERATIONAL]))
        for carriage, command in zip(self._carriages, commands, strict=True):
            for cob_id, data in carriage.encode(command, self._displacement):
                self._bus.send(cob_id, data)
        if self._group.cause is not None and not self._is_stopping:
            raise CommissioningError(f'{self._group.cause}; the carriages are stopped')
        return samples[self._number]

    def _wait_for_tick(self) -> None:
        self._tick += PERIOD
        late = time.monotonic() - self._tick
        if late > 2 * PERIOD:
            self._tick += late
        time.sleep(max(0.0, -late))

    def _exchange_sync(self) -> None:
        """Send SYNC and wait for all TPDOs; stop where a drive sends nothing for some cycles."""
        latest = self._bus.latest
        wanted = [cob_id for carriage in self._carriages for cob_id in carriage.tpdos]
        for cob_id in wanted:
            latest.pop(cob_id, None)
        self._bus.send(SYNC_COB_ID)
        complete = self._bus.wait_for(lambda: all(c in latest for c in wanted), _ANSWER_TIME)
        self._missed = 0 if complete else self._missed + 1
        if self._missed >= _MISSED:
            missing = [one.name for one in self._carriages
                       if not any(cob_id in latest for cob_id in one.tpdos)]
            self._group.stop(Cause(
                f'{" and ".join(missing) or "a drive"} sent nothing for {_MISSED} cycles: check '
                'its power and cable'), time.monotonic())

    def _look_for_faults(self, carriage: _Carriage) -> None:
        name, node_id = carriage.name, carriage.axis.node_id
        emergency = self._bus.latest.get(emergency_cob_id(node_id))
        beat = self._bus.latest.get(heartbeat_cob_id(node_id))
        if emergency is not None and (code := decode_emergency(emergency.data).code):
            self._group.stop(Cause(f'{name}: {describe(code)}', axis=name), time.monotonic())
        if beat is not None and beat.data == bytes([NmtState.INITIALISING]) and (
                self._group.phase is not Phase.OFF):
            self._group.stop(Cause(f'{name} has restarted: check its supply'), time.monotonic())

    def _stop(self) -> None:
        """Quick-stop, then take the power; a bus that is gone leaves that to the drives."""
        self._is_stopping = True
        try:
            if self._group.phase is not Phase.OFF:
                self._group.stop(Cause('stopped'), time.monotonic())
                self._cycle_for(0.3, Phase.STOPPED)
            self._group.cut_power(time.monotonic())
            self._cycle_for(0.3, Phase.STOPPED)
            for carriage in self._carriages:
                self._bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, carriage.axis.node_id)
        except BusError:
            return

    def _cycle_for(self, longest: float, phase: Phase) -> bool:
        """Go on until a phase is reached, for a time at most [s]; return whether it is."""
        end = time.monotonic() + longest
        while not (is_reached := self._group.phase is phase and self._group.is_settled) and (
                time.monotonic() < end):
            self._cycle()
        return is_reached


class Ramp:
    """A displacement whose speed goes to a goal with a bounded acceleration, within a window."""

    def __init__(self, window: float) -> None:
        self._window = window
        self.displacement = 0.0
        self.speed = 0.0

    def step(self, goal: float) -> float:
        """Return the displacement [m] after one cycle towards a speed [m/s]."""
        slack = ACCELERATION * PERIOD
        room = max(0.0, self._window - math.copysign(1.0, goal) * self.displacement)
        fastest = math.sqrt(2.0 * ACCELERATION * max(0.0, room - abs(self.speed) * PERIOD))
        goal = math.copysign(min(abs(goal), fastest), goal)
        self.speed += min(max(goal - self.speed, -slack), slack)
        self.displacement += self.speed * PERIOD
        self.displacement = min(max(self.displacement, -self._window), self._window)
        return self.displacement


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Let a closed terminal and a kill end what is inside as Ctrl-C does: with a stop."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt)
              for number in (signal.SIGHUP, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
