"""
The mechanism that the drives move: the choice of its targets, and the check that it follows them.

Targets are the positions of the carriages at power-on, then the stream. They are checked a last
time before the bus: a target that is not finite, leaves the stroke or jumps is rejected with a
message, never clamped.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Protocol

from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, Triple
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.cycle import CycleClock
from facade_manipulator.drives.group import AxisCommand, Group
from facade_manipulator.drives.monitor import AxisMonitor, positions_of
from facade_manipulator.drives.snapshot import Cause, ControllerState, Remedy
from facade_manipulator.drives.states import Controlword, Mode
from facade_manipulator.errors import (
    DriveStateError,
    InputError,
    ManipulatorError,
    SetpointLimitError,
    StrokeLimitError,
)

ROUNDING = 1e-9  # m
LIMITED = '; it says that it limits its motion (bit 11)'
STEP_MARGIN = 1.1  # of max_speed, by which a target may step in a cycle
MAX_SLIP = 0.005  # m, from where the carriage was when power came


class TargetSource(Protocol):
    """A source of targets, such as `facade_manipulator.motion.SetpointFollower`."""

    @property
    def at_rest(self) -> bool:
        """Return whether the targets stand still."""

    def reset(self, positions: Triple) -> None:
        """Hold at positions [m] and forget the previous targets."""

    def hold(self) -> None:
        """Come to rest on the path."""

    def wait(self, seconds: float) -> None:
        """Continue from the last target, which the drives have held for a while [s]."""

    def sample(self, latch_time: float) -> Triple:
        """Return the positions [m] to be reached at a time of the system clock [s]."""


def allow_anything(*_: object) -> None:
    """Check nothing, the default without a mechanism."""


@dataclass(frozen=True)
class MechanismChecks:
    """The source of targets, and checks that raise a ManipulatorError."""

    source: TargetSource  #: asked for targets once a cycle while active, in the control thread
    #: takes three targets [m]
    check_targets: Callable[[Triple], None] = allow_anything
    #: takes three positions [m] and which axes are homed, in each cycle of homing
    check_homing: Callable[[Triple, tuple[bool, ...]], None] = allow_anything
    #: takes three measured positions [m], in each cycle while targets are followed
    check_actual: Callable[[Triple], None] = allow_anything


class TargetSupervisor:
    """Supervise the mechanism and choose what to command, in each cycle."""

    def __init__(
        self, axes: tuple[AxisSettings, ...], settings: ControllerSettings,
        mechanism: MechanismChecks,
    ) -> None:
        self.mechanism = mechanism
        #: the targets last chosen
        self.counts: tuple[int, ...] = (0,) * len(axes)
        #: the same [m] while the drives follow, else None
        self.positions: Triple | None = None
        self._axes = axes
        self._largest_steps = tuple(
            STEP_MARGIN * axis.max_speed * settings.period for axis in axes)
        # a target that is sent now is latched at the next SYNC and reached one period later
        self._lead = 2.0 * settings.period + settings.drive_lag
        # cycles between the SYNC of a target and of the answer from there; one that comes late, or
        # not at all, is older
        self._age = 1.0 + settings.drive_lag / settings.period
        self._latched: deque[Triple] = deque(
            maxlen=math.ceil(self._age) + settings.max_missed_cycles + 2)
        self._state = ControllerState.INACTIVE

    @property
    def at_rest(self) -> bool:
        """Return whether the targets stand still."""
        return self.mechanism.source.at_rest

    def supervise(
        self, group: Group, monitors: tuple[AxisMonitor, ...], now: float
    ) -> None:
        """Stop where the carriages are not where they were commanded, all three together."""
        if group.state is not ControllerState.HOMING and not group.follows:
            return
        try:
            actual = positions_of(monitors)
        except DriveStateError as error:
            group.stop(Cause(str(error)), now)
            return
        if group.state is not ControllerState.HOMING:
            self._supervise_following(group, monitors, actual, now)
            return
        try:
            self.mechanism.check_homing(actual, group.homed)
        except ManipulatorError as error:
            group.stop(Cause(
                f'homing stopped: {error}', 'move the carriages apart by hand, clear the '
                'faults, then home'), now)

    def _supervise_following(
        self, group: Group, monitors: tuple[AxisMonitor, ...], actual: Triple,
        now: float,
    ) -> None:
        def stop(message: str, axis: str = '') -> None:
            group.stop(Cause(message, Remedy.TRACKING, axis), now)

        try:
            self.mechanism.check_actual(actual)
        except ManipulatorError as error:
            stop(f'the measured mechanism: {error}')
        if self.positions is None:
            return  # no command has followed yet: the first came too late to be sent
        self._latched.append(self.positions)
        errors = [
            self._commanded(number, one.answers.cycles_old) - actual[number]
            for number, one in enumerate(monitors)]
        windows = [axis.following_error_window for axis in self._axes]
        for one, lag, window in zip(monitors, errors, windows, strict=True):
            if abs(lag) > window:
                stop(f'{one.title} is {lag:.4g} m behind its targets by its positions, bound '
                     f'{window:g} m{LIMITED if one.is_limited else ""}', one.name)
        lowest, highest, window = min(errors), max(errors), min(windows)
        if highest - lowest > window:
            first, second = sorted([errors.index(lowest), errors.index(highest)])
            stop(f'the following errors of {monitors[first].name} and {monitors[second].name} '
                 f'differ by {highest - lowest:.4g} m, bound {window:g} m')

    def _commanded(self, number: int, cycles_old: float) -> float:
        """
        Return the commanded position of a drive at the SYNC that it answered [m].

        Its own following error (60F4) would not do: without RPDOs a drive has none.
        """
        whole, share = divmod(self._age + cycles_old, 1.0)
        before, after = (self._latched[-1 - int(whole) - more][number] for more in (1, 0))
        return after + share * (before - after)

    def command(
        self, group: Group, commands: tuple[AxisCommand, ...],
        actual: tuple[int, ...], clock: CycleClock, now: float,
    ) -> tuple[AxisCommand, ...]:
        """
        Choose the targets of a cycle; return the commands to send along with them.

        A source that fails stops the group, which changes the commands.
        """
        latch_time = clock.smooth_stamp + self._lead
        try:
            if clock.held:
                self.mechanism.source.wait(clock.held)
            self.choose(group, commands[0], actual, latch_time)
        except ManipulatorError as error:
            group.stop(Cause(f'a target was rejected: {error}', Remedy.TARGET), now)
        except Exception as error:  # the source of targets may be the user's code
            group.stop(Cause(
                f'the source of the targets failed: {type(error).__name__}: {error}',
                Remedy.TARGET), now)
        else:
            return commands
        self.choose(group, group.commands[0], actual, latch_time)
        return group.commands

    def choose(
        self, group: Group, command: AxisCommand, actual: tuple[int, ...], latch_time: float,
    ) -> None:
        """
        Choose the targets of a cycle; they are the carriages until the drives are enabled.

        The command goes to the drives along with the targets; `actual` are the positions
        [counts], `latch_time` is when the drives reach the targets, on the system clock [s].
        Raises a ManipulatorError if the source has failed, or a target must not go to the drives.
        """
        before, self._state, held = self._state, group.state, self.positions
        if not group.follows:
            self.positions = None
            enabled = command.controlword & 0x0F == Controlword.ENABLE_OPERATION
            if not (enabled and command.mode == Mode.CYCLIC_SYNCHRONOUS_POSITION):
                self.counts = actual
            return
        is_active = group.state is ControllerState.ACTIVE
        resumes = is_active and before is ControllerState.HALTED
        if held is None or resumes:
            held = self._initialise(actual)
        if group.state is ControllerState.ACTIVATING:
            return
        if not is_active:
            self.mechanism.source.hold()
        self._set(held, self.mechanism.source.sample(latch_time))

    def _initialise(self, actual: tuple[int, ...]) -> Triple:
        """Begin where the drives hold; reject a carriage that is elsewhere by now."""
        q1, q2, q3 = [
            axis.to_metres(counts) for axis, counts in zip(self._axes, self.counts, strict=True)]
        self.positions = held = q1, q2, q3
        for name, axis, position, counts in zip(
                AXIS_NAMES, self._axes, held, actual, strict=True):
            slip = abs(axis.to_metres(counts) - position)
            if slip > MAX_SLIP:
                raise SetpointLimitError(
                    f'distance of {name} from its target', slip, MAX_SLIP, 'm', 'above')
        self._latched.extend([held] * (self._latched.maxlen or 0))
        self.mechanism.source.reset(held)
        return held

    def _set(self, before: Triple, targets: Triple) -> None:
        for number, (axis, target) in enumerate(zip(self._axes, targets, strict=True)):
            step, bound = abs(target - before[number]), self._largest_steps[number]
            if not math.isfinite(target):
                raise InputError.not_finite(f'target of {AXIS_NAMES[number]}', target, 'm')
            _require_inside(axis, f'target of {AXIS_NAMES[number]}', target, ROUNDING)
            if step > bound + ROUNDING:
                raise SetpointLimitError(
                    f'step of the target of {AXIS_NAMES[number]} in one cycle', step, bound, 'm',
                    'above')
        self.mechanism.check_targets(targets)
        # the limits of each stroke fit into the 32 bits of its drive: configure writes them
        self.counts = tuple([
            round(target * axis.counts_per_metre)
            for axis, target in zip(self._axes, targets, strict=True)])
        self.positions = targets


def _require_inside(axis: AxisSettings, name: str, position: float, margin: float) -> None:
    low, high = axis.lower_limit - margin, axis.upper_limit + margin
    if position < low:
        raise StrokeLimitError(name, position, low, 'm', 'below')
    if position > high:
        raise StrokeLimitError(name, position, high, 'm', 'above')


def require_inside(axes: tuple[AxisSettings, ...], actual: Triple) -> None:
    """Raise a StrokeLimitError if a carriage is beyond its stroke and the margin."""
    for name, axis, position in zip(AXIS_NAMES, axes, actual, strict=True):
        _require_inside(axis, f'position of {name}', position, axis.limit_margin)
