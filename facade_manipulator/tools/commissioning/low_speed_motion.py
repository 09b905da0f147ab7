"""
Slow motion of powered carriages, within a window around their initial positions.

The driver's controller moves the carriages, with its configuration, supervision and stops. Homing
method 37 or 35 sets the present positions to zero, so that no switch is needed. The controller
runs in this thread. A process that hangs, is stopped or killed sends nothing, and the drives
quick-stop.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
import math
import signal

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller import DriveController
from facade_manipulator.drives.guard import Unguarded
from facade_manipulator.drives.homing import METHODS_AT_PRESENT_POSITION
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import AxisSnapshot, CycleStatistics
from facade_manipulator.drives.targets import TARGET_ROUNDING
from facade_manipulator.errors import CommissioningError
from facade_manipulator.kinematics.geometry import AXIS_NAMES, PerCarriage
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.tools.commissioning.procedure import Context

RAMP_ACCELERATION = 1.0  # m/s²


class _Ramp:
    """
    Ramp of targets; all moved axes have the same displacement from their starting positions [m].

    The speed approaches the goal [m/s] with `RAMP_ACCELERATION`, and 0 at the window's limits.
    """

    def __init__(self, moved: tuple[bool, ...], window: float, period: float) -> None:
        self.displacement = 0.0
        self.speed = 0.0
        self.goal = 0.0
        self._before = self.displacement, self.speed
        self._moved = moved
        self._window = window
        self._period = period

    @property
    def at_rest(self) -> bool:
        """Return whether the targets have come to rest."""
        return self.speed == 0.0

    def reset(self, positions: PerCarriage) -> None:
        """Start at the given positions [m]."""
        self._start = positions
        self.displacement = 0.0
        self.speed = 0.0
        self._before = self.displacement, self.speed

    def hold(self) -> None:
        """Bring the targets to rest."""
        self.goal = 0.0

    def wait(self, seconds: float) -> None:
        """Continue from the last target; the elapsed time [s] has no effect."""

    def withdraw(self) -> None:
        """Undo the last `sample`, because its positions were not sent."""
        self.displacement, self.speed = self._before

    def sample(self, reach_time: float) -> PerCarriage:
        """Return the positions one cycle later [m]."""
        self._before = self.displacement, self.speed
        slack = RAMP_ACCELERATION * self._period
        direction = math.copysign(1.0, self.goal)
        room = (
            self._window
            - direction * self.displacement
            - abs(self.speed) * self._period
        )
        fastest = math.sqrt(2.0 * RAMP_ACCELERATION * max(0.0, room))
        change = direction * min(abs(self.goal), fastest) - self.speed
        self.speed += min(max(change, -slack), slack)
        target = self.displacement + self.speed * self._period
        self.displacement = min(max(target, -self._window), self._window)
        q1, q2, q3 = (
            start + is_moved * self.displacement
            for start, is_moved in zip(self._start, self._moved, strict=True)
        )
        return q1, q2, q3


class Motion:
    """Motion of powered carriages; each `turn` is one cycle of the drive controller."""

    # Hz, rate of the cycles: maximum rate of the snapshots of the controller
    _MOST_RATE = 100
    # this process has no real-time priority, so ignore delays of 0.1 s
    _MISSED_CYCLES = 10

    def __init__(
        self, context: Context, moved: list[str], window: float, speed: float
    ) -> None:
        settings = replace(
            context.controller,
            max_missed_cycles=self._MISSED_CYCLES,
            rate=min(context.controller.rate, self._MOST_RATE),
        )
        self.period = settings.period
        self.window = window
        self.targets = _Ramp(
            tuple(name in moved for name in AXIS_NAMES), window, self.period
        )
        self.controller = DriveController(
            settings,
            tuple(_narrowed(axis, window, speed) for axis in context.axes.values()),
            context.open,
            self.targets,
            Unguarded(),  # a link may not be joined
            context.clock,
        )
        self.is_stopping = False  #: whether a stop is part of the test

    @property
    def sync_time(self) -> float:
        """Return the time [s] of the SYNC that belongs to the positions from `turn`."""
        exchange = self.controller.bus.exchange
        assert exchange is not None  # the bus is open with power on
        return exchange.clock.sync_time

    @property
    def cycles(self) -> CycleStatistics:
        """Return the counters of the cycles since `configure`."""
        exchange = self.controller.bus.exchange
        assert exchange is not None  # the bus is open with power on
        return exchange.clock.statistics

    def request(self, *names: str) -> str:
        """Send a request to the controller; return its message, or raise its error."""
        for name in names:
            replies: list[object] = []
            self.controller.request(name, replies.append)
            while not replies:
                self.controller.turn()
            message = str(replies[0]).partition('; next: ')[0]  # of the driver's user
            if isinstance(replies[0], Exception):
                raise CommissioningError(
                    f'{message}; next: remove the cause, and repeat'
                ) from replies[0]
        return message

    def turn(self) -> dict[str, AxisSnapshot]:
        """Run one cycle and return the axes; raise a CommissioningError with a stop's cause."""
        self.controller.turn()
        snapshot = self.controller.snapshot()
        if snapshot.causes and not self.is_stopping:
            cause = snapshot.causes[0]
            raise CommissioningError(
                f'{cause.message}; the carriages are stopped; next: '
                f'{cause.remedy or "commission scan"}'
            )
        return {axis.name: axis for axis in snapshot.axes}

    def go(self, speed: float) -> Iterator[dict[str, AxisSnapshot]]:
        """Move at a speed [m/s] to the end of the window; yield the axes after each cycle."""
        self.targets.goal = speed
        direction = math.copysign(1.0, speed)
        while direction * self.targets.displacement < self.window - TARGET_ROUNDING:
            yield self.turn()

    def rest(self, seconds: float = 0.3) -> dict[str, AxisSnapshot]:
        """Bring the carriages to rest and hold them for a time [s]."""
        self.targets.hold()
        while not self.targets.at_rest:
            self.turn()
        return [self.turn() for _ in range(round(seconds / self.period))][-1]


