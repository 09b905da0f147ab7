"""
The mechanism that the drives move: whether it stands as commanded, and what to command next.

Targets are where the carriages are at power-on, then the stream. The last check before the bus
trusts nobody: a target that is not finite, leaves the stroke or jumps is rejected with a message,
never clamped.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Protocol

from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, Triple
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.cycle import CycleClock
from facade_manipulator.drives.group import AxisCommand, Group
from facade_manipulator.drives.monitor import AxisMonitor, positions_of
from facade_manipulator.drives.states import Controlword, Mode
from facade_manipulator.errors import (
    DriveStateError,
    InputError,
    ManipulatorError,
    SetpointLimitError,
    StrokeLimitError,
)

_AT_REST = frozenset({ControllerState.RAMPING, ControllerState.HALTED})
ROUNDING = 1e-9  # m
LIMITED = '; it says that it limits its motion (bit 11)'
STEP_MARGIN = 1.1  # of max_speed, by which a target may step in a cycle
MAX_SLIP = 0.005  # m, from where the carriage was when power came


class TargetSource(Protocol):
    """Where the targets come from, such as `facade_manipulator.motion.SetpointFollower`."""

    @property
    def at_rest(self) -> bool:
        """Return whether the targets stand still."""

    def reset(self, positions: Triple) -> None:
        """Hold at positions [m] and forget everything before."""

    def hold(self) -> None:
        """Come to rest on the path."""

    def wait(self, seconds: float) -> None:
        """Go on from the last target, which the drives have held for a while [s]."""

    def sample(self, latch_time: float) -> Triple:
        """Return the positions [m] to be reached at a time of the system clock [s]."""


TargetCheck = Callable[[Triple], None]
HomingCheck = Callable[[Triple, tuple[bool, ...]], None]


def allow_anything(*_: object) -> None:
    """Check nothing: the default where the caller knows no mechanism."""


@dataclass(frozen=True)
class MechanismChecks:
    """What the three drives move."""

    source: TargetSource  #: asked for targets once a cycle while active, in the control thread
    #: takes three positions [m], raises a ManipulatorError where the mechanism must not be
    check_targets: TargetCheck = allow_anything
    #: takes three positions [m] and which axes are homed, called in each cycle of homing; raises a
    #: ManipulatorError when carriages or links come too close
    check_homing: HomingCheck = allow_anything
    #: takes the three measured positions [m], called in each cycle while targets are followed;
    #: raises a ManipulatorError where the carriages are not what the mechanism allows
    check_actual: TargetCheck = allow_anything


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
        """Stop where the carriages are not what was commanded: nobody else sees all three."""
        if group.state is not ControllerState.HOMING and not group.state.is_following:
            return
        try:
            actual = positions_of(monitors)
        except DriveStateError as error:
            group.stop(Cause(str(error)), now)
            return
        if group.state is ControllerState.HOMING:
            self._supervise_homing(group, actual, now)
        else:
            self._supervise_following(group, monitors, actual, now)

    def _supervise_homing(self, group: Group, actual: Triple, now: float) -> None:
        try:
            self.mechanism.check_homing(actual, group.homing.homed)
        except ManipulatorError as error:
            group.stop(Cause(
                f'homing stopped: {error}', 'move the carriages apart by hand, clear the '
                'faults, then home'), now)

    def _supervise_following(
        self, group: Group, monitors: tuple[AxisMonitor, ...], actual: Triple,
        now: float,
    ) -> None:
        try:
            self.mechanism.check_actual(actual)
        except ManipulatorError as error:
            group.stop(
                Cause(f'the measured mechanism: {error}', Remedy.TRACKING), now)
        if self.positions is None:
            return  # no command has followed yet: the first came too late to be sent
        self._latched.append(self.positions)
        errors = [
            self._commanded(number, one.answers.cycles_old) - position
            for number, (one, position) in enumerate(zip(monitors, actual, strict=True))]
        windows = [axis.following_error_window for axis in self._axes]
        for one, behind, window in zip(monitors, errors, windows, strict=True):
            if abs(behind) > window:
                group.stop(Cause(
                    f'{one.title} is {behind:.4g} m behind its targets by its positions, bound '
                    f'{window:g} m{LIMITED if one.is_limited else ""}',
                    Remedy.TRACKING, one.name), now)
        least, greatest, window = min(errors), max(errors), min(windows)
        if greatest - least > window:
            names = ' and '.join(sorted(
                monitors[errors.index(one)].name for one in (least, greatest)))
            group.stop(Cause(
                f'the following errors of {names} differ by {greatest - least:.4g} m, bound '
                f'{window:g} m', Remedy.TRACKING), now)

    def _commanded(self, number: int, cycles_old: float) -> float:
        """
        Return where [m] a drive was commanded to be at the SYNC that it answered.

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

        A source that fails stops the group: the commands are then others than those given.
        """
        latch_time = clock.smooth_stamp + self._lead
        try:
            if clock.held:
                self.mechanism.source.wait(clock.held)
            self.choose(group.state, commands[0], actual, latch_time)
        except ManipulatorError as error:
            group.stop(Cause(f'a target was rejected: {error}', Remedy.TARGET), now)
        except Exception as error:  # a source of targets may be anybody's code
            group.stop(Cause(
                f'the source of the targets failed: {type(error).__name__}: {error}',
                Remedy.TARGET), now)
        else:
            return commands
        self.choose(group.state, group.commands[0], actual, latch_time)
        return group.commands

    def choose(
        self, state: ControllerState, command: AxisCommand, actual: tuple[int, ...],
        latch_time: float,
    ) -> None:
        """
        Choose the targets of a cycle; they are the carriages until the drives are enabled.

        The state is what the group is doing, the command what is commanded along with the
        targets; `actual` are the positions [counts], `latch_time` is when the drives reach the
        targets, on the system clock [s]. Raises a ManipulatorError if the source has failed, or a
        target must not go to the drives.
        """
        before, self._state, held = self._state, state, self.positions
        if not state.is_following:
            self.positions = None
            enabled = command.controlword & 0x0F == Controlword.ENABLE_OPERATION
            if not (enabled and command.mode == Mode.CYCLIC_SYNCHRONOUS_POSITION):
                self.counts = actual
            return
        resumes = (before, state) == (ControllerState.HALTED, ControllerState.ACTIVE)
        if held is None or resumes:
            held = self._initialise(actual)
        if state is ControllerState.HOLDING:
            return
        if state in _AT_REST:
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
            step = abs(target - before[number])
            if not (axis.lower_limit - ROUNDING <= target <= axis.upper_limit + ROUNDING
                    and step <= self._largest_steps[number] + ROUNDING):
                raise self._violation(number, target, step)
        self.mechanism.check_targets(targets)
        self.counts = tuple([
            axis.to_counts(target) for axis, target in zip(self._axes, targets, strict=True)])
        self.positions = targets

    def _violation(self, number: int, target: float, step: float) -> ManipulatorError:
        """Say what is wrong with a target, ready to be raised."""
        axis, name = self._axes[number], f'target of {AXIS_NAMES[number]}'
        if not math.isfinite(target):
            return InputError.not_finite(name, target, 'm')
        return _beyond_stroke(axis, name, target, ROUNDING) or SetpointLimitError(
            f'step of the {name} in one cycle', step, self._largest_steps[number], 'm', 'above')


def _beyond_stroke(
    axis: AxisSettings, name: str, position: float, margin: float
) -> StrokeLimitError | None:
    low, high = axis.lower_limit - margin, axis.upper_limit + margin
    if low <= position <= high:
        return None
    bound, relation = (low, 'below') if position < low else (high, 'above')
    return StrokeLimitError(name, position, bound, 'm', relation)


def require_inside(axes: tuple[AxisSettings, ...], actual: Triple) -> None:
    """Raise a StrokeLimitError if a carriage is beyond its stroke and the margin."""
    for name, axis, position in zip(AXIS_NAMES, axes, actual, strict=True):
        if error := _beyond_stroke(axis, f'position of {name}', position, axis.limit_margin):
            raise error
