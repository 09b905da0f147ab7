"""
A few carriages under power, slowly, within a window around where they stood; no homing needed.

Whoever moves calls `Motion.step` for each cycle: SYNC, the drives' answers, then heartbeat and
targets. Heartbeats come from that loop alone, so that a process that hangs, is stopped or killed
falls silent, and the drives quick-stop by themselves (1016h, 6007h) within `HEARTBEAT_TIMEOUT`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
import math
import signal
import threading
import time
from typing import NamedTuple

from facade_manipulator.commissioning.bus import ToolBus
from facade_manipulator.commissioning.scan import require_one
from facade_manipulator.drives.canopen import (
    decode_emergency,
    describe,
    emergency_cob_id,
    heartbeat_cob_id,
    MASTER_NODE_ID,
    NmtCommand,
    NmtState,
    Pdo,
    SYNC_COB_ID,
)
from facade_manipulator.drives.cia402 import (
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
_STOPPING_TIME = 1.0  # s
CONTROLWORD, STATUSWORD, ERROR_CODE, MODE, DISPLAYED_MODE = 0x6040, 0x6041, 0x603F, 0x6060, 0x6061
TARGET, POSITION, VELOCITY, TORQUE, INPUTS = 0x607A, 0x6064, 0x606C, 0x6077, 0x60FD


class AxisSample(NamedTuple):
    """
    An axis at a SYNC.

    Attributes
    ----------
    position : float
        Since power-on, along the rail [m].
    velocity : float
        In m/s.
    force : float
        Of the motor on the carriage [N].
    inputs : int
        60FDh.

    """

    position: float
    velocity: float
    force: float
    inputs: int


class Motion:
    """
    Carriages in cyclic synchronous position, powered while the context lasts.

    Parameters
    ----------
    bus : ToolBus
    axes : dict
        Settings by name; these drives are reset, written to and powered, the others not.
    window : float
        How far a carriage may go from its start [m].

    """

    def __init__(self, bus: ToolBus, axes: dict[str, AxisSettings], window: float) -> None:
        self._bus = bus
        self.window = min(window, MAX_WINDOW)
        self.names = tuple(axes)
        profiles = {name: load_profile(axis.profile) for name, axis in axes.items()}
        self._profiles = profiles
        # all with every SYNC: switches and torque are measured
        self._pdos = [tuple(replace(one, transmission=1) for one in profile.pdos)
                      for profile in profiles.values()]
        self._values: list[dict[int, int]] = [{} for _ in axes]
        self._axes = [replace(axis, velocity_unit=profiles[name].velocity_unit)
                      for name, axis in axes.items()]
        self._settings = ControllerSettings(rate=RATE, heartbeat_timeout=HEARTBEAT_TIMEOUT)
        self._group = Group(self.names, GroupSettings(hold_cycles=5), time.monotonic())
        self._bases = [0] * len(axes)  # counts where each stood
        self._counts = [0] * len(axes)
        self._displacements = [0.0] * len(axes)
        self._feedback = [Feedback(0x40)] * len(axes)
        self._commands = self._group.commands
        self._missed = 0
        self._tick = 0.0
        self._is_stopping = False

    def __enter__(self) -> Motion:
        try:
            for number, name in enumerate(self.names):
                self._configure(name, self._axes[number], self._pdos[number])
            self._power_on()
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

    def _configure(self, name: str, axis: AxisSettings, pdos: tuple[Pdo, ...]) -> None:
        """Reset a drive, so that it is without fault, and give it limits around where it is."""
        require_one(self._bus, axis.node_id, name)
        self._bus.reset(axis.node_id)
        self._bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, axis.node_id)
        drive = self._bus.objects(axis.node_id, name, eds=self._profiles[name].eds)
        here = axis.to_metres(int.from_bytes(drive.read(0x6064, 0), 'little', signed=True))
        limited = replace(
            axis, home_position=here, lower_limit=here - self.window,
            upper_limit=here + self.window, limit_margin=_MARGIN, max_speed=2.0 * MAX_SPEED,
            max_acceleration=max(axis.max_acceleration, ACCELERATION),
            following_error_window=min(axis.following_error_window, _FOLLOWING_ERROR))
        write_objects(drive, [*object_writes(self._profiles[name], limited, self._settings),
                              *pdo_writes(axis.node_id, RATE, pdos)])
        self._bus.command(NmtCommand.START, axis.node_id)
        for cob_id in (emergency_cob_id(axis.node_id), heartbeat_cob_id(axis.node_id)):
            self._bus.latest.pop(cob_id, None)  # its boot-up was ours

    def _power_on(self) -> None:
        self._tick = time.monotonic()
        self._run_until(Phase.OFF)
        self._group.enable(time.monotonic())
        self._run_until(Phase.RUNNING)

    def _run_until(self, phase: Phase) -> None:
        end = time.monotonic() + 8 * _STOPPING_TIME
        while not (self._group.phase is phase and self._group.is_settled):
            if time.monotonic() > end:
                raise CommissioningError(f'{", ".join(self.names)} did not reach: {phase.value}')
            self._cycle()

    def step(self, displacements: Sequence[float]) -> list[AxisSample]:
        """
        Command where the carriages shall be after the next cycle, and wait for this one's answers.

        Parameters
        ----------
        displacements : sequence of float
            Of each carriage from its start [m].

        Returns
        -------
        list of AxisSample
            What the drives sent at this cycle's SYNC.

        Raises
        ------
        CommissioningError
            A target is outside the window or too far away, or a drive stopped: all are stopped.
        BusError
            The bus is gone: the drives stop by themselves.

        """
        for name, wanted, last in zip(self.names, displacements, self._displacements, strict=True):
            if not math.isfinite(wanted) or abs(wanted) > self.window:
                self._fail(f'{name} = {1e3 * wanted:.1f} mm from its start is outside the window '
                           f'of {1e3 * self.window:.0f} mm')
            if abs(wanted - last) > 1.5 * MAX_SPEED * PERIOD:
                self._fail(f'{name}: a step of {1e3 * (wanted - last):.2f} mm in a cycle is above '
                           f'{1.5e3 * MAX_SPEED * PERIOD:.2f} mm')
        self._displacements = list(displacements)
        return self._cycle()

    def _fail(self, message: str) -> None:
        self._group.stop(Cause(message), time.monotonic())
        raise CommissioningError(f'{message}: all carriages are stopped')

    def _cycle(self) -> list[AxisSample]:
        self._wait_for_tick()
        samples = self._exchange()
        self._commands = self._group.step(tuple(self._feedback), time.monotonic())
        self._send()
        if self._group.cause is not None and not self._is_stopping:
            raise CommissioningError(f'{self._group.cause}; the carriages are stopped')
        return samples

    def _wait_for_tick(self) -> None:
        self._tick += PERIOD
        late = time.monotonic() - self._tick
        if late > 2 * PERIOD:
            self._tick += late
        time.sleep(max(0.0, -late))

    def _exchange(self) -> list[AxisSample]:
        """Send SYNC and wait for all TPDOs; what does not come stays as it was."""
        latest = self._bus.latest
        wanted = [one.cob_id(axis.node_id) for axis, pdos in zip(
            self._axes, self._pdos, strict=True) for one in pdos if one.is_transmitted]
        for cob_id in wanted:
            latest.pop(cob_id, None)
        self._bus.send(SYNC_COB_ID)
        complete = self._bus.wait_for(lambda: all(c in latest for c in wanted), _ANSWER_TIME)
        self._missed = 0 if complete else self._missed + 1
        if self._missed >= _MISSED:
            missing = [name for name, axis, pdos in zip(
                self.names, self._axes, self._pdos, strict=True) if not any(
                    one.cob_id(axis.node_id) in latest for one in pdos if one.is_transmitted)]
            self._group.stop(Cause(
                f'{" and ".join(missing) or "a drive"} sent nothing for {_MISSED} cycles: check '
                'its power and cable'), time.monotonic())
        return [self._sample(number, axis) for number, axis in enumerate(self._axes)]

    def _sample(self, number: int, axis: AxisSettings) -> AxisSample:
        values, before = self._values[number], self._counts[number]
        for one in self._pdos[number]:
            frame = self._bus.latest.get(one.cob_id(axis.node_id)) if one.is_transmitted else None
            if frame is not None:
                values.update(zip(one.indices, one.unpack(frame.data), strict=True))
        if POSITION not in values:
            return AxisSample(0.0, 0.0, 0.0, 0)
        self._counts[number] = values[POSITION]
        speed = (axis.speed_to_metres(values[VELOCITY]) if VELOCITY in values else
                 axis.to_metres(values[POSITION] - before) / PERIOD)
        if self._group.phase not in FOLLOWING_PHASES:
            self._bases[number] = values[POSITION]
        self._feedback[number] = Feedback(
            values[STATUSWORD], values[DISPLAYED_MODE], abs(speed) < _REST_SPEED,
            values.get(ERROR_CODE, 0))
        self._look_for_faults(self.names[number], axis.node_id)
        return AxisSample(self._position(number), speed, axis.to_force(values.get(TORQUE, 0)),
                          values.get(INPUTS, 0))

    def require(self, index: int, purpose: str) -> None:
        """
        Check that the drives send an object with every SYNC.

        Raises
        ------
        CommissioningError
            A profile's process data do not carry it.

        """
        for name, pdos in zip(self.names, self._pdos, strict=True):
            if not any(one.is_transmitted and index in one.indices for one in pdos):
                raise CommissioningError(
                    f'{name}: no TPDO of its profile carries {index:04X}h, {purpose}: add it to '
                    'pdos, or measure by hand')

    def _look_for_faults(self, name: str, node_id: int) -> None:
        emergency = self._bus.latest.get(emergency_cob_id(node_id))
        beat = self._bus.latest.get(heartbeat_cob_id(node_id))
        if emergency is not None and (code := decode_emergency(emergency.data).code):
            self._group.stop(Cause(f'{name}: {describe(code)}', axis=name), time.monotonic())
        if beat is not None and beat.data == bytes([NmtState.INITIALISING]) and (
                self._group.phase is not Phase.OFF):
            self._group.stop(Cause(f'{name} has restarted: check its supply'), time.monotonic())

    def _position(self, number: int) -> float:
        return self._axes[number].to_metres(self._counts[number] - self._bases[number])

    def _send(self) -> None:
        self._bus.send(heartbeat_cob_id(MASTER_NODE_ID), bytes([NmtState.OPERATIONAL]))
        for number, (axis, command) in enumerate(zip(self._axes, self._commands, strict=True)):
            values = {
                CONTROLWORD: command.controlword, MODE: command.mode,
                TARGET: self._bases[number] + axis.to_counts(self._displacements[number])}
            for one in self._pdos[number]:
                if not one.is_transmitted:
                    self._bus.send(one.cob_id(axis.node_id), one.encode(values))

    def _stop(self) -> None:
        """Quick-stop, then take the power; a bus that is gone leaves that to the drives."""
        self._is_stopping = True
        try:
            if self._group.phase is not Phase.OFF:
                self._group.stop(Cause('stopped'), time.monotonic())
                self._cycle_for(0.3, Phase.STOPPED)
            self._group.cut_power(time.monotonic())
            self._cycle_for(0.3, Phase.STOPPED)
            for axis in self._axes:
                self._bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, axis.node_id)
        except BusError:
            return

    def _cycle_for(self, longest: float, phase: Phase) -> None:
        end = time.monotonic() + longest
        while time.monotonic() < end and not (
                self._group.phase is phase and self._group.is_settled):
            self._cycle()


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
