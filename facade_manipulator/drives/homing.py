"""
Homing of an axis (mode 6): rise of bit 4, and success or failure by the statusword.

A drive that was homed before still shows "homing attained". Success therefore counts only if
the bit was seen clear first, and a homing error only once the drive has had time to take it back.
Methods 35 and 37 take the present position as home within one cycle, so that the bit may never be
seen clear. With them success also counts at the home position. Other methods also take one cycle
where the carriage is at home already. With them success counts if it is steady and the carriage
stays exactly at home.
With any method a drive that reports success at another position has failed.
Some drives never set bit 10, "target reached", or only for a moment (`Quirks`). With them bit 12
counts once the carriage is at rest.
"""

from __future__ import annotations

from math import ceil

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.states import Status

_SUCCESS = Status.HOMING_ATTAINED | Status.TARGET_REACHED
_OUTCOME = _SUCCESS | Status.HOMING_ERROR
SETTLING_CYCLES = 5
STEADY_TIME = 0.2  # s, of a success that was not seen clear, since the start
HOME_TOLERANCE = 2  # counts, where the drive takes the present position as home
REST_SPEED = 0.002  # m/s, below which a carriage that has homed is at rest
HOME_NOISE = 0.001  # m, where it looks for a switch or a stop
METHODS_AT_PRESENT_POSITION = frozenset({35, 37})


class Homing:
    """Homing of one axis; axes of one rank home together, lower ranks first."""

    def __init__(
        self,
        name: str,
        axis: AxisSettings,
        period: float,
        needs_bit_10: bool = True,
    ) -> None:
        self.rank = axis.homing_rank
        self.is_homed = False
        self._name = name
        self._axis = axis
        self._has_motion = axis.homing_method not in METHODS_AT_PRESENT_POSITION
        self._tolerance = HOME_TOLERANCE
        if self._has_motion:
            speed = axis.homing_zero_share * axis.homing_speed
            braking = speed * period + speed**2 / (2.0 * axis.homing_acceleration)
            self._tolerance = abs(axis.to_counts(HOME_NOISE + braking))
        stroke = axis.upper_limit - axis.lower_limit
        self._timeout = axis.homing_strokes * stroke / axis.homing_speed
        self._most_cycles = self._timeout / period
        self._steady_cycles = ceil(STEADY_TIME / period)
        self._cycles = 0
        self._cycles_elsewhere = 0  # with success at another position
        # without bit 10 the drive is at its home position once its counts no longer change
        self._success = _SUCCESS if needs_bit_10 else Status.HOMING_ATTAINED
        self._needs_bit_10 = needs_bit_10
        self._counts = 0
        self._cycles_at_rest = 0  # in a row
        self._most_at_rest = max(
            HOME_TOLERANCE, abs(axis.to_counts(REST_SPEED * period))
        )
        self._seen_clear = False
        self._cycles_at_home = 0  # in a row, with success

    def watch(self, statusword: int) -> None:
        """Record before the start whether the success of an earlier homing is still shown."""
        self._seen_clear = not statusword & Status.HOMING_ATTAINED

    def advance(self, statusword: int, counts: int) -> str:
        """
        Return the reason of a failure by the statusword and position [counts] of a cycle.

        The reason is ``''`` for no failure. The reasons are a homing error of the drive, success
        at a position other than the home position, and a timeout.
        """
        self._cycles += 1
        is_still = abs(counts - self._counts) <= self._most_at_rest
        self._counts = counts
        self._cycles_at_rest = self._cycles_at_rest + 1 if is_still else 0
        is_at_rest = self._needs_bit_10 or self._cycles_at_rest >= SETTLING_CYCLES
        self._seen_clear = self._seen_clear or not statusword & Status.HOMING_ATTAINED
        away = counts - self._axis.to_counts(self._axis.home_position)
        is_there = abs(away) <= self._tolerance
        has_settled = self._cycles > SETTLING_CYCLES
        outcome = statusword & (self._success | Status.HOMING_ERROR)
        is_success = outcome == self._success and is_at_rest
        is_exact = is_success and abs(away) <= HOME_TOLERANCE
        self._cycles_at_home = self._cycles_at_home + 1 if is_exact else 0
        if self._has_motion:
            is_at_home = self._cycles_at_home > self._steady_cycles
        else:
            is_at_home = is_there and has_settled
        if is_success and (self._seen_clear or is_at_home):
            self.is_homed = is_there
            self._cycles_elsewhere += 1
            if is_there or self._cycles_elsewhere <= SETTLING_CYCLES:
                return ''
            return (
                f'{self._name}: homing ended {self._axis.to_metres(away):+.4g} m from the '
                'configured home_position: check the homing method; where it is twice '
                'home_position, the drive takes 607Ch with the other sign (home_offset in its '
                'profile)'
            )
        if statusword & Status.HOMING_ERROR and has_settled:
            failure = 'homing failed, the drive reports a homing error'
        elif self._cycles > self._most_cycles:
            failure = f'homing took longer than {self._timeout:g} s'
            if statusword & _OUTCOME == Status.HOMING_ATTAINED:
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
