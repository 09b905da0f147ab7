"""
The targets that go to the drives: where the carriages are at power-on, then the stream.

The last check before the bus. It trusts nobody: a target that is not finite, leaves the stroke or
jumps is rejected with a message, never clamped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Protocol

from facade_manipulator.drives.cia402 import (
    AXIS_NAMES,
    AxisCommand,
    AxisSettings,
    Controlword,
    FOLLOWING_PHASES,
    Mode,
    Phase,
    Triple,
)
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.errors import InputError, LimitError, SetpointLimitError, StrokeLimitError

_AT_REST = frozenset({Phase.RAMPING, Phase.HALTED})
ROUNDING = 1e-9
STEP_MARGIN = 1.1  # of max_speed, by which a target may step in a cycle
MAX_SLIP = 0.005  # m, from where the carriage was when power came


class TargetSource(Protocol):
    """Where the targets come from, such as `facade_manipulator.motion.setpoints`."""

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
HomingCheck = Callable[[Triple, tuple[bool, bool, bool]], None]


def allow_anything(*_: object) -> None:
    """Check nothing: the default where the caller knows no mechanism."""


@dataclass(frozen=True)
class MechanismChecks:
    """
    What the three drives move.

    Attributes
    ----------
    source : TargetSource
        Asked for targets once a cycle while active, in the control thread.
    check_targets : callable
        Takes three positions [m], raises a ManipulatorError where the mechanism must not be.
    check_homing : callable
        Takes three positions [m] and which axes are homed, called in each cycle of homing;
        raises a ManipulatorError when carriages or links come too close.
    check_actual : callable
        Takes the three measured positions [m], called in each cycle while targets are followed;
        raises a ManipulatorError where the carriages are not what the mechanism allows.

    """

    source: TargetSource
    check_targets: TargetCheck = allow_anything
    check_homing: HomingCheck = allow_anything
    check_actual: TargetCheck = allow_anything


class Targets:
    """
    Choose what to command in each cycle.

    Parameters
    ----------
    axes : tuple of AxisSettings
    settings : ControllerSettings
    mechanism : MechanismChecks

    Attributes
    ----------
    counts : tuple of int
        The targets last chosen.
    positions : tuple of float or None
        The same [m] while the drives follow, else None.

    """

    def __init__(
        self, axes: tuple[AxisSettings, ...], settings: ControllerSettings,
        mechanism: MechanismChecks,
    ) -> None:
        self.mechanism = mechanism
        self.counts: tuple[int, ...] = (0,) * len(axes)
        self.positions: Triple | None = None
        self._axes = axes
        self._largest_steps = tuple(
            STEP_MARGIN * axis.max_speed * settings.period for axis in axes)
        self._phase = Phase.OFF

    def track(self, command: AxisCommand, actual: tuple[int, ...]) -> None:
        """Keep the targets at the carriages until the drives are enabled in the cyclic mode."""
        self.positions = None
        enabled = command.controlword & 0x0F == Controlword.ENABLE_OPERATION
        if not (enabled and command.mode == Mode.CYCLIC_SYNCHRONOUS_POSITION):
            self.counts = actual

    def choose(
        self, phase: Phase, command: AxisCommand, actual: tuple[int, ...], latch_time: float
    ) -> None:
        """
        Choose the targets of a cycle.

        Parameters
        ----------
        phase : Phase
            What the group is doing.
        command : AxisCommand
            What is commanded along with the targets.
        actual : tuple of int
            Actual positions [counts].
        latch_time : float
            When the drives reach the targets, on the system clock [s].

        Raises
        ------
        ManipulatorError
            The source has failed, or a target must not go to the drives.

        """
        before, self._phase = self._phase, phase
        if phase not in FOLLOWING_PHASES:
            self.track(command, actual)
            return
        if before not in FOLLOWING_PHASES or (before, phase) == (Phase.HALTED, Phase.RUNNING):
            self._initialise(actual)
        if phase is Phase.HOLDING:
            return
        if phase in _AT_REST:
            self.mechanism.source.hold()
        self._set(self.mechanism.source.sample(latch_time))

    def _initialise(self, actual: tuple[int, ...]) -> None:
        """Begin where the drives hold; reject a carriage that is elsewhere by now."""
        self.positions = tuple(
            axis.to_metres(counts) for axis, counts in zip(self._axes, self.counts, strict=True))
        for name, axis, held, counts in zip(
                AXIS_NAMES, self._axes, self.positions, actual, strict=True):
            slip = abs(axis.to_metres(counts) - held)
            if slip > MAX_SLIP:
                raise SetpointLimitError(
                    f'distance of {name} from its target', slip, MAX_SLIP, 'm', 'above')
        self.mechanism.source.reset(self.positions)

    def _set(self, targets: Triple) -> None:
        for number, target in enumerate(targets):
            self._require_valid(number, target)
        self.mechanism.check_targets(targets)
        self.counts = tuple([
            axis.to_counts(target) for axis, target in zip(self._axes, targets, strict=True)])
        self.positions = tuple(targets)

    def _require_valid(self, number: int, target: float) -> None:
        axis, step = self._axes[number], abs(target - self.positions[number])
        if (axis.lower_limit - ROUNDING <= target <= axis.upper_limit + ROUNDING
                and step <= self._largest_steps[number] + ROUNDING):
            return
        name = f'target of {AXIS_NAMES[number]}'
        if not math.isfinite(target):
            raise InputError.not_finite(name, target, 'm')
        if target < axis.lower_limit - ROUNDING:
            raise StrokeLimitError(name, target, axis.lower_limit, 'm', 'below')
        if target > axis.upper_limit + ROUNDING:
            raise StrokeLimitError(name, target, axis.upper_limit, 'm', 'above')
        raise SetpointLimitError(
            f'step of the {name} in one cycle', step, self._largest_steps[number], 'm', 'above')


def require_inside(axes: tuple[AxisSettings, ...], actual: Triple) -> None:
    """
    Check that the carriages are where they may be powered.

    Raises
    ------
    LimitError
        A carriage is beyond its stroke and the margin.

    """
    for name, axis, position in zip(AXIS_NAMES, axes, actual, strict=True):
        low, high = axis.lower_limit - axis.limit_margin, axis.upper_limit + axis.limit_margin
        if not low <= position <= high:
            bound, relation = (low, 'below') if position < low else (high, 'above')
            raise LimitError(f'position of {name}', position, bound, 'm', relation)