# a blocked carriage stops
_FOLLOWING_ERROR = 0.003  # m
_FOLLOWING_TIME = 0.04  # s, of the speed


def _narrowed(axis: AxisSettings, window: float, speed: float) -> AxisSettings:
    """Limit an axis to a window [m] around its position and to a speed [m/s]; return it."""
    methods = METHODS_AT_PRESENT_POSITION & {*load_profile(axis.profile).homing_methods}
    if not methods:
        raise CommissioningError(
            f'profile {axis.profile} rejected: its drive cannot home in place; '
            'next: add 37 or 35 to its homing_methods'
        )
    return replace(
        axis,
        homing_method=max(methods),
        home_position=0.0,
        lower_limit=-window,
        upper_limit=window,
        homing_strokes=100.0,
        max_speed=2.0 * speed,
        max_acceleration=max(axis.max_acceleration, RAMP_ACCELERATION),
        following_error_window=min(
            axis.following_error_window, _FOLLOWING_ERROR + _FOLLOWING_TIME * speed
        ),
    )


@contextmanager
def powered(
    context: Context, step: str, action: str, window: float, speed: float
) -> Iterator[Motion]:
    """
    Ask the operator, then yield the powered carriages; all three move equally, or only one.

    From the answer on, the step is not complete until it succeeds.

    The carriages always come to rest and are switched off when the block ends.
    """
    for name in AXIS_NAMES:
        if f'direction {name}' not in context.overlay.steps():
            raise CommissioningError(
                f'motion rejected: the direction of {name} is unknown; '
                f'next: commission direction {name}'
            )
    moved = [context.options.axis] if context.options.alone else [*AXIS_NAMES]
    context.agree(
        f'The three drives are reset and powered, and {", ".join(moved)} moved {action}, at most '
        f'{MM * speed:g} mm/s and {MM * window:.0f} mm from their present positions. Keep '
        'clear, with the emergency stop in your hand.'
    )
    context.begin(step)
    motion = Motion(context, moved, window, speed)
    # a closed terminal stops the carriages like Ctrl-C
    for number in (signal.SIGHUP, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        motion.request('configure', 'home', 'activate')
        yield motion
    finally:
        try:
            print(motion.request('close'))
        except CommissioningError as error:
            print(f'! {error}')
