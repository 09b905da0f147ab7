"""
A few carriages under power, slowly, within a window around where they stood; no homing needed.

Whoever moves calls `Motion.step` for each cycle of the driver's own exchange. Heartbeats come from
that loop alone, so that a process that hangs, is stopped or killed falls silent, and the drives
quick-stop by themselves (1016h, 6007h) within `HEARTBEAT_TIMEOUT`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields, replace
from enum import Enum
import math
import signal
import threading
import time
from typing import NamedTuple

from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.configuration import write_drive
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.cycle import CycleClock
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import AxisCommand, Group
from facade_manipulator.drives.monitor import AxisMonitor, require_dead_master_stop
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.drives.states import Controlword, State
from facade_manipulator.errors import BusError, CommissioningError
from facade_manipulator.parameters import settings
from facade_manipulator.tools.commissioning.bus import ToolBus
from facade_manipulator.tools.commissioning.scan import only_drive

HEARTBEAT_TIMEOUT = 0.1  # s, after which the drives stop by themselves
_MISSED = 5  # cycles, which last 0.15 s at most: named before the heartbeat is missed here
SETTINGS = ControllerSettings(  # a loop that is late for less than 0.1 s stops nothing
    rate=100, heartbeat_timeout=0.2, heartbeat_period=0.01, max_missed_cycles=10, hold_cycles=5)
_OF_DRIVES = replace(SETTINGS, heartbeat_timeout=HEARTBEAT_TIMEOUT, heartbeat_period=0.05)
PERIOD = SETTINGS.period
MAX_SPEED = 0.05  # m/s, of anything that this tool moves
ACCELERATION = 1.0  # m/s²
MAX_WINDOW = 0.2  # m
_MARGIN = 0.002  # m, between the window and the drive's own limits
_FOLLOWING_ERROR = 0.003  # m
_READY_TIME = 8.0  # s
SILENCE = 1.0  # s, in which a silent master sends nothing: any drive must stand by then
_STANDING = 10  # cycles, over which
_STANDSTILL = 5e-5  # m at most are gone: 0.5 mm/s
POSITION, TORQUE, INPUTS = 0x6064, 0x6077, 0x60FD


class StopWay(Enum):
    """What stops carriages that move."""

    QUICK_STOP = 'quick stop'
    SILENCE = 'silent master'
    POWER_OFF = 'power off'  # voltage disabled by the controlword: as STO, it coasts


class AxisSample(NamedTuple):
    """An axis at a SYNC: position since power-on [m], velocity [m/s], motor's force [N], 60FDh."""

    position: float
    velocity: float
    force: float
    inputs: int


class StopRecord(NamedTuple):
    """Where carriages were at each SYNC until they stood [m], their states at the first."""

    positions: list[tuple[float, ...]]
    states: tuple[State | None, ...]


@settings
class _Unhomed(AxisSettings):
    """An axis in what its encoder counts: one of many turns may come with any position."""

    home_position: float = 0.0  # m; no parameter here, so without its range


class _Carriage(AxisMonitor):
    """An axis of a motion: the drive and its type, called by the axis's name alone."""

    def __init__(self, name: str, axis: AxisSettings) -> None:
        profile = load_profile(axis.profile)
        # all with every SYNC: switches and torque are measured
        super().__init__(name, profile.applied(axis), SETTINGS, replace(
            profile, pdos=tuple(replace(one, transmission=1) for one in profile.pdos)))
        self.start = 0  # counts where it stood

    @property
    def title(self) -> str:
        return self.name

    def sample(self) -> AxisSample:
        """Return what it sent at the newest SYNC."""
        moved = self.axis.to_metres((self.encoder.counts or 0) - self.start)
        now = self.snapshot(None, self.heartbeat_time or 0.0)
        return AxisSample(
            moved, now.velocity or 0.0, now.force or 0.0, now.digital_inputs or 0)

    def limited(self, here: float, window: float, speed: float) -> AxisSettings:
        """Return its settings with limits around where it is [m] and twice the speed [m/s]."""
        axis = self.axis
        return _Unhomed(**{one.name: getattr(axis, one.name) for one in fields(axis)} | {
            'home_position': here, 'lower_limit': here - window, 'upper_limit': here + window,
            'limit_margin': _MARGIN, 'max_speed': 2.0 * speed,
            'max_acceleration': max(axis.max_acceleration, ACCELERATION),
            'following_error_window': min(axis.following_error_window, _FOLLOWING_ERROR)})


