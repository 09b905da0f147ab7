"""
Homing of an axis (mode 6): set bit 4, then read the result from the statusword.

A drive that was homed before still shows "homing attained". Success therefore counts only if the
bit was seen clear first. A homing error counts only after the drive has had time to clear an
earlier error. Methods 35 and 37 take the present position as home within one cycle, so that the
bit may never be seen clear. With these methods, success also counts at the home position. Other
methods also take one cycle if the carriage is already at home. With these methods, success counts
if it is steady and the carriage stays exactly at home. With any method a drive that reports
success at another position has failed. Some drives never set bit 10, "target reached", or only for
a moment (`Quirks`). With these drives, bit 12 counts once the carriage is at rest.
"""

from __future__ import annotations

from math import ceil

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.feedback import REST_SPEED
from facade_manipulator.drives.states import Status

SETTLING_CYCLES = 5
STEADY_TIME = 0.2  # s, of a success that was not seen clear, since the start
HOME_TOLERANCE = 2  # counts, where the drive takes the present position as home
METHODS_AT_PRESENT_POSITION = frozenset({35, 37})


class HomingBounds:
    """Limits for the homing of one axis; `period` is the cycle period [s]."""

    HOME_NOISE = 0.001  # m, where it looks for a switch or a stop

    def __init__(self, axis: AxisSettings, period: float) -> None:
        #: whether the carriage looks for a switch or a stop
        self.has_motion = axis.homing_method not in METHODS_AT_PRESENT_POSITION
        self.home = axis.to_counts(axis.home_position)  #: home position [counts]
        #: largest distance from the home position after a success [counts]
        self.tolerance = HOME_TOLERANCE
        if self.has_motion:
            speed = axis.homing_zero_share * axis.homing_speed
            braking = speed * period + speed**2 / (2.0 * axis.homing_acceleration)
            self.tolerance = abs(axis.to_counts(self.HOME_NOISE + braking))
        #: largest change of the position of a carriage at rest in one cycle [counts]
        self.most_at_rest = max(
            HOME_TOLERANCE, abs(axis.to_counts(REST_SPEED * period))
        )
        stroke = axis.upper_limit - axis.lower_limit
        self.timeout = axis.homing_strokes * stroke / axis.homing_speed  #: [s]
        self.most_cycles = self.timeout / period
        #: cycles at home after which a success counts that was not seen clear
        self.steady_cycles = ceil(STEADY_TIME / period)


class Homing:
    """
    Homing of one axis; axes of the same rank home together, lower ranks first.

    The group calls `watch` while other ranks home, and then `advance` in each cycle.
    """

    _SUCCESS = Status.HOMING_ATTAINED | Status.TARGET_REACHED
    _OUTCOME = _SUCCESS | Status.HOMING_ERROR

    def __init__(
        self,
        name: str,
        axis: AxisSettings,
        period: float,
        needs_bit_10: bool,
    ) -> None:
        self.rank = axis.homing_rank
        self.is_homed = False
        self._name = name
        self._axis = axis
        self._bounds = HomingBounds(axis, period)
        # without bit 10 the drive is at its home position once its counts no longer change
        self._needs_bit_10 = needs_bit_10
        self._seen_clear = False
        self._counts = 0  # of the previous cycle
        # numbers of cycles
        self._cycles = 0  # since the start
        self._cycles_at_rest = 0  # in a row
        self._cycles_at_home = 0  # in a row with success at the home position
        self._cycles_elsewhere = 0  # with success at another position

    def watch(self, statusword: int) -> None:
        """Record, before the start, whether the drive still reports an earlier success."""
        self._seen_clear = not statusword & Status.HOMING_ATTAINED

    def advance(self, statusword: int, counts: int) -> str:
        """
        Evaluate statusword and position [counts] of a cycle; return the reason of a failure.

        The reason is ``''`` for no failure. The reasons are a homing error of the drive, success
        at a position other than the home position, and a timeout.
        """
        bounds = self._bounds
        self._count_rest(counts)
        self._cycles += 1
        self._seen_clear = self._seen_clear or not statusword & Status.HOMING_ATTAINED
        away = counts - bounds.home
        is_there = abs(away) <= bounds.tolerance
        is_success = self._shows_success(statusword)
        is_exact = is_success and abs(away) <= HOME_TOLERANCE
        self._cycles_at_home = self._cycles_at_home + 1 if is_exact else 0

        is_at_home = is_there and self._has_settled
        if bounds.has_motion:
            is_at_home = self._cycles_at_home > bounds.steady_cycles
        if not is_success or not (self._seen_clear or is_at_home):
            return self._failure(statusword)
        self.is_homed = is_there
        self._cycles_elsewhere += 1
        if is_there or self._cycles_elsewhere <= SETTLING_CYCLES:
            return ''
        return (
            f'{self._name}: homing ended {self._axis.to_metres(away):+.4g} m from the '
            'configured home_position: check the homing method; if this distance is twice '
            'home_position, use home_offset in the profile, because the drive takes 607Ch '
            'with the other sign'
        )

    @property
    def _has_settled(self) -> bool:
        """Return whether the drive has had time to clear the result of an earlier homing."""
        return self._cycles > SETTLING_CYCLES

    def _count_rest(self, counts: int) -> None:
        """Count consecutive cycles in which the position [counts] hardly changes."""
        is_still = abs(counts - self._counts) <= self._bounds.most_at_rest
        self._counts = counts
        self._cycles_at_rest = self._cycles_at_rest + 1 if is_still else 0

    def _shows_success(self, statusword: int) -> bool:
        """Return whether a statusword reports that homing ended without an error."""
        if self._needs_bit_10:
            return statusword & self._OUTCOME == self._SUCCESS
        is_at_rest = self._cycles_at_rest >= SETTLING_CYCLES
        outcome = statusword & (Status.HOMING_ATTAINED | Status.HOMING_ERROR)
        return outcome == Status.HOMING_ATTAINED and is_at_rest

    def _failure(self, statusword: int) -> str:
        """Return the reason of the failure of a drive that reports no success, or ``''``."""
        if statusword & Status.HOMING_ERROR and self._has_settled:
            failure = 'homing failed: the drive reports a homing error'
        elif self._cycles > self._bounds.most_cycles:
            failure = f'homing took longer than {self._bounds.timeout:g} s'
            if statusword & self._OUTCOME == Status.HOMING_ATTAINED:
                failure += (
                    ', bit 12 is 1 (attained), but bit 10 is 0 (reached); if the drive never '
                    'sets bit 10, set quirks.homes_without_bit_10 in its profile'
                )
        else:
            return ''
        return (
            f'{self._name}: {failure} (statusword {statusword:04X}h): '
            'check switch, hard stop and homing method'
        )
