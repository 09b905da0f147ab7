"""
Assignment of each measurement of a wall sensor to a level of the wall, or its rejection.

Beyond an edge, such as the edge of a mullion, all measurements of a sensor have the same offset.
An outlier gate without levels would either follow the offset or reject the sensor.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
import math

import numpy as np

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.estimation.history import Measurement
from facade_manipulator.estimation.imu_checks import (
    OLDEST_MEASUREMENT,
    SENSOR_CLOCK_TOLERANCE,
)
from facade_manipulator.estimation.rail_pose_model import WallSensor, YAW
from facade_manipulator.estimation.start import FirstMeasurements

OUTLIER = math.inf


@dataclass
class Level:
    """
    Surface at an offset [m] behind the wall plane, such as a recess or a mullion.

    The offset of a found level contains the error of the state at that time. Therefore its
    measurements reduce the variance of the state at most to the variance of the offset.
    """

    offset: float
    variance: float = 0.0  #: of the offset [m²]
    is_found: bool = False  #: by measurements, not configured

    def correct(self, rest: float, known: float, noise: float) -> None:
        """
        Correct the offset with a measurement, if the filter state is known much better.

        The rest is the measurement less its expectation at this level [m]. The variances are
        those of the expectation and of the measurement [m²].
        """
        if known < 0.5 * self.variance:
            gain = self.variance / (self.variance + known + noise)
            self.offset += gain * rest
            self.variance = max(known, (1.0 - gain) * self.variance)


class Channel:
    """Wall sensor: its levels, which the distance sensors share, and its statistics."""

    GATE = 4.0  # standard deviations; rejects 1 of 16 000 good measurements
    COASTING_GATE = 10.0  # without an IMU, because only an IMU shows a push
    # minimum distance of a new level from each known one, in standard deviations
    NEW_LEVEL = 8.0
    # m or rad, minimum between two levels; less than a mullion, more than a joint
    NEAREST = 3e-3
    # standard deviations of the noise, within which measurements agree
    AGREEMENT_TOLERANCE = 6.0
    AGREEMENT = 0.8  # share of the measurements that make a level
    LEVEL_SPAN = 0.25  # s, of these measurements; longer for a sensor below 10 Hz
    FEWEST_AGREEING = 4  # minimum number of these measurements
    # standard deviations by which a found level must fit better than a configured one: only the
    # expectation after a long outage is so uncertain that both fit
    PREFERENCE = 2.0
    MOST = 12  # levels that are kept
    LARGEST = 20.0  # m or rad; a larger distance was sent in another unit

    def __init__(self, sensor: WallSensor, levels: list[Level]) -> None:
        self.sensor = sensor
        #: empty while the place of the sensor's wall or feature is unknown
        self.levels = levels
        #: whether the place is configured, or the sensor needs none
        self.is_absolute = bool(levels)
        #: of the measurements; events are in a thousandth of it
        self._unit = 'rad' if sensor.axes == (YAW,) else 'm'
        #: of measurements by 'used', 'other level', …
        self.counts: Counter[str] = Counter()
        self.period = math.nan  #: mean time between measurements [s]
        self.age = math.nan  #: mean age of measurements on arrival [s]
        #: mean normalised innovation squared; 1 if the configured noise is right
        self.square = 1.0
        self._tolerance = max(self.NEAREST, self.AGREEMENT_TOLERANCE * sensor.noise)
        self.reset()

    def reset(self) -> None:
        """Discard all measurements of the sensor."""
        self.first = FirstMeasurements()  # until the axes have started
        self.stamp = -math.inf  #: of the newest measurement [s]
        #: of the newest measurement that belonged to a level [s]
        self.fitted = -math.inf
        self.rejected_for = 0.0  #: time since then without silences [s]
        self._decided = -math.inf  # stamp of the newest measurement with a level [s]
        # stamp, residual (NaN: accepted)
        self._recent: deque[tuple[float, float]] = deque()

    def forget_place(self) -> None:
        """Forget the place of the sensor's wall or feature."""
        self.sensor.forget_place()
        self.levels.clear()
        self._recent.clear()

    def receive(self, now: float, stamp: float, value: float) -> float:
        """Return the time of measurement [s]; raise an InputError if it is invalid."""
        sensor = self.sensor
        if not math.isfinite(value):
            raise InputError.not_finite(sensor.name, value)
        if abs(value) > self.LARGEST:
            unit_name = 'metres' if self._unit == 'm' else 'radians'
            raise InputError(
                'unit',
                f'{sensor.name} rejected: {value:.4g} {self._unit} is beyond the '
                f'limit {self.LARGEST:g} {self._unit}; next: publish it in {unit_name}',
            )
        stamp -= sensor.delay
        require_recent(
            sensor.name, now - stamp, OLDEST_MEASUREMENT, SENSOR_CLOCK_TOLERANCE
        )
        if stamp <= self.stamp:
            raise InputError.out_of_order(sensor.name, self.stamp - stamp)
        self.period = _mean(self.period, stamp - self.stamp)
        self.age = _mean(self.age, now - stamp)
        self.stamp = stamp
        return stamp

    def decide(
        self,
        measurement: Measurement,
        residual: float,
        deviation: float,
        is_coasting: bool,
    ) -> str:
        """
        Assign a measurement to a level of the wall; return an event, if any.

        The residual and its standard deviation are in m or rad.
        Outliers that agree for a quarter of a second become a new level if they are far from all
        known levels. Otherwise the estimate is wrong, and `spread` increases its variance.
        """
        known = max(deviation**2 - measurement.variance, 0.0)  # variance by the state
        if not self.levels:
            return self._place_feature(measurement, residual, known)
        stamp = measurement.stamp
        level = self._nearest_level(residual, deviation)
        rest = residual - level.offset
        deviation = math.sqrt(deviation**2 + level.variance)
        gate = self.COASTING_GATE if is_coasting else self.GATE
        fits = abs(rest) <= gate * deviation
        elapsed = stamp - self._decided
        self._decided = stamp
        self._remember(stamp, math.nan if fits else residual)

        if fits:
            event = self._return_event(stamp, level, known)
            self.counts['used' if level is self.levels[0] else 'other level'] += 1
            self.accept(stamp)
            self.square = _mean(self.square, (rest / deviation) ** 2)
            measurement.level = level.offset
            measurement.level_variance = level.variance
            level.correct(rest, known, measurement.variance)
            return event

        self.counts['outlier'] += 1
        if elapsed <= self.LEVEL_SPAN:
            self.rejected_for += elapsed
        measurement.level = OUTLIER
        agreed = self._agreed_residual()
        if agreed is None:
            return ''
        self._recent.clear()
        distance = min(abs(agreed - one.offset) for one in self.levels)
        if distance <= max(self._tolerance, self.NEW_LEVEL * deviation):
            measurement.spread = distance
            return (
                'measurements agree with each other, '
                f'{1e3 * distance:.1f} m{self._unit} off the estimate'
            )
        self._add_level(measurement, agreed, known)
        return f'new level at {1e3 * agreed:+.1f} m{self._unit}'

    def _place_feature(
        self, measurement: Measurement, residual: float, known: float
    ) -> str:
        """
        Find the place of a feature from measurements that agree; return the event, if any.

        The residual [m] is measured from place 0 of the wall. The expectation has the given
        variance [m²].
        """
        self._remember(measurement.stamp, residual)
        self.counts['unknown feature'] += 1
        measurement.level = OUTLIER
        agreed = self._agreed_residual()
        if agreed is None:
            return ''
        self._recent.clear()
        self._add_level(measurement, agreed, known)
        return f'feature found at {1e3 * agreed:+.1f} mm'

    def _remember(self, stamp: float, residual: float) -> None:
        """Store a residual [m or rad], NaN if accepted, and forget those before `LEVEL_SPAN`."""
        self._recent.append((stamp, residual))
        while (
            len(self._recent) > self.FEWEST_AGREEING
            and stamp - self._recent[0][0] > self.LEVEL_SPAN * 1.2
        ):
            self._recent.popleft()

    def _nearest_level(self, residual: float, deviation: float) -> Level:
        """Return the level nearest to a residual; prefer configured levels."""

        def cost(level: Level) -> float:
            handicap = self.PREFERENCE * deviation if level.is_found else 0.0
            return abs(residual - level.offset) + handicap

        return min(self.levels, key=cost)

    def _return_event(self, stamp: float, level: Level, known: float) -> str:
        """
        Return an event for the first measurement after an outage if its level is a guess.

        The level is a guess if the expectation, of the given variance [m²], leaves room for an
        unknown level, and if the level makes the expectation more certain.
        """
        silence = stamp - self.fitted
        if silence <= self.LEVEL_SPAN or known - level.variance <= self.NEAREST**2:
            return ''
        return (
            f'measuring again after {silence:.2f} s: the place of the wall is assumed '
            f'at {1e3 * level.offset:+.1f} m{self._unit}, from an estimate '
            f'with a deviation of {1e3 * math.sqrt(known):.1f} m{self._unit}'
        )

    def accept(self, stamp: float) -> None:
        """Record that a measurement is assigned to a level or starts an axis, at a stamp [s]."""
        self.fitted = stamp
        self.rejected_for = 0.0

    def _add_level(self, measurement: Measurement, offset: float, known: float) -> None:
        """
        Add the level of a measurement; remove the oldest found level if there are too many.

        The offset [m] contains the error of the state, of the given variance [m²].
        """
        variance = known + measurement.variance / self.FEWEST_AGREEING
        level = Level(offset, variance, is_found=True)
        measurement.level = level.offset
        measurement.level_variance = level.variance
        self.accept(measurement.stamp)
        self.levels.append(level)
        if len(self.levels) > self.MOST:
            found = [one for one in self.levels if one.is_found]
            self.levels.remove(found[0])

    def _agreed_residual(self) -> float | None:
        """Return the residual common to nearly all recent measurements; None if they disagree."""
        stamps, residuals = np.transpose(self._recent)
        if len(stamps) < self.FEWEST_AGREEING or np.ptp(stamps) < 0.8 * self.LEVEL_SPAN:
            return None
        if np.isnan(residuals).mean() > 1.0 - self.AGREEMENT:
            return None
        middle = float(np.nanmedian(residuals))
        is_close = np.abs(residuals - middle) <= self._tolerance
        return middle if is_close.mean() >= self.AGREEMENT else None


# weight of a new measurement in running means: about the last 50 count
MEAN_WEIGHT = 0.02


def _mean(mean: float, value: float) -> float:
    """Return the running mean updated with a value; a mean of NaN is replaced by the value."""
    return mean + MEAN_WEIGHT * (value - mean) if math.isfinite(mean) else value