class _Displacement:
    """The targets of a motion: all carriages as far [m] from where they stood."""

    at_rest = True

    def __init__(self, carriages: tuple[_Carriage, ...]) -> None:
        self.value = 0.0
        self.counts: tuple[int, ...] = (0,) * len(carriages)
        self.is_without_power = False
        self._carriages = carriages

    def supervise(self, group: Group, monitors: tuple[AxisMonitor, ...], now: float) -> None:
        """Stop where a drive sends nothing for some cycles."""
        silent = [one.name for one in monitors if one.answers.missed_in_a_row >= _MISSED]
        if silent:
            group.stop(Cause(f'{" and ".join(silent)} sent nothing for {_MISSED} cycles',
                             Remedy.CONFIGURE), now)

    def command(
        self, group: Group, commands: tuple[AxisCommand, ...], actual: tuple[int, ...],
        clock: CycleClock, now: float,
    ) -> tuple[AxisCommand, ...]:
        """Choose the targets of a cycle; return the commands to send along with them."""
        if not group.state.is_following and not self.value:  # not once they have moved
            for one, counts in zip(self._carriages, actual, strict=True):
                one.start = counts
        self.counts = tuple(
            one.start + one.axis.to_counts(self.value) for one in self._carriages)
        if self.is_without_power:
            return tuple(one._replace(controlword=Controlword.DISABLE_VOLTAGE) for one in commands)
        return commands


