"""
Whether the carriages stop apart with the parameters at hand: which failures, how late, how near.

The neighbours on the rail are A1, A3, A2. Where one of two fails the other goes on until that is
found. Failures in which every drive brakes must leave the carriages apart, else the driver does
not start. A carriage that stands dead, as on a screw that seizes, is met by no brake in time: for
those the analysis says up to which speed, or with which gap, they end well.
"""

from __future__ import annotations

from dataclasses import replace
import math
from typing import NamedTuple

from facade_manipulator.drives.cia402 import AXIS_NAMES, AxisSettings
from facade_manipulator.drives.controller import ControllerSettings
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion import (
    Brake,
    highest_speed,
    least_distance,
    MEASURED_SHARE,
    MotionLimits,
    overshoot,
)

NEIGHBOURS = ((0, 2), (2, 1))  # on the rail stand A1, A3, A2
CYCLES_TO_STOP = 2  # what just misses one SYNC is answered after the next, and latched then
WINDOW_SHARE = 0.75  # of what keeps carriages from touching, at most, may one lag unnoticed
ROUNDING = 1e-9  # m


class Failure(NamedTuple):
    """
    What may happen to one of the three.

    Attributes
    ----------
    name : str
        As an operator reads it.
    delay : float
        How long the others go on [s].
    brakes : bool
        Whether the carriage that fails brakes on its drive's ramp; else it stands dead.
    unnoticed : float
        Share of what keeps carriages from touching that is gone before anybody notices.

    """

    name: str
    delay: float
    brakes: bool
    unnoticed: float = 0.0


class Outcome(NamedTuple):
    """
    How a failure ends at worst.

    Attributes
    ----------
    name : str
    distance : float
        Least distance of two neighbours [m].
    speed : float
        Limit of speed up to which nothing touches [m/s].
    gap : float
        carriage_gap with which nothing would touch at the present limits [m].

    """

    name: str
    distance: float
    speed: float
    gap: float


