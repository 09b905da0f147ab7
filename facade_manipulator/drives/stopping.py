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

CYCLES_TO_STOP = 2  # a report just after one SYNC is answered after the next, and latched then
MIN_SPEED = 0.01  # m/s, that must remain for carriages at their minimum gap
WINDOW_SHARE = 0.75  # of the free distance between carriages, at most, may one lag undetected
ROUNDING = 1e-9  # m


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
            self.limits.speed, self.limits.acceleration, self.separation.deceleration)

    @cached_property
    def separation(self) -> Separation:
        """Return the limit of the carriages' speed by their distance."""
        axes, geometry, controller = self.axes, self.geometry, self.controller
        reported = CYCLES_TO_STOP * controller.period + controller.drive_lag
        return Separation(
            touching=geometry.carriage_length,
            deceleration=min(axis.stop_deceleration for axis in axes),
            silence=(controller.max_missed_cycles + 1) * controller.period + controller.drive_lag,
            window=max(axis.following_error_window for axis in axes),
            tracking=reported + max(axis.following_error_time for axis in axes),
            tolerated=geometry.carriage_gap - MEASURED_SHARE * (
                geometry.carriage_gap - geometry.carriage_length),
            report=reported)

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """Return the outcomes of the failures that `check` requires to end without contact."""
        gap, touching = self.geometry.carriage_gap, self.geometry.carriage_length
        return [
            Outcome(name, distance, gap + touching - distance) for name, delay in (
                ('all three brake at once', 0.0),
                ('one brakes independently and reports', CYCLES_TO_STOP * self.controller.period))
            for distance in [least_distance(
                gap, self.limits, self.separation.deceleration, delay)]]

    def check(self) -> None:
        """
        Require that braking carriages stay apart and inside the position limits of the drives.

        Raises a ParameterError with the consequence of these parameters and with values that
        avoid it.
        """
        limits, axes, separation = self.limits, self.axes, self.separation
        gap, touching, window = self.geometry.carriage_gap, separation.touching, separation.window
        fastest = min(axis.max_speed for axis in axes)
        strongest = min(axis.max_acceleration for axis in axes)
        margin = min(axis.limit_margin for axis in axes)
        lag = limits.speed * self.controller.drive_lag
        widest, slowest = WINDOW_SHARE * (gap - touching), separation.speed(gap)
        for is_contradiction, message in (
            (limits.speed > fastest,
             f'limits.speed = {limits.speed:g} m/s is above axes.max_speed = {fastest:g} m/s'),
            (limits.acceleration > strongest,
             f'limits.acceleration = {limits.acceleration:g} m/s^2 is above '
             f'axes.max_acceleration = {strongest:g} m/s^2'),
            (min(axis.following_error_window for axis in axes) < lag,
             f'axes.following_error_window = {window:g} m is below limits.speed x '
             f'controller.drive_lag = {lag:g} m: it would trip at full speed'),
            (self.overshoot > margin + ROUNDING,
             f'a carriage could stop {self.overshoot:.4g} m beyond the stroke, its drive stops '
             f'at {margin:g} m: choose an axes.stop_deceleration (now '
             f'{separation.deceleration:g} m/s^2) of at least limits.acceleration = '
             f'{limits.acceleration:g} m/s^2'),
            (window > widest + ROUNDING,
             f'axes.following_error_window = {window:g} m is above {widest:g} m, '
             f'{WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length: a carriage '
             'so far behind would touch its neighbour while it stops'),
            (slowest < MIN_SPEED,
             f'carriages at geometry.carriage_gap = {gap:g} m could move at {slowest:.2g} m/s, so '
             'that a stopped neighbour is not hit: choose a gap of at least '
             f'{separation.distance(MIN_SPEED):.3g} m'),
            *((one.distance < touching - ROUNDING,
               f'if {one.name}, neighbouring carriages could come as near as {one.distance:.3g} '
               f'm, and touch at {touching:g} m: choose a geometry.carriage_gap of at least '
               f'{one.gap:.3g} m, a lower limits.speed or a higher axes.stop_deceleration')
              for one in self.outcomes),
        ):
            if is_contradiction:
                raise ParameterError(message)
