"""
Stopping check at start-up: whether carriages stop apart with these parameters.

The order on the rail is A1, A3, A2. If one of two neighbours fails, the other continues until the
failure is detected. Failures in which every drive brakes must leave the carriages apart; otherwise
the driver does not start. At full speed no brake avoids a carriage that stops at once, such as on
a seized screw. Near each other, carriages are therefore slow enough to brake in time
(`separation`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.braking import least_distance, overshoot, Separation
from facade_manipulator.motion.guard import MEASURED_SHARE
from facade_manipulator.motion.limits import MotionLimits

CYCLES_TO_STOP = (
    2  # a report just after one SYNC is answered after the next, and latched then
)
MIN_SPEED = 0.01  # m/s, that must remain for carriages at their minimum gap
WINDOW_SHARE = (
    0.75  # of the free distance between carriages, at most, may one lag undetected
)
ROUNDING = 1e-9  # m, m/s, m/s²


class Outcome(NamedTuple):
    """Worst outcome of a failure."""

    name: str  #: of the failure, as an operator reads it
    distance: float  #: minimum distance of two neighbours [m]
    gap: float  #: carriage_gap with which no carriage touches at the present limits [m]


@dataclass(frozen=True)
class StoppingAnalysis:
    """Worst outcome of each failure; of axes that differ, the weakest counts."""

    geometry: Geometry
    limits: MotionLimits
    axes: tuple[AxisSettings, ...]
    controller: ControllerSettings

    @property
    def overshoot(self) -> float:
        """Return the maximum overshoot of a carriage beyond the stroke [m]."""
        return overshoot(
            self.limits.speed, self.limits.acceleration, self.separation.deceleration
        )

    @cached_property
    def separation(self) -> Separation:
        """Return the limit of the carriages' speed by their distance."""
        axes, geometry, controller = self.axes, self.geometry, self.controller
        reported = CYCLES_TO_STOP * controller.period + controller.drive_lag
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
        """Return the outcomes of the failures that `check` requires to end without contact."""
        gap, touching = self.geometry.carriage_gap, self.geometry.carriage_length
        return [
            Outcome(name, distance, gap + touching - distance)
            for name, delay in (
                ('all three brake at once', 0.0),
                (
                    'one brakes independently and reports',
                    CYCLES_TO_STOP * self.controller.period,
                ),
            )
            for distance in [
                least_distance(gap, self.limits, self.separation.deceleration, delay)
            ]
        ]

    def check(self) -> None:
        """
        Require that braking carriages stay apart and inside the position limits of the drives.

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
                f'{WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length',
                WINDOW_SHARE * (gap - touching),
                'reduce axes.following_error_window',
            ),
            (
                'the speed that must remain for carriages at geometry.carriage_gap',
                MIN_SPEED,
                'm/s',
                'the speed at which a stopped neighbour is not hit',
                separation.speed(gap),
                'increase geometry.carriage_gap to at least '
                f'{separation.distance(MIN_SPEED):.3g} m',
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
            if value > bound + ROUNDING:
                raise ParameterError(
                    f'{quantity} = {value:.3g} {unit} is above {bound_name} = '
                    f'{bound:.3g} {unit}; next: {remedy}'
                )
