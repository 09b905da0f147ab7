"""
Carriages under power, slowly, within a window around where they stood.

The driver's own controller does it, with its configuration, supervision and stops. Homing method
37 or 35 makes the present positions zero, so that no switch is needed. The controller runs in this
thread: a process that hangs, is stopped or killed falls silent, and the drives quick-stop.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
import math
import signal
from threading import current_thread, main_thread

from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, Triple
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.homing import METHODS_AT_PRESENT_POSITION
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.session import BusAccess, Session
from facade_manipulator.drives.snapshot import ControllerSnapshot
from facade_manipulator.drives.targets import MechanismChecks, ROUNDING
from facade_manipulator.errors import CommissioningError, ManipulatorError
from facade_manipulator.tools.commissioning.context import Context

MAX_SPEED = 0.05  # m/s, except in a stop test
MAX_WINDOW = 0.2  # m
ACCELERATION = 1.0  # m/s²
_FOLLOWING_ERROR, _FOLLOWING_TIME = 0.003, 0.04  # m, and s of the speed: a blocked carriage stops
_MISSED_CYCLES = 10  # this process has no real-time priority: 0.1 s late stops nothing
_MM = 1e3


class _Ramp:
    """
    The targets: the same displacement of the moved axes from their start [m].

    Its speed approaches the goal [m/s] with `ACCELERATION`, and to 0 at the window.
    """

    def __init__(self, moved: tuple[bool, ...], window: float, period: float) -> None:
        self.displacement = self.speed = self.goal = 0.0
        self._moved, self._window, self._period = moved, window, period

    @property
    def at_rest(self) -> bool:
        """Return whether the targets stand still."""
        return self.speed == 0.0

    def reset(self, positions: Triple) -> None:
        """Begin at positions [m]."""
        self._start, self.displacement, self.speed = positions, 0.0, 0.0

    def hold(self) -> None:
        """Come to rest."""
        self.goal = 0.0

    def wait(self, seconds: float) -> None:
        """Go on from the last target."""

    def sample(self, latch_time: float) -> Triple:
        """Return the positions one cycle later [m]."""
        slack = ACCELERATION * self._period
        room = self._window - math.copysign(1.0, self.goal) * self.displacement
        fastest = math.sqrt(
            2.0 * ACCELERATION * max(0.0, room - abs(self.speed) * self._period))
        goal = math.copysign(min(abs(self.goal), fastest), self.goal)
        self.speed += min(max(goal - self.speed, -slack), slack)
        target = self.displacement + self.speed * self._period
        self.displacement = min(max(target, -self._window), self._window)
        q1, q2, q3 = (start + is_moved * self.displacement
                      for start, is_moved in zip(self._start, self._moved, strict=True))
        return q1, q2, q3


class Motion:
    """The carriages under power; each `turn` is a cycle of the driver's controller."""

    def __init__(
        self, context: Context, moved: tuple[bool, ...], window: float, speed: float
    ) -> None:
        settings = replace(context.settings('controller', ControllerSettings),
                           max_missed_cycles=_MISSED_CYCLES)
        self.period, self.window = settings.period, window
        self.targets = _Ramp(moved, window, settings.period)
        self.session = Session(
            settings, tuple(_narrowed(name, axis, window, speed)
                            for name, axis in context.axes.items()),
            BusAccess(context.open), MechanismChecks(self.targets), context.clock)
        self.controller = DriveController(self.session)
        self.is_stopping = False  #: whether a stop is part of the test

    def request(self, *names: str) -> str:
        """Let the controller do something; return its message, or raise its error."""
        for name in names:
            reply = self.controller.request(name)
            while not reply.done():
                self.controller.turn()
            try:
                message = reply.result()
            except ManipulatorError as error:  # its next step names requests to a driver
                raise CommissioningError(str(error).partition('; next: ')[0]) from error
        return message

    def turn(self) -> ControllerSnapshot:
        """Run a cycle; raises a CommissioningError with the cause of a stop."""
        self.controller.turn()
        snapshot = self.controller.snapshot()
        if snapshot.causes and not self.is_stopping:
            cause = snapshot.causes[0]
            raise CommissioningError(f'{cause.message}; the carriages are stopped; next: '
                                     f'{cause.remedy or "commission scan"}')
        return snapshot

    def go(self, speed: float) -> Iterator[ControllerSnapshot]:
        """Move at a speed [m/s] and yield each cycle, as far as the window."""
        self.targets.goal, direction = speed, math.copysign(1.0, speed)
        while direction * self.targets.displacement < self.window - ROUNDING:
            yield self.turn()

    def rest(self, seconds: float = 0.3) -> ControllerSnapshot:
        """Come to rest, and stay for a time [s]."""
        self.targets.hold()
        while not self.targets.at_rest:
            self.turn()
        return [self.turn() for _ in range(round(seconds / self.period))][-1]

    def close(self) -> None:
        """Come to rest, take the power, and print whether the drives have confirmed that."""
        try:
            print(self.request('close').partition('; next: ')[0])
        except ManipulatorError as error:
            print(f'! {error}')


def _narrowed(name: str, axis: AxisSettings, window: float, speed: float) -> AxisSettings:
    """Return an axis whose drive keeps a window [m] around where it stands and a speed [m/s]."""
    methods = METHODS_AT_PRESENT_POSITION & {*load_profile(axis.profile).homing_methods}
    if not methods:
        raise CommissioningError(
            f'{name} rejected: profile {axis.profile} has no homing method at the present '
            'position; next: add 37 or 35 to its homing_methods')
    return replace(
        axis, homing_method=max(methods), home_position=0.0, lower_limit=-window,
        upper_limit=window, homing_strokes=100.0, max_speed=2.0 * speed,
        max_acceleration=max(axis.max_acceleration, ACCELERATION), following_error_window=min(
            axis.following_error_window, _FOLLOWING_ERROR + _FOLLOWING_TIME * speed))


@contextmanager
def powered(
    context: Context, name: str, action: str, window: float, speed: float
) -> Iterator[Motion]:
    """Ask, then lend the carriages under power; one moves, or by default all three alike."""
    alone = context.options.alone
    unknown = [axis for axis in AXIS_NAMES
               if f'direction {axis}' not in context.overlay.steps()]
    if unknown:
        raise CommissioningError(f'motion rejected: the direction of {unknown[0]} is not known; '
                                 f'next: commission direction {unknown[0]}')
    context.agree(
        f'The three drives are reset and powered. {name if alone else "All carriages"} '
        f'{"moves" if alone else "move"} {action}, at most {_MM * speed:g} mm/s and '
        f'{_MM * window:.0f} mm from where they stand. Keep clear, with the emergency stop in '
        'your hand.')
    moved = tuple(not alone or axis == name for axis in AXIS_NAMES)
    motion = Motion(context, moved, window, speed)
    # a closed terminal and a kill stop the carriages as Ctrl-C does
    numbers = (signal.SIGHUP, signal.SIGTERM) if current_thread() is main_thread() else ()
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        motion.request('configure', 'home', 'activate')
        yield motion
    finally:
        motion.close()
        for number, handler in before.items():
            signal.signal(number, handler)
