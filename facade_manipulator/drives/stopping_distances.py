"""
Stopping distances of carriages: check at the start, table, and speed limit near a neighbour.

The driver sends only targets from which the three carriages can brake together and keep their gap.
Drives that stop by themselves do not coordinate, so that less than the gap remains. The order on
the rail is A1, A3, A2.

- **At the start and at each change of limits** (`StoppingAnalysis.check`): failures in which every
  drive brakes must leave the carriages apart; otherwise the parameters are rejected. If one drive
  brakes by itself, its neighbour continues until the report has stopped it.
- **Near a neighbour** (`Separation`): at full speed no brake avoids a carriage that stops at once,
  such as on a seized screw. Near each other, carriages are therefore slow enough to brake in time.
- **In the table of `stopping`** (`StoppingAnalysis.table`): the emergency stop acts in hardware,
  without the driver. Two carriages that approach each other begin it farther apart than one that
  approaches a carriage at rest, because they must be able to brake together.

References
----------
IEC 60204-1 (stop categories), IEC 61800-5-2 (STO, SS1-t).

"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import compared, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.limits import MotionLimits

# share of the free gap by which measured carriages may be too near
MEASURED_SHARE = 0.25
# of the emergency stop
SCATTER = 0.2  # share of the coasting deceleration, up or down: friction varies along the rail
INPUT_SPREAD = 0.005  # s, maximum time between the quick-stop inputs of three drives
RELAY_SPREAD = 0.01  # s, maximum time between their STO inputs


# number of speeds in the search; twice as many change the distance by 0.1 mm
SEARCHED_SPEEDS = 41


def least_distance(
    gap: float, limits: MotionLimits, deceleration: float, delay: float
) -> float:
    """
    Return the minimum distance of neighbouring carriages that brake independently [m].

    Two neighbours always keep the distance from which all three carriages can brake together with
    `gap` left at rest. When all brake together, a carriage that moves away from its neighbour
    first reduces its acceleration at the limit of jerk. This adds a²/2j to its speed. A carriage
    that brakes independently does not do so.

    The left carriage brakes at once, the right carriage after the delay. The mirrored case has the
    same minimum. The search covers all speeds and takes the distance at rest. A pair that is
    nearest earlier, while both have a speed w, loses as much distance as a pair that is slower by
    w loses until rest.

    A carriage near its speed limit that already brakes, beside a carriage that accelerates away,
    may come nearer by up to 2.6 mm at the default limits. The reason is that a carriage that
    already brakes needs no time to begin its brake. `Separation` does not permit these speeds so
    near.

    Parameters
    ----------
    gap : float
        Minimum commanded distance [m].
    limits : MotionLimits
        Limits of the commanded motion.
    deceleration : float
        Deceleration of each carriage that brakes independently [m/s²].
    delay : float
        Delay of the right carriage's brake after that of the left [s].

    Returns
    -------
    float
        Minimum distance [m]; a value below 0 means a collision.

    """
    stops = [  # speeds, and distances from them to rest
        (speed, speed * abs(speed) / (2.0 * deceleration))
        for speed in (
            limits.speed * (2.0 * number / (SEARCHED_SPEEDS - 1) - 1.0)
            for number in range(SEARCHED_SPEEDS)
        )
    ]
    return min(
        starting_distance(gap, limits, left, right)
        + right * delay
        + right_stop
        - left_stop
        for left, left_stop in stops
        for right, right_stop in stops
    )


def starting_distance(
    gap: float, limits: MotionLimits, left: float, right: float
) -> float:
    """Return the minimum distance [m] of neighbours commanded to move at given speeds [m/s]."""
    speed, acceleration = limits.speed, limits.acceleration
    gained = 0.5 * acceleration**2 / limits.jerk
    off1, off2 = left - min(gained, speed + left), right + min(gained, speed - right)
    together = max(abs(off1), abs(off2)) / (2.0 * acceleration)
    return gap + max(0.0, (off1 - off2) * together)


SEPARATION_MARGIN = 0.001  # m, for the speed that a carriage gains before it brakes


class Separation(NamedTuple):
    """
    Maximum speed for each distance at which no carriage hits a neighbour that stops at once.

    A silent drive is detected after `silence`. A drive that still answers is detected by its
    following error, or by a measured distance below the tolerated minimum.
    """

    touching: float  #: distance at which neighbours touch [m]
    deceleration: float  #: deceleration of the weakest brake [m/s²]
    silence: float  #: time until the others brake after a drive falls silent [s]
    window: float  #: following error that is tolerated [m]
    tracking: float  #: time for which a larger following error is tolerated [s]
    tolerated: float  #: minimum measured distance that is tolerated [m]
    report: float  #: time from a smaller distance until the carriages brake [s]

    def speed(self, distance: float) -> float:
        """Return the maximum speed [m/s] of neighbouring carriages at a distance [m]."""
        seen = max(
            self._stopping_from(self.tolerated, self.report),
            self._stopping_from(distance - self.window, self.tracking),
        )
        return min(seen, self._stopping_from(distance, self.silence))

    def distance(self, speed: float) -> float:
        """Return the minimum distance [m] at which neighbours may move at a speed [m/s]."""

        def needed(delay: float) -> float:
            return (
                self.touching
                + SEPARATION_MARGIN
                + speed * delay
                + 0.5 * speed**2 / self.deceleration
            )

        is_seen = needed(self.report) <= self.tolerated
        return max(
            needed(self.silence),
            0.0 if is_seen else self.window + needed(self.tracking),
        )

    def _stopping_from(self, distance: float, delay: float) -> float:
        """Return the speed [m/s] from which a carriage stops within a distance after a delay."""
        room = max(0.0, distance - self.touching - SEPARATION_MARGIN)
        late = self.deceleration * delay
        return math.sqrt(late * late + 2.0 * self.deceleration * room) - late


class Outcome(NamedTuple):
    """Minimum distance after the worst case of a failure."""

    name: str  #: of the failure, as an operator reads it
    distance: float  #: minimum distance of two neighbours [m]
    gap: float  #: carriage_gap with which no carriage touches at the present limits [m]


class EmergencyStop(NamedTuple):
    """Minimum distances of two approaching carriages during an emergency stop."""

    speed: float  #: of both carriages [m/s]
    alone: float  #: minimum distance from a neighbour that stops at once [m]
    approach: float  #: minimum distance of two that approach each other [m]
    left_by_ss1_t: float  #: remaining distance after SS1-t [m]; below 0 they touch
    left_by_sto: float  #: the same after STO


@dataclass(frozen=True)
class StoppingAnalysis:
    """Worst case of each failure; if axes differ, the weakest value is used."""

    # a report just after one SYNC is answered after the next, and latched then
    CYCLES_TO_STOP = 2
    MIN_SPEED = 0.01  # m/s, speed that must remain possible at the minimum gap
    # maximum undetected lag of a carriage, as a share of the free distance between carriages
    WINDOW_SHARE = 0.75
    BOUND_ROUNDING = 1e-9  # m, m/s, m/s², s
    RAMP_MARGIN = 0.2  # s, until drives whose targets rest have shown that they rest
    LOAD = 0.7  # deceleration with the heaviest load, as a share of that of an empty machine
    TABLE_SPEEDS = 5  # number of speeds in the table

    geometry: Geometry
    limits: MotionLimits
    axes: tuple[AxisSettings, ...]
    controller: ControllerSettings

    @property
    def overshoot(self) -> float:
        """
        Return the maximum overshoot of a carriage beyond the stroke [m].

        The commanded motion could come to rest inside the stroke with the maximum acceleration.
        Instead, the carriage brakes from the maximum speed with the weakest brake.
        """
        planned = 0.5 * self.limits.speed**2 / self.limits.acceleration
        needed = 0.5 * self.limits.speed**2 / self.separation.deceleration
        return max(0.0, needed - planned)

    @property
    def braking_time(self) -> float:
        """
        Return the maximum duration of a ramp to rest within the limits [s].

        A carriage that may brake inside the stroke has at most the speed √(2 a · stroke). Before
        it brakes, it first ends its acceleration.
        """
        limits = self.limits
        stroke = max(axis.upper_limit - axis.lower_limit for axis in self.axes)
        speed = min(limits.speed, math.sqrt(2.0 * limits.acceleration * stroke))
        return speed / limits.acceleration + self._rounding_time

    @property
    def _rounding_time(self) -> float:
        """Return the time in which a ramp changes its acceleration at the limit of jerk [s]."""
        return 2.0 * self.limits.acceleration / self.limits.jerk

    @property
    def longest_braking(self) -> float:
        """Return the longest ramp to rest for which the group of axes waits [s]."""
        controller = self.controller
        return controller.ramp_timeout - controller.drive_lag - self.RAMP_MARGIN

    @property
    def _speed_of_longest_braking(self) -> float:
        """Return the speed from which a ramp takes as long as permitted [m/s]."""
        seconds = self.longest_braking - self._rounding_time
        # below the speed also after rounding to three digits
        return 0.99 * self.limits.acceleration * seconds

    @cached_property
    def separation(self) -> Separation:
        """Return the speed limit of the carriages as a function of their distance."""
        axes, geometry, controller = self.axes, self.geometry, self.controller
        reported = self.CYCLES_TO_STOP * controller.period + controller.drive_lag
        return Separation(
            touching=geometry.carriage_length,
            deceleration=min(axis.stop_deceleration for axis in axes),
            silence=(controller.max_missed_cycles + 1) * controller.period
            + controller.drive_lag,
            window=max(axis.following_error_window for axis in axes),
            tracking=reported + max(axis.following_error_time for axis in axes),
            tolerated=geometry.carriage_gap
            - MEASURED_SHARE * (geometry.carriage_gap - geometry.carriage_length),
            report=reported,
        )

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """Return the worst cases of all failures that `check` requires to end without contact."""
        gap, touching = self.geometry.carriage_gap, self.geometry.carriage_length
        return [
            Outcome(name, distance, gap + touching - distance)
            for name, delay in (
                ('all three brake at once', 0.0),
                (
                    'one brakes independently and reports',
                    self.CYCLES_TO_STOP * self.controller.period,
                ),
            )
            for distance in [
                least_distance(gap, self.limits, self.separation.deceleration, delay)
            ]
        ]

    def check(self) -> None:
        """
        Check that braking carriages stay apart, and that the drives fit limits and windows.

        Raises a ParameterError with the consequence of these parameters and with values that
        avoid it.
        """
        limits, axes, separation = self.limits, self.axes, self.separation
        gap, touching = self.geometry.carriage_gap, separation.touching
        for quantity, value, unit, bound_name, bound, remedy in (
            (
                'limits.speed',
                limits.speed,
                'm/s',
                'axes.max_speed',
                min(axis.max_speed for axis in axes),
                'reduce limits.speed',
            ),
            (
                'limits.acceleration',
                limits.acceleration,
                'm/s^2',
                'axes.max_acceleration',
                min(axis.max_acceleration for axis in axes),
                'reduce limits.acceleration',
            ),
            (
                'the time to brake from limits.speed',
                self.braking_time,
                's',
                'the longest ramp of halt and deactivate',
                self.longest_braking,
                'increase limits.acceleration, or reduce limits.speed to at most '
                f'{self._speed_of_longest_braking:.3g} m/s',
            ),
            (
                'limits.speed x controller.drive_lag',
                limits.speed * self.controller.drive_lag,
                'm',
                'axes.following_error_window',
                min(axis.following_error_window for axis in axes),
                'reduce limits.speed, at which the drives would trip',
            ),
            (
                'the overshoot of a carriage beyond the stroke',
                self.overshoot,
                'm',
                'the limit of its drive',
                min(axis.limit_margin for axis in axes),
                f'increase axes.stop_deceleration = {separation.deceleration:g} m/s^2 to at least '
                f'limits.acceleration = {limits.acceleration:g} m/s^2',
            ),
            (
                'axes.following_error_window',
                separation.window,
                'm',
                f'{self.WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length',
                self.WINDOW_SHARE * (gap - touching),
                'reduce axes.following_error_window',
            ),
            (
                'the speed that must remain for carriages at geometry.carriage_gap',
                self.MIN_SPEED,
                'm/s',
                'the speed at which a stopped neighbour is not hit',
                separation.speed(gap),
                'increase geometry.carriage_gap to at least '
                f'{separation.distance(self.MIN_SPEED):.3g} m',
            ),
            *(
                (
                    'geometry.carriage_length',
                    touching,
                    'm',
                    f'the minimum distance of neighbours if {one.name}',
                    one.distance,
                    f'increase geometry.carriage_gap to at least {one.gap:.3g} m, '
                    'axes.stop_deceleration or limits.jerk, or reduce limits.speed',
                )
                for one in self.outcomes
            ),
        ):
            if value > bound + self.BOUND_ROUNDING:
                value_text, bound_text = compared(value, bound, '.3g', 3)
                raise ParameterError(
                    f'{quantity} = {value_text} {unit} is above {bound_name} = '
                    f'{bound_text} {unit}; next: {remedy}'
                )

    def table(self, coasting: float) -> list[EmergencyStop]:
        """
        Return the distances that remain after emergency stops, at five speeds up to the limit.

        Without power (STO, stop category 0) carriages coast with a mean deceleration [m/s²]. With
        SS1-t (stop category 1) all drives brake through their quick-stop inputs before they lose
        power.
        """
        braking = self.LOAD * self.separation.deceleration
        slowest_coasting = (1.0 - SCATTER) * coasting
        rows = []
        for number in range(1, self.TABLE_SPEEDS + 1):
            speed = self.limits.speed * number / self.TABLE_SPEEDS
            rows.append(
                EmergencyStop(
                    speed,
                    self.separation.distance(speed),
                    self._approach(speed),
                    self.remaining(speed, INPUT_SPREAD, braking),
                    self.remaining(speed, RELAY_SPREAD, slowest_coasting),
                )
            )
        return rows

    @property
    def sto_delay(self) -> float:
        """Return the time from quick-stop input to STO [s], enough to stop the heaviest load."""
        slowest = self.limits.speed / (self.LOAD * self.separation.deceleration)
        delay = slowest + self.controller.drive_lag + INPUT_SPREAD
        return math.ceil(100.0 * delay) / 100.0

    def remaining(self, speed: float, spread: float, deceleration: float) -> float:
        """
        Return the distance [m] that remains when two approaching carriages stop.

        The carriages start at the minimum distance at which the driver lets them approach each
        other with the speed [m/s]. The carriages brake with a deceleration [m/s²] after the lag of
        the drives and the spread of their inputs [s].
        """
        delay = self.controller.drive_lag + spread
        travelled = speed * (2.0 * delay + speed / deceleration)
        return self._approach(speed) - self.geometry.carriage_length - travelled

    def _approach(self, speed: float) -> float:
        """Return the minimum distance [m] of two carriages that approach at one speed [m/s]."""
        together = starting_distance(
            self.geometry.carriage_gap, self.limits, speed, -speed
        )
        return max(self.separation.distance(speed), together)