class Motion:
    """
    Carriages in cyclic synchronous position, powered while the context lasts, moved all alike.

    Nobody else receives from the bus once this is entered. The drives of `axes` are reset,
    written to and powered, no others; the answers of the one with `name` are returned. None
    goes farther from its start than the window [m]; `speed` is the fastest of what is to come
    [m/s]. The settings of this machine say whether the dead-master stop is given up.
    """

    def __init__(
        self, bus: ToolBus, axes: dict[str, AxisSettings], name: str, window: float,
        speed: float = MAX_SPEED, settings: ControllerSettings = SETTINGS,
    ) -> None:
        self._bus = bus
        self._speed = speed
        self._settings = settings
        self.window = min(window, MAX_WINDOW)
        self._carriages = tuple(_Carriage(*item) for item in axes.items())
        self._watched = self._carriages[list(axes).index(name)]
        self._group = Group(tuple(axes), SETTINGS, time.monotonic())
        self._targets = _Displacement(self._carriages)
        self._exchange: CyclicExchange | None = None
        self._is_stopping = False
        self.ramp = Ramp(self.window)

    def __enter__(self) -> Motion:
        try:
            for carriage in self._carriages:
                self._configure(carriage)
            require_dead_master_stop('moving', self._carriages, self._settings)
            self._exchange = CyclicExchange(
                self._bus.hand_over(), self._carriages, SETTINGS, self._targets)
            self._exchange.transmits = True
            self._exchange.start(self._group, time.monotonic())
            self._run_until(ControllerState.INACTIVE)
            self._group.enable(time.monotonic())
            self._run_until(ControllerState.ACTIVE)
        except BaseException:
            self._stop()
            raise
        return self

    def __exit__(self, kind: type | None, *details: object) -> None:
        if kind is None and self._group.state is ControllerState.ACTIVE:
            with suppress(BusError, CommissioningError):
                self._group.disable(time.monotonic())
                self._run_until(ControllerState.INACTIVE)
        self._stop()

    def _configure(self, carriage: _Carriage) -> None:
        """Reset a drive, so that it is without fault, and give it limits around where it is."""
        node_id, profile = carriage.axis.node_id, carriage.profile
        drive = only_drive(self._bus, carriage.axis, carriage.name, eds=profile.eds)
        self._bus.reset(node_id)
        self._bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, node_id)
        here = carriage.axis.to_metres(drive.read_number(POSITION, signed=True))
        limited = carriage.limited(here, self.window, self._speed)
        _, carriage.stops_without_master = write_drive(
            drive, profile, limited, _OF_DRIVES)
        self._bus.start(node_id)

    def _run_until(self, state: ControllerState) -> None:
        if not self._cycle_for(_READY_TIME, state):
            names = ', '.join(carriage.name for carriage in self._carriages)
            raise CommissioningError(f'{names} did not reach: {state.value}')

    @property
    def power(self) -> str:
        """Power of the carriages' drives in words, as their newest statuswords have it."""
        now = time.monotonic()
        return ControllerSnapshot(ControllerState.STOPPED, None, tuple(
            one.snapshot(None, now) for one in self._carriages)).power

    @property
    def warnings(self) -> list[str]:
        """What the drives warn of, which stops nothing."""
        return [f'{one.title}: {one.warning}' for one in self._carriages if one.warning]

    def require(self, index: int, purpose: str) -> None:
        """Raise a CommissioningError if a drive does not send an object with every SYNC."""
        for carriage in self._carriages:
            if not any(index in one.indices for one in carriage.tpdos):
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
        change, most = displacement - self._targets.value, 1.5 * self._speed * PERIOD
        name = self._watched.name
        if not math.isfinite(displacement) or abs(displacement) > self.window:
            self._fail(f'{name} = {1e3 * displacement:.1f} mm from its start is outside the '
                       f'window of {1e3 * self.window:.0f} mm')
        if abs(change) > most:
            self._fail(f'{name}: a step of {1e3 * change:.2f} mm in a cycle is above '
                       f'{1e3 * most:.2f} mm')
        self._targets.value = displacement
        self._cycle()
        return self._watched.sample()

    def go(self, speed: float) -> AxisSample:
        """Go on for a cycle towards a speed [m/s], inside the window of the ramp, as `step`."""
        return self.step(self.ramp.step(speed))

    def rest(self, cycles: int = 5) -> AxisSample:
        """Come to rest and stay so for some cycles."""
        while self.ramp.speed:
            self.go(0.0)
        return [self.go(0.0) for _ in range(cycles)][-1]

    @property
    def positions(self) -> tuple[float, ...]:
        """Where each carriage was at the newest SYNC, from its start [m]."""
        return tuple(carriage.sample().position for carriage in self._carriages)

    def stop_by(self, way: StopWay, longest: float) -> StopRecord:
        """
        Stop all carriages, while they move, and return what they did until they stand.

        Nothing can follow but the end of the motion. Raises a CommissioningError if one still
        moves after `longest` [s].
        """
        self._is_stopping, start = True, time.monotonic()
        if way is StopWay.QUICK_STOP:
            self._group.stop(Cause('stop test'), start)
        elif way is StopWay.POWER_OFF:
            self._targets.is_without_power = True
        else:
            time.sleep(SILENCE)
        self._cycle()  # what they send at its SYNC is from before anything that it commands
        now = time.monotonic()
        states = tuple(one.snapshot(None, now).state for one in self._carriages)
        track = [self.positions]
        while len(track) <= _STANDING or any(
                abs(last - first) > _STANDSTILL
                for last, first in zip(track[-1], track[-1 - _STANDING], strict=True)):
            if time.monotonic() > start + longest:
                raise CommissioningError(
                    f'{way.value}: after {longest:g} s not all stand; use the emergency stop')
            self._cycle()
            track.append(self.positions)
        return StopRecord(track, states)

    def _fail(self, message: str) -> None:
        self._group.stop(Cause(message), time.monotonic())
        raise CommissioningError(f'{message}: all carriages are stopped')

    def _cycle(self) -> None:
        if self._exchange is None:
            raise CommissioningError('the carriages are not powered')
        self._exchange.turn()
        cause = self._group.cause
        if cause is not None and not self._is_stopping:
            next_step = f'; next: {cause.remedy}' if cause.remedy else ''
            raise CommissioningError(f'{cause.message}{next_step}; the carriages are stopped')

    def _stop(self) -> None:
        """Quick-stop, then take the power; a bus that is gone leaves that to the drives."""
        self._is_stopping = True
        try:
            if self._exchange is not None:
                self._group.cut_power(time.monotonic())
                self._cycle_for(0.6, ControllerState.STOPPED)
                self._exchange.stop()
            for carriage in self._carriages:
                self._bus.command(NmtCommand.ENTER_PRE_OPERATIONAL, carriage.axis.node_id)
        except BusError:
            return

    def _cycle_for(self, longest: float, state: ControllerState) -> bool:
        """Go on until a state is reached, for a time at most [s]; return whether it is."""
        end = time.monotonic() + longest
        while not (is_reached := self._group.state is state and self._group.is_settled) and (
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

    before = {number: signal.signal(number, signal.default_int_handler)
              for number in (signal.SIGHUP, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
