"""
Whether the carriages stop apart with the parameters at hand: which failures, how late, how near.

The neighbours on the rail are A1, A3, A2. Where one of two fails the other goes on until that is
found. Failures in which every drive brakes must leave the carriages apart, else the driver does
not start. A carriage that stands dead, as on a screw that seizes, is met by no brake from full
speed: near each other carriages are so slow that one is (`separation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings, read_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.braking import (
    Brake,
    highest_speed,
    least_distance,
    overshoot,
    starting_distances,
)
from facade_manipulator.motion.guard import MEASURED_SHARE
from facade_manipulator.motion.limits import MotionLimits, Separation
from facade_manipulator.parameters import read_parameters, settings_from

NEIGHBOURS = ((0, 2), (2, 1))  # on the rail stand A1, A3, A2
CYCLES_TO_STOP = 2  # what just misses one SYNC is answered after the next, and latched then
LEAST_SPEED = 0.01  # m/s, that must be left to carriages at their least gap
WINDOW_SHARE = 0.75  # of what keeps carriages from touching, at most, may one lag unnoticed
ROUNDING = 1e-9  # m


class Failure(NamedTuple):
    """What may happen to one of the three."""

    name: str  #: as an operator reads it
    delay: float  #: how long the others go on [s]


class Outcome(NamedTuple):
    """How a failure ends at worst."""

    name: str
    distance: float  #: least distance of two neighbours [m]
    speed: float  #: limit of speed up to which nothing touches [m/s]
    gap: float  #: carriage_gap with which nothing would touch at the present limits [m]


class StoppingAnalysis:
    """The worst that each failure may do to the three carriages, whose axes are q1, q2, q3."""

    def __init__(
        self, geometry: Geometry, limits: MotionLimits, axes: tuple[AxisSettings, ...],
        controller: ControllerSettings,
    ) -> None:
        self.geometry = geometry
        self.limits = limits
        self.controller = controller
        self._axes = axes
        self._lag = controller.drive_lag
        self._free = geometry.carriage_gap - geometry.carriage_length
        reported = CYCLES_TO_STOP * controller.period
        self._failures = (
            Failure('all three brake at once', 0.0),
            Failure('one brakes by itself and reports it', reported),
        )
        #: how fast carriages may be at a distance
        self.separation = Separation(
            touching=geometry.carriage_length,
            deceleration=min(axis.stop_deceleration for axis in axes),
            silence=(controller.max_missed_cycles + 1) * controller.period + self._lag,
            window=max(axis.following_error_window for axis in axes),
            tracking=reported + max(axis.following_error_time for axis in axes) + self._lag,
            tolerated=geometry.carriage_gap - MEASURED_SHARE * self._free,
            report=reported + self._lag)

    @property
    def outcomes(self) -> list[Outcome]:
        """How the failures end, which `check` requires to end well."""
        return [self._outcome(failure) for failure in self._failures]

    @property
    def overshoots(self) -> list[float]:
        """How far beyond the stroke each carriage may stop [m]."""
        return [
            overshoot(self.limits.speed, self.limits.acceleration, axis.stop_deceleration)
            for axis in self._axes]

    def remaining(self, speed: float, spread: float, deceleration: float) -> float:
        """
        Return the distance left between two carriages that run towards each other and stop [m].

        They are as near as the driver allows at the speed [m/s], and stop after the lag of the
        drives and a spread of their inputs [s] with a deceleration [m/s²].
        """
        start = max(self.separation.distance(speed), float(starting_distances(
            self.geometry.carriage_gap, self.limits, np.array(speed), np.array(-speed))))
        delay = self._lag + spread
        return start - self.geometry.carriage_length - speed * (
            2.0 * delay + speed / deceleration)

    def check(self) -> None:
        """
        Check that carriages whose drives brake keep apart and inside the drives' own limits.

        Raises a ParameterError with what would happen with these parameters, and with which
        others it would not.
        """
        self._check_drives()
        self._check_windows()
        for name, axis, beyond in zip(AXIS_NAMES, self._axes, self.overshoots, strict=True):
            if beyond > axis.limit_margin + ROUNDING:
                raise ParameterError(
                    f'{name} could stop {beyond:.4g} m beyond the stroke, the drive stops at '
                    f'{axis.limit_margin:g} m: choose an axes.stop_deceleration (now '
                    f'{axis.stop_deceleration:g} m/s^2) of at least limits.acceleration = '
                    f'{self.limits.acceleration:g} m/s^2')
        slowest = self.separation.speed(self.geometry.carriage_gap)
        if slowest < LEAST_SPEED:
            raise ParameterError(
                f'carriages at geometry.carriage_gap = {self.geometry.carriage_gap:g} m could '
                f'move at {slowest:.2g} m/s, so that none meets one that stands dead: choose a '
                f'gap of at least {self.separation.distance(LEAST_SPEED):.3g} m')
        for failure in self._failures:
            if not self._ends_well(failure, self.limits.speed):
                raise ParameterError(self._collision(failure))

    def _check_drives(self) -> None:
        """Reject what the drives, configured with limits of their own, would not follow."""
        for axis in self._axes:
            for what, unit in (('speed', 'm/s'), ('acceleration', 'm/s^2')):
                value, bound = getattr(self.limits, what), getattr(axis, f'max_{what}')
                if value > bound:
                    raise ParameterError(
                        f'limits.{what} = {value:g} {unit} is above axes.max_{what} = '
                        f'{bound:g} {unit}')

    def _check_windows(self) -> None:
        widest = WINDOW_SHARE * self._free
        lag = self.limits.speed * self._lag
        for axis in self._axes:
            window = axis.following_error_window
            if window > widest + ROUNDING:
                raise ParameterError(
                    f'axes.following_error_window = {window:g} m is above {widest:g} m, '
                    f'{WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length: a carriage '
                    'so far behind would touch its neighbour while it stops')
            if window < lag:
                raise ParameterError(
                    f'axes.following_error_window = {window:g} m is below limits.speed x '
                    f'controller.drive_lag = {lag:g} m: it would trip at full speed')

    def _collision(self, failure: Failure) -> str:
        outcome = self._outcome(failure)
        advice = [f'geometry.carriage_gap of at least {outcome.gap:.3g} m',
                  f'limits.speed of at most {outcome.speed:.3g} m/s']
        brake = 2.0 * self.limits.acceleration
        if min(axis.stop_deceleration for axis in self._axes) < brake:
            advice.append(f'axes.stop_deceleration of at least {brake:g} m/s^2 (twice '
                          'limits.acceleration)')
        return (
            f'if {failure.name}, neighbouring carriages could come as near as '
            f'{outcome.distance:.3g} m, and touch at {self.geometry.carriage_length:g} m: choose '
            f'a {", or a ".join(advice)}')

    def _outcome(self, failure: Failure) -> Outcome:
        distance = self._distance(failure, self.limits.speed)
        speed = highest_speed(
            lambda speed: self._ends_well(failure, speed), self.limits.speed)
        lacking = self.geometry.carriage_length - distance
        return Outcome(failure.name, distance, speed, self.geometry.carriage_gap + lacking)

    def _ends_well(self, failure: Failure, speed: float) -> bool:
        return self._distance(failure, speed) >= self.geometry.carriage_length - ROUNDING

    def _distance(self, failure: Failure, speed: float) -> float:
        """Return the least distance of two neighbours of which either one fails [m]."""
        limits = replace(self.limits, speed=speed)

        def brake(number: int, failing: int) -> Brake:
            delay = 0.0 if number == failing else failure.delay
            return Brake(delay, self._axes[number].stop_deceleration)

        return min(
            least_distance(
                self.geometry.carriage_gap, limits, *(brake(one, failing) for one in pair))
            for pair in NEIGHBOURS for failing in pair)


def read_analysis(paths: Sequence[Path]) -> StoppingAnalysis:
    """Return the stopping analysis of parameter files; a ParameterError for a wrong file."""
    values = read_parameters(paths, 'driver')
    geometry = settings_from(Geometry, values, 'geometry')
    axes = read_axes(partial(settings_from, values=values), geometry.stroke)
    return StoppingAnalysis(geometry, settings_from(MotionLimits, values, 'limits'), axes,
                            settings_from(ControllerSettings, values, 'controller'))
