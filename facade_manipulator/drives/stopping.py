"""
The start-up stopping check: whether carriages stop apart with the parameters at hand.

The neighbours on the rail are A1, A3, A2. Where one of two fails, the other moves on until that is
detected. Failures in which every drive brakes must leave the carriages apart, else the driver does
not start. No brake avoids a carriage that stands dead, as on a screw that seizes, from full speed:
near each other, carriages are so slow that it does (`separation`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.braking import Brake, highest_speed, least_distance, overshoot
from facade_manipulator.motion.guard import MEASURED_SHARE
from facade_manipulator.motion.limits import MotionLimits, Separation

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
    """The worst end of each failure; of axes that differ, the weakest counts."""

    def __init__(
        self, geometry: Geometry, limits: MotionLimits, axes: tuple[AxisSettings, ...],
        controller: ControllerSettings,
    ) -> None:
        self.geometry = geometry
        self.limits = limits
        self.controller = controller
        self._axes = axes
        self._deceleration = min(axis.stop_deceleration for axis in axes)
        self._window = max(axis.following_error_window for axis in axes)
        lag, reported = controller.drive_lag, CYCLES_TO_STOP * controller.period
        #: s, from a failure until the other carriages brake
        self._delays = {
            'all three brake at once': 0.0, 'one brakes by itself and reports it': reported}
        #: how fast carriages may be at a distance
        self.separation = Separation(
            touching=geometry.carriage_length, deceleration=self._deceleration,
            silence=(controller.max_missed_cycles + 1) * controller.period + lag,
            window=self._window,
            tracking=reported + max(axis.following_error_time for axis in axes) + lag,
            tolerated=geometry.carriage_gap - MEASURED_SHARE * (
                geometry.carriage_gap - geometry.carriage_length),
            report=reported + lag)

    @property
    def outcomes(self) -> list[Outcome]:
        """Return the outcome of each failure, which `check` requires to end well."""
        return [self._outcome(*one) for one in self._delays.items()]

    @property
    def overshoot(self) -> float:
        """Return how far beyond the stroke a carriage may stop [m]."""
        return overshoot(self.limits.speed, self.limits.acceleration, self._deceleration)

    def check(self) -> None:
        """
        Check that carriages whose drives brake keep apart and inside the drives' own limits.

        Raises a ParameterError with the consequence of these parameters and with values that
        avoid it.
        """
        for contradiction in (*self._beyond_drives(), *self._collisions()):
            raise ParameterError(contradiction)

    def _beyond_drives(self) -> Iterator[str]:
        """Yield the limits that the drives would not follow, or within which they would trip."""
        limits = self.limits
        for name, unit in (('speed', 'm/s'), ('acceleration', 'm/s^2')):
            value = getattr(limits, name)
            bound = min(getattr(axis, f'max_{name}') for axis in self._axes)
            if value > bound:
                yield (f'limits.{name} = {value:g} {unit} is above axes.max_{name} = {bound:g} '
                       f'{unit}')
        lag = limits.speed * self.controller.drive_lag
        if min(axis.following_error_window for axis in self._axes) < lag:
            yield (
                f'axes.following_error_window = {self._window:g} m is below limits.speed x '
                f'controller.drive_lag = {lag:g} m: it would trip at full speed')
        margin = min(axis.limit_margin for axis in self._axes)
        if self.overshoot > margin + ROUNDING:
            yield (
                f'a carriage could stop {self.overshoot:.4g} m beyond the stroke, its drive stops '
                f'at {margin:g} m: choose an axes.stop_deceleration (now {self._deceleration:g} '
                f'm/s^2) of at least limits.acceleration = {limits.acceleration:g} m/s^2')

    def _collisions(self) -> Iterator[str]:
        """Yield the collisions that are possible, each with the values that avoid it."""
        widest = WINDOW_SHARE * (self.geometry.carriage_gap - self.geometry.carriage_length)
        if self._window > widest + ROUNDING:
            yield (
                f'axes.following_error_window = {self._window:g} m is above {widest:g} m, '
                f'{WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length: a carriage '
                'so far behind would touch its neighbour while it stops')
        slowest = self.separation.speed(self.geometry.carriage_gap)
        if slowest < MIN_SPEED:
            yield (
                f'carriages at geometry.carriage_gap = {self.geometry.carriage_gap:g} m could '
                f'move at {slowest:.2g} m/s, so that none meets one that stands dead: choose a '
                f'gap of at least {self.separation.distance(MIN_SPEED):.3g} m')
        brake = 2.0 * self.limits.acceleration
        harder = (f', or an axes.stop_deceleration of at least {brake:g} m/s^2 (twice '
                  'limits.acceleration)' if self._deceleration < brake else '')
        for one in self.outcomes:
            if one.distance < self.geometry.carriage_length - ROUNDING:
                yield (
                    f'if {one.name}, neighbouring carriages could come as near as '
                    f'{one.distance:.3g} m, and touch at {self.geometry.carriage_length:g} m: '
                    f'choose a geometry.carriage_gap of at least {one.gap:.3g} m, or a '
                    f'limits.speed of at most {one.speed:.3g} m/s{harder}')

    def _outcome(self, name: str, delay: float) -> Outcome:
        gap, touching = self.geometry.carriage_gap, self.geometry.carriage_length
        failing, other = (Brake(late, self._deceleration) for late in (0.0, delay))

        def distance(speed: float) -> float:
            return least_distance(gap, replace(self.limits, speed=speed), failing, other)

        found = distance(self.limits.speed)
        safe = highest_speed(
            lambda speed: distance(speed) >= touching - ROUNDING, self.limits.speed)
        return Outcome(name, found, safe, gap + touching - found)
