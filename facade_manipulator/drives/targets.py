"""
Choice of the drives' targets, and the check that the carriages reach them.

Targets are the positions of the carriages at power-on, and afterwards those of the stream. The
mechanism's checks are the last checks before the bus. A target that fails a check, or jumps, is
rejected with a message, never clamped.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import ceil
from typing import Any

from facade_manipulator.drives.axis import positions_of
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.cycle import CycleClock
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.guard import Guard, Unguarded
from facade_manipulator.drives.snapshot import Cause, Remedy
from facade_manipulator.errors import (
    compared,
    compared_magnitudes,
    ManipulatorError,
    SetpointLimitError,
)
from facade_manipulator.kinematics.geometry import AXIS_NAMES, PerCarriage

TARGET_ROUNDING = 1e-9  # m
STEP_MARGIN = 1.1  # of max_speed, by which a target may step in a cycle


class TargetSupervisor:
    """Supervisor of the carriages, which also chooses the targets of each cycle."""

    def __init__(
        self,
        group: Group,
        settings: ControllerSettings,
        source: Any,
        guard: Guard | Unguarded,
    ) -> None:
        #: asked for targets once a cycle while active: a
        #: `facade_manipulator.motion.follower.SetpointFollower`, or an object with its `at_rest`,
        #: `reset`, `hold`, `wait`, `sample` and `withdraw`
        self.source = source
        self.guard = guard
        #: the targets last chosen [m] while the drives follow, else None
        self.positions: PerCarriage | None = None
        self._group = group
        self._axes = group.axes
        self._largest_step = (
            STEP_MARGIN
            * settings.period
            * min(axis.settings.max_speed for axis in group.axes)
        )
        # a target that is sent now is latched at the next SYNC and reached one period later
        self._lead = 2.0 * settings.period + settings.drive_lag
        # cycles from the SYNC that latches a target to the SYNC whose answer has the same
        # position; a late or missing answer adds cycles
        self._age = 1.0 + settings.drive_lag / settings.period
        # the targets of the last SYNCs [m]
        self._latched: deque[PerCarriage] = deque(
            maxlen=ceil(self._age) + settings.max_missed_cycles + 2
        )
        self._state = GroupState.INACTIVE
        self._remember()

    def supervise(self, now: float) -> None:
        """Stop all three carriages if one of them is not at its commanded position."""
        group = self._group
        is_homing = group.state is GroupState.HOMING
        if not is_homing and not group.follows:
            return
        try:
            actual = positions_of(self._axes)
            if is_homing:
                homed = tuple([axis.has_found_home for axis in self._axes])
                self.guard.check_homing(actual, homed)
            else:
                self.guard.check_measured(actual)
        except ManipulatorError as error:
            group.stop(
                Cause(
                    f'homing stopped: {error.problem}',
                    'move the carriages apart by hand, clear the faults, then home',
                )
                if is_homing
                else Cause(f'the measured mechanism: {error.problem}', Remedy.TRACKING),
                now,
            )
            return
        # without positions the first command was too late to be sent
        if self.positions is not None:
            self._latched.append(self.positions)
            for cause in self._lags(actual):
                group.stop(cause, now)

    def _lags(self, actual: PerCarriage) -> Iterator[Cause]:
        """
        Yield a cause for a carriage that lags behind its target, or for unequal lags.

        The following error of the drive (60F4h) is insufficient: without RPDOs it stays near 0.
        """
        errors: list[float] = []
        for number, axis in enumerate(self._axes):
            # the commanded position at the SYNC that the drive has answered
            whole, share = divmod(self._age + axis.answers.cycles_old, 1.0)
            newest = -1 - int(whole)
            after = self._latched[newest][number]
            before = self._latched[newest - 1][number]
            error = after + share * (before - after) - actual[number]
            errors.append(error)
            window = axis.settings.following_error_window
            if abs(error) > window:
                # an axis ahead of its targets has a negative error
                error_text, limit_text = compared_magnitudes(error, window, '.4g')
                yield Cause(
                    f'{axis.title} is {error_text} m behind its targets according to its '
                    f'positions, above the limit {limit_text} m '
                    '(following_error_window)',
                    Remedy.TRACKING,
                    axis.name,
                )

        difference = max(errors) - min(errors)
        window = min(axis.settings.following_error_window for axis in self._axes)
        if difference > window:
            ends = (errors.index(min(errors)), errors.index(max(errors)))
            first, second = sorted(ends)
            difference_text, limit_text = compared(difference, window, '.4g')
            yield Cause(
                f'the following errors of {AXIS_NAMES[first]} and {AXIS_NAMES[second]} differ by '
                f'{difference_text} m, above the limit {limit_text} m '
                '(following_error_window)',
                Remedy.TRACKING,
            )

    def command(self, clock: CycleClock, now: float) -> None:
        """Choose the targets of a cycle; stop the group if their source fails."""
        reach_time = clock.smooth_time + self._lead
        self._remember()
        try:
            if clock.held:
                self.source.wait(clock.held)
            self.choose(reach_time)
        except Exception as error:  # a defect of the source must also stop the drives
            failure = (
                'a target was rejected'
                if isinstance(error, ManipulatorError)
                else f'the source of the targets failed: {type(error).__name__}'
            )
            problem = getattr(error, 'problem', str(error))
            self._group.stop(
                Cause(f'{failure}: {problem}', 'check the source of the setpoints'), now
            )
            # a stopped group no longer follows a source
            self.choose(reach_time)

    def withdraw(self) -> None:
        """
        Undo the last `command`, because its targets were chosen too late to be sent.

        The method is called only while the drives follow targets. The drives still hold the
        previous targets, and the next command starts from these.
        """
        counts, self.positions, self._state = self._remembered
        for axis, target in zip(self._axes, counts, strict=True):
            axis.output.aim_at(target)
        self.source.withdraw()

    def _remember(self) -> None:
        counts = [axis.output.target for axis in self._axes]
        self._remembered = counts, self.positions, self._state

    def choose(self, reach_time: float) -> None:
        """
        Choose the targets of a cycle: the carriage positions until the drives are enabled.

        `reach_time` is when the drives reach the targets, on the monotonic clock [s]. Raises a
        ManipulatorError if the source has failed, or a target must not be sent to the drives.
        """
        before = self._state
        state = self._group.state
        self._state = state
        if not self._group.follows:
            self._follow_carriages()
            return

        is_resumed = state is GroupState.ACTIVE and before is GroupState.HALTED
        held = self.positions
        if held is None or is_resumed:
            held = self._begin_at_targets()
        if state is GroupState.ACTIVATING:
            return
        source = self.source
        if state is not GroupState.ACTIVE:
            source.hold()
        self._use(source.sample(reach_time), held)

    def _follow_carriages(self) -> None:
        """Set the targets to the present positions, except for drives that hold with power."""
        self.positions = None
        for axis in self._axes:
            if not axis.output.holds_target:
                axis.output.aim_at(axis.feedback.counts)

    def _begin_at_targets(self) -> PerCarriage:
        """
        Begin to follow the source from the targets that the drives hold; return them [m].

        From now on the following error shows a carriage that has moved since power-on.
        """
        q1, q2, q3 = [
            axis.settings.to_metres(axis.output.target) for axis in self._axes
        ]
        held = (q1, q2, q3)
        self.positions = held
        self._latched.extend([held] * (self._latched.maxlen or 0))
        self.source.reset(held)
        return held

    def _use(self, targets: PerCarriage, held: PerCarriage) -> None:
        """Check targets against the held targets [m] just before the bus; convert them."""
        self.guard.check_targets(targets)
        for name, old, new in zip(AXIS_NAMES, held, targets, strict=True):
            step = abs(new - old)
            # a step that is not finite is also rejected
            if not step <= self._largest_step + TARGET_ROUNDING:
                raise SetpointLimitError(
                    f'target step of {name} in one cycle',
                    step,
                    self._largest_step,
                    'm',
                    'above',
                )
        # the limits of each stroke fit into the 32 bits of its drive: configure writes them
        for axis, target in zip(self._axes, targets, strict=True):
            axis.output.aim_at(axis.settings.to_counts(target))
        self.positions = targets