class StoppingAnalysis:
    """
    The worst that each failure may do to the three carriages.

    Parameters
    ----------
    geometry : Geometry
    limits : MotionLimits
    axes : tuple of AxisSettings
        q1, q2, q3.
    controller : ControllerSettings

    """

    def __init__(
        self, geometry: Geometry, limits: MotionLimits, axes: tuple[AxisSettings, ...],
        controller: ControllerSettings,
    ) -> None:
        self._geometry = geometry
        self._limits = limits
        self._axes = axes
        self._lag = controller.drive_lag
        reported, silent = (
            cycles * controller.period for cycles in (
                CYCLES_TO_STOP, controller.max_missed_cycles))
        self._free = geometry.carriage_gap - geometry.carriage_length
        self._kept = (
            Failure('all three brake at once', 0.0, True),
            Failure('one brakes by itself and reports it', reported, True),
        )
        self._seizures = (
            Failure('one stands dead and reports it', reported, False),
            Failure('one stands dead and the measured gap shows it', reported, False,
                    MEASURED_SHARE),
            Failure('one loses the bus and stays at its last target', silent, False),
            Failure('one stands dead and falls silent', silent + controller.period, False),
        )

    @property
    def outcomes(self) -> list[Outcome]:
        """Failures that must end well; `check` rejects parameters with which they do not."""
        return [self._outcome(failure) for failure in self._kept]

    @property
    def seizures(self) -> list[Outcome]:
        """Failures that end well up to a speed alone."""
        return [self._outcome(failure) for failure in self._seizures]

    @property
    def overshoots(self) -> list[float]:
        """How far beyond the stroke each carriage may stop [m]."""
        return [
            overshoot(self._limits.speed, self._limits.acceleration, axis.stop_deceleration)
            for axis in self._axes]

    def check(self) -> None:
        """
        Check that carriages whose drives brake keep apart and inside the drives' own limits.

        Raises
        ------
        ParameterError
            What would happen with these parameters, and with which others it would not.

        """
        self._check_drives()
        self._check_windows()
        for name, axis, beyond in zip(AXIS_NAMES, self._axes, self.overshoots, strict=True):
            if beyond > axis.limit_margin + ROUNDING:
                raise ParameterError(
                    f'{name} could stop {beyond:.4g} m beyond the stroke, {name}.limit_margin is '
                    f'{axis.limit_margin:g} m: choose a {name}.stop_deceleration (now '
                    f'{axis.stop_deceleration:g} m/s^2) of at least limits.acceleration = '
                    f'{self._limits.acceleration:g} m/s^2')
        for failure in self._kept:
            if not self._ends_well(failure, self._limits.speed):
                raise ParameterError(self._collision(failure))

    def _check_drives(self) -> None:
        """Reject what the drives, configured with limits of their own, would not follow."""
        for name, axis in zip(AXIS_NAMES, self._axes, strict=True):
            for what, unit in (('speed', 'm/s'), ('acceleration', 'm/s^2')):
                value, bound = getattr(self._limits, what), getattr(axis, f'max_{what}')
                if value > bound:
                    raise ParameterError(
                        f'limits.{what} = {value:g} {unit} is above {name}.max_{what} = '
                        f'{bound:g} {unit}')

    def _check_windows(self) -> None:
        widest = WINDOW_SHARE * self._free
        lag = self._limits.speed * self._lag
        for name, axis in zip(AXIS_NAMES, self._axes, strict=True):
            window = axis.following_error_window
            if window > widest + ROUNDING:
                raise ParameterError(
                    f'{name}.following_error_window = {window:g} m is above {widest:g} m, '
                    f'{WINDOW_SHARE:g} of geometry.carriage_gap less carriage_length: a carriage '
                    'so far behind would touch its neighbour while it stops')
            if window < lag:
                raise ParameterError(
                    f'{name}.following_error_window = {window:g} m is below limits.speed x '
                    f'controller.drive_lag = {lag:g} m: it would trip at full speed')

    def _collision(self, failure: Failure) -> str:
        outcome = self._outcome(failure)
        advice = [f'geometry.carriage_gap of at least {outcome.gap:.3g} m',
                  f'limits.speed of at most {outcome.speed:.3g} m/s']
        brake = 2.0 * self._limits.acceleration
        if min(axis.stop_deceleration for axis in self._axes) < brake:
            advice.append(f'stop_deceleration of all axes of at least {brake:g} m/s^2 (twice '
                          'limits.acceleration)')
        return (
            f'if {failure.name}, neighbouring carriages could come as near as '
            f'{outcome.distance:.3g} m, and touch at {self._geometry.carriage_length:g} m: choose '
            f'a {", or a ".join(advice)}')

    def _outcome(self, failure: Failure) -> Outcome:
        distance = self._distance(failure, self._limits.speed)
        speed = highest_speed(
            lambda speed: self._ends_well(failure, speed), self._limits.speed)
        lacking = self._geometry.carriage_length - distance
        needed = self._geometry.carriage_gap + lacking / (1.0 - failure.unnoticed)
        return Outcome(failure.name, distance, speed, needed)

    def _ends_well(self, failure: Failure, speed: float) -> bool:
        return self._distance(failure, speed) >= self._geometry.carriage_length - ROUNDING

    def _distance(self, failure: Failure, speed: float) -> float:
        """Return the least distance of two neighbours of which either one fails [m]."""
        limits = replace(self._limits, speed=speed)
        delay = failure.delay + failure.unnoticed * self._free / speed

        def brake(number: int, failing: int) -> Brake:
            ramp = self._axes[number].stop_deceleration
            if number != failing:
                return Brake(delay, ramp)
            return Brake(0.0, ramp if failure.brakes else math.inf)

        return min(
            least_distance(
                self._geometry.carriage_gap, limits, *(brake(one, failing) for one in pair))
            for pair in NEIGHBOURS for failing in pair)
