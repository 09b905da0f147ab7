"""
Homing of the three axes in mode 6: when bit 4 rises, what counts as success, what as failure.

A drive that was homed before still shows "homing attained". Success therefore counts only if
the bit was seen clear first, and a homing error only once the drive has had time to take it back.
Methods 35 and 37 take the present position as home within one cycle, so that the bit may never be
seen clear: with them it counts as well that the position has become that of the home position.
Whatever the method: a drive that says success somewhere else than at its home position has failed.
"""

from __future__ import annotations

import math

from facade_manipulator.drives.axis import Feedback
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.states import Controlword, Status
from facade_manipulator.errors import DriveError, DriveTimeoutError

_SUCCESS = Status.HOMING_ATTAINED | Status.TARGET_REACHED
_OUTCOME = _SUCCESS | Status.HOMING_ERROR
SETTLING_CYCLES = 5
HOME_TOLERANCE = 2  # counts, where the drive takes the present position as home
HOME_NOISE = 0.001  # m, where it looks for a switch or a stop
METHODS_AT_PRESENT_POSITION = frozenset({35, 37})


class AxisHoming:
    """
    Homing of one axis, which may take a while from the rising bit 4 to success [s].

    Axes of one rank home together, lower ranks first.
    """

    def __init__(self, name: str, timeout: float, rank: int = 1, method: int = 17) -> None:
        self.name = name
        self.rank = rank
        self._needs_no_motion = method in METHODS_AT_PRESENT_POSITION
        self.homed = False
        self._timeout = timeout
        self._deadline = math.inf  # set by the first cycle of the homing
        self._cycles = self._cycles_elsewhere = 0
        self._seen_clear = False

    def watch(self, feedback: Feedback) -> None:
        """Before the start, note whether the success of an earlier homing is still shown."""
        self._seen_clear = not feedback.statusword & Status.HOMING_ATTAINED

    def advance(self, feedback: Feedback, now: float) -> int:
        """
        Return the bits to add to the controlword; starts the homing when called first.

        Raises a DriveError if the drive reports a homing error, or success at another
        position than the home position, a DriveTimeoutError if it takes too long.
        """
        if self.homed:
            return 0
        if not self._cycles:
            self._deadline = now + self._timeout
        self._cycles += 1
        if self._has_succeeded(feedback):
            if feedback.home_error:
                self._wait_for_position(feedback)
                return Controlword.HOMING_START
            self.homed = True
            return 0
        self._require_progress(feedback.statusword, now)
        return Controlword.HOMING_START

    def _has_succeeded(self, feedback: Feedback) -> bool:
        shown = feedback.statusword & _OUTCOME == _SUCCESS
        self._seen_clear = (
            self._seen_clear or not feedback.statusword & Status.HOMING_ATTAINED)
        is_there = (self._needs_no_motion and not feedback.home_error
                    and self._cycles > SETTLING_CYCLES)
        return shown and (self._seen_clear or is_there)

    def _wait_for_position(self, feedback: Feedback) -> None:
        """Give the position a few cycles to become that of the home position."""
        self._cycles_elsewhere += 1
        if self._cycles_elsewhere > SETTLING_CYCLES:
            raise DriveError(
                f'{self.name}: homing ended {feedback.home_error:+.4g} m from the configured '
                'home_position: check the homing method; where it is twice home_position, the '
                'drive takes 607Ch with the other sign (home_offset in its profile)')

    def _require_progress(self, statusword: int, now: float) -> None:
        if statusword & Status.HOMING_ERROR and self._cycles > SETTLING_CYCLES:
            raise DriveError(
                f'{self.name}: homing failed, the drive reports a homing error (statusword '
                f'{statusword:04X}h): check switch, hard stop and homing method')
        if now > self._deadline:
            raise DriveTimeoutError(
                f'{self.name}: homing took longer than {self._timeout:g} s (statusword '
                f'{statusword:04X}h): check switch, hard stop and homing method')


class HomingSequence:
    """Homing of the group: rank after rank."""

    def __init__(self, axes: tuple[AxisHoming, ...]) -> None:
        self.axes = axes

    @property
    def homed(self) -> tuple[bool, ...]:
        """Return which axes are homed."""
        return tuple(axis.homed for axis in self.axes)

    @property
    def done(self) -> bool:
        """Return whether every axis is homed."""
        return all(self.homed)

    @property
    def due(self) -> int | None:
        """Rank whose turn it is; None when every axis is homed."""
        return min((axis.rank for axis in self.axes if not axis.homed), default=None)

    def advance(self, number: int, feedback: Feedback, now: float) -> int:
        """
        Return the bits to add to one axis's controlword; nothing before its rank is due.

        Raises what `AxisHoming.advance` does: the group stops all three.
        """
        axis = self.axes[number]
        if axis.rank != self.due:
            axis.watch(feedback)
            return 0
        return axis.advance(feedback, now)


def home_error(axis: AxisSettings, counts: int, period: float) -> float:
    """
    Return how far a carriage is from its home position [m], 0 if it is there.

    `counts` is its position, `period` that of the cycle [s].
    """
    tolerance = HOME_TOLERANCE
    if axis.homing_method not in METHODS_AT_PRESENT_POSITION:
        speed = axis.homing_zero_speed
        braking = speed * period + speed ** 2 / (2.0 * axis.homing_acceleration)
        tolerance = abs(axis.to_counts(HOME_NOISE + braking))
    away = counts - axis.to_counts(axis.home_position)
    return axis.to_metres(away) if abs(away) > tolerance else 0.0
