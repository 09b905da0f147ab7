"""
The stopping check at start-up: whether carriages stop apart with these parameters.

The neighbours on the rail are A1, A3, A2. Where one of two fails, the other moves on until that is
detected. Failures in which every drive brakes must leave the carriages apart, else the driver does
not start. No brake avoids a carriage that stops dead, such as on a seized screw, from full speed.
Near each other, carriages are therefore slow enough to brake in time (`separation`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.braking import highest_speed, least_distance, overshoot, Separation
from facade_manipulator.motion.guard import MEASURED_SHARE
from facade_manipulator.motion.limits import MotionLimits

CYCLES_TO_STOP = 2  # a report just after one SYNC is answered after the next, and latched then
MIN_SPEED = 0.01  # m/s, that must remain for carriages at their minimum gap
WINDOW_SHARE = 0.75  # of the free distance between carriages, at most, may one lag undetected
ROUNDING = 1e-9  # m


class Outcome(NamedTuple):
    """The worst end of a failure."""

    name: str  #: of the failure, as an operator reads it
    distance: float  #: minimum distance of two neighbours [m]
    speed: float  #: limit of speed up to which no carriage touches [m/s]
    gap: float  #: carriage_gap with which no carriage touches at the present limits [m]


class StoppingAnalysis:
    """
    The worst end of each failure; of axes that differ, the weakest counts.

    `outcomes` are those of the failures that `check` requires to end well, `separation` is how
    fast carriages may be at a distance, `overshoot` how far beyond the stroke one may stop [m].
    """

    def __init__(
        self, geometry: Geometry, limits: MotionLimits, axes: tuple[AxisSettings, ...],
        controller: ControllerSettings,
    ) -> None:
        self.geometry, self.limits, self.controller = geometry, limits, controller
        self.axes = axes
        self._deceleration = min(axis.stop_deceleration for axis in axes)
        self._window = max(axis.following_error_window for axis in axes)
        self._reported = reported = CYCLES_TO_STOP * controller.period
        lag = controller.drive_lag
        self.overshoot = overshoot(limits.speed, limits.acceleration, self._deceleration)
        self.separation = Separation(
            touching=geometry.carriage_length, deceleration=self._deceleration,
            silence=(controller.max_missed_cycles + 1) * controller.period + lag,
            window=self._window,
            tracking=reported + max(axis.following_error_time for axis in axes) + lag,
            tolerated=geometry.carriage_gap - MEASURED_SHARE * (
                geometry.carriage_gap - geometry.carriage_length),
            report=reported + lag)

    @cached_property
    def outcomes(self) -> list[Outcome]:
        """The outcomes by the time [s] from the failure until the other carriages brake."""
        return [self._outcome('all three brake at once', 0.0),
                self._outcome('one brakes by itself and reports it', self._reported)]

    def check(self) -> None:
        """
        Check that carriages whose drives brake keep apart and inside the drives' own limits.

        Raises a ParameterError with the consequence of these parameters and with values that
        avoid it.
        """
        for contradiction in (*self._beyond_drives(), *self._collisions()):
            raise ParameterError(contradiction)

    def _beyond_drives(self) -> list[str]:
        """Return the limits that the drives would not follow, or within which they would trip."""
        limits, axes, window = self.limits, self.axes, self._window
        fastest = min(axis.max_speed for axis in axes)
        strongest = min(axis.max_acceleration for axis in axes)
        margin = min(axis.limit_margin for axis in axes)
        lag = limits.speed * self.controller.drive_lag
        return [message for is_beyond, message in (
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
             f'at {margin:g} m: choose an axes.stop_deceleration (now {self._deceleration:g} '
             f'm/s^2) of at least limits.acceleration = {limits.acceleration:g} m/s^2'),
        ) if is_beyond]

    def _collisions(self) -> list[str]:
        """Return the collisions that are possible, each with the values that avoid it."""
        gap, touching = self.geometry.carriage_gap, self.geometry.carriage_length
        widest, slowest = WINDOW_SHARE * (gap - touching), self.separation.speed(gap)
        brake = 2.0 * self.limits.acceleration
        harder = (f', or an axes.stop_deceleration of at least {brake:g} m/s^2 (twice '
                  'limits.acceleration)' if self._deceleration < brake else '')
        return [message for is_possible, message in (
            (self._window > widest + ROUNDING,
             f'axes.following_error_window = {self._window:g} m is above {widest:g} m, '
             f'{WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length: a carriage '
             'so far behind would touch its neighbour while it stops'),
            (slowest < MIN_SPEED,
             f'carriages at geometry.carriage_gap = {gap:g} m could move at {slowest:.2g} m/s, so '
             'that none meets one that stands dead: choose a gap of at least '
             f'{self.separation.distance(MIN_SPEED):.3g} m'),
            *((one.distance < touching - ROUNDING,
               f'if {one.name}, neighbouring carriages could come as near as '
               f'{one.distance:.3g} m, and touch at {touching:g} m: choose a '
               f'geometry.carriage_gap of at least {one.gap:.3g} m, or a limits.speed of at '
               f'most {one.speed:.3g} m/s{harder}') for one in self.outcomes),
        ) if is_possible]

    def _outcome(self, name: str, delay: float) -> Outcome:
        gap, touching = self.geometry.carriage_gap, self.geometry.carriage_length

        def distance(speed: float) -> float:
            return least_distance(
                gap, replace(self.limits, speed=speed), self._deceleration, delay)

        found = distance(self.limits.speed)
        safe = highest_speed(
            lambda speed: distance(speed) >= touching - ROUNDING, self.limits.speed)
        return Outcome(name, found, safe, gap + touching - found)
