"""
Gate of the estimates: rejects impossible estimates, converts all others to rail poses.

An estimator at m on the rail measures its yaw and its displacement along its own axes, which are
turned from the axes of `facade` by an angle α. With the pose d of the rail, the displacement is
R(−α) (d.xy + R(d.theta) m − m). The yaw is d.theta plus the yaw of the mounting.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from operator import mul
from typing import NamedTuple

from facade_manipulator.covariance import is_measured, used_variance
from facade_manipulator.errors import (
    compared,
    compared_magnitudes,
    InputError,
    require_recent,
)
from facade_manipulator.kinematics import compose, difference, invert, Pose, ZERO_POSE
from facade_manipulator.kinematics.planar import wrap_angle
from facade_manipulator.parameters import parameter, settings

# Minimum interval between two estimates that the predictor learns from [s]: learning at 100 Hz
# would be the largest part of the processor time of the compensator. The gate accepts an estimate
# that is older than the previous estimate by less than this interval, because `Correction` does
# not learn from such an estimate.
MIN_INTERVAL = 0.015


@settings
class EstimateSettings:
    """Settings of the disturbance estimates: noise, mounting and time."""

    position_noise: float = parameter(
        'Standard deviation in x and y if the message contains none',
        default=1e-3,
        unit='m',
        minimum=1e-5,
        maximum=1.0,
    )
    yaw_noise: float = parameter(
        'Standard deviation in yaw if the message contains none',
        default=1.75e-3,
        unit='rad',
        minimum=1e-5,
        maximum=1.0,
    )
    mounting: tuple[float, ...] = parameter(
        'Mounting of the estimator on the rail: x, y, yaw',
        default=(0.0, 0.0, 0.0),
        unit='m, m, rad',
        minimum=-20.0,
        maximum=20.0,
        elements=('x', 'y', 'yaw'),
    )
    axes: float = parameter(
        'Angle from the axes of facade to the x and y axes of the estimator',
        default=0.0,
        unit='rad',
        minimum=-math.pi,
        maximum=math.pi,
    )
    delay: float = parameter(
        'Delay of the estimator stamps after the motion',
        default=0.0,
        unit='s',
        minimum=-0.5,
        maximum=0.5,
    )
    largest_deviation: tuple[float, ...] = parameter(
        'Maximum standard deviation with which an axis counts as known: x, y, theta',
        default=(0.01, 0.01, 0.02),
        unit='m, m, rad',
        minimum=1e-4,
        maximum=1.0,
        elements=('x', 'y', 'theta'),
    )


ALL_KNOWN: tuple[bool, ...] = (True, True, True)


class Estimate(NamedTuple):
    """Disturbance [m, m, rad] at a stamp [s], with its noise variances."""

    stamp: float
    pose: Pose
    variances: tuple[float, ...]  #: [m², m², rad²]
    #: axes whose pose was measured; the rail has its last known pose along the others
    known: tuple[bool, ...] = ALL_KNOWN


class EstimateGate:
    """Gate that rejects impossible estimates, and converts all others to poses of the rail."""

    OLDEST_ESTIMATE = 0.3  # s; an older estimate is stale
    # s, lead of the estimator's clock; synchronised clocks differ by less
    ESTIMATE_CLOCK_TOLERANCE = 0.01
    FASTEST_GONDOLA = 1.0  # m/s or rad/s; a gondola is slower
    # m or rad, change between two estimates in addition to FASTEST_GONDOLA
    LARGEST_JUMP = 0.03
    LARGEST_TILT = 0.05  # rad out of the plane; a smaller tilt is ignored
    # name, unit and largest displacement, which is several times the correction of the head
    DISPLACEMENT_LIMITS = (('x', 'm', 2.0), ('y', 'm', 2.0), ('theta', 'rad', 0.6))
    NO_ESTIMATE = Estimate(-math.inf, ZERO_POSE, ())  # after it any change is possible

    def __init__(self, settings: EstimateSettings) -> None:
        self.settings = settings
        # newest accepted estimate as it was received, along the axes of the estimator
        #: last received pose; its `known` are the axes of the estimator that were measured
        self._last = self.NO_ESTIMATE
        self._last_known = ZERO_POSE  # last known pose of the rail along each axis
        position = settings.position_noise
        self._noise = (position, position, settings.yaw_noise)
        self._mounting = Pose(*settings.mounting)
        self._turned_mounting = self._mounting._replace(theta=settings.axes)
        self._from_mounting = invert(self._mounting)
        cosine = _square(math.cos(settings.axes))
        sine = _square(math.sin(settings.axes))
        # squared derivatives of the rail's x, y, theta by those received
        self._squares = (
            (cosine, sine, _square(self._mounting.y)),
            (sine, cosine, _square(self._mounting.x)),
            (0.0, 0.0, 1.0),
        )

    def check(
        self,
        now: float,
        stamp: float,
        pose: Pose,
        variances: Sequence[float] = (0.0, 0.0, 0.0),
        tilt: float = 0.0,
    ) -> Estimate:
        """
        Check a received disturbance; return the estimate of the rail.

        Parameters
        ----------
        now, stamp : float
            Present time and stamp of the disturbance [s].
        pose : Pose
            Received disturbance along the axes of the estimator [m, m, rad].
        variances : sequence of float
            Variances of x, y and θ [m², m², rad²], as in `covariance`: 0 means that the noise of
            the settings applies. An axis that was not measured keeps its last known pose in the
            result, where `known` is False. Its next measurement may be anywhere.
        tilt : float
            Angle of the rail out of the plane, at least 0 [rad].

        Raises
        ------
        InputError
            The reason is ``'not_finite'``, ``'range'``, ``'out_of_plane'``, ``'stale'``,
            ``'future'``, ``'out_of_order'`` or ``'jump'``. The allowed change grows with the time
            since the last accepted estimate, so that a jump that lasts is accepted later. An
            estimate is out of order if it has the stamp of the previous estimate, or is older by
            at least `MIN_INTERVAL`.

        """
        stamp -= self.settings.delay
        for (name, _, _), value in zip(self.DISPLACEMENT_LIMITS, pose, strict=True):
            if not math.isfinite(value):
                raise InputError.not_finite(f'disturbance {name}', value)
        if tilt > self.LARGEST_TILT:
            tilt_text, limit = compared(tilt, self.LARGEST_TILT, '.4g')
            raise InputError(
                'out_of_plane',
                f'disturbance is tilted by {tilt_text} rad out of the plane, above the '
                f'limit {limit} rad; next: check the estimator',
            )

        largest = self.settings.largest_deviation
        measured = tuple(map(is_measured, variances, largest))
        place = self._of_rail(pose)
        known = measured
        if not all(measured):
            known = tuple([self._is_known(row, measured) for row in self._squares])
        self._check_range(place, known)
        require_recent(
            'disturbance',
            now - stamp,
            self.OLDEST_ESTIMATE,
            self.ESTIMATE_CLOCK_TOLERANCE,
        )
        if self._last.stamp - now > self.ESTIMATE_CLOCK_TOLERANCE:
            # the clock was set back: earlier stamps are meaningless
            self._last = self.NO_ESTIMATE
        self._check_step(stamp, pose, measured)

        received = self._received_variances(variances, measured)
        if stamp > self._last.stamp:
            self._last = Estimate(stamp, pose, received, measured)
        return self._estimate(stamp, place, received, known)

    def _received_variances(
        self, variances: Sequence[float], measured: Sequence[bool]
    ) -> tuple[float, ...]:
        """Return the variance of each received axis, from the settings if it is not measured."""
        received = []
        for variance, noise, is_axis_measured in zip(
            variances, self._noise, measured, strict=True
        ):
            used = used_variance(variance, noise) if is_axis_measured else noise**2
            received.append(used)
        return tuple(received)

    def _of_rail(self, pose: Pose) -> Pose:
        """Convert a received disturbance to the pose of the rail, with θ wrapped."""
        x, y, _ = compose(self._turned_mounting, pose)
        x, y, theta = compose(Pose(x, y, pose.theta), self._from_mounting)
        return Pose(x, y, wrap_angle(theta))

    @staticmethod
    def _is_known(squares: Sequence[float], measured: Sequence[bool]) -> bool:
        """Return whether every received axis that affects this axis of the rail was measured."""
        for square, is_axis_measured in zip(squares, measured, strict=True):
            if square and not is_axis_measured:
                return False
        return True

    @staticmethod
    def _check_range(place: Pose, known: Sequence[bool]) -> None:
        """Reject a rail pose if a known axis is outside the range of a gondola."""
        for (name, unit, largest), value, is_known in zip(
            EstimateGate.DISPLACEMENT_LIMITS, place, known, strict=True
        ):
            if is_known and not abs(value) <= largest:  # NaN after an overflow
                value_text, limit = compared_magnitudes(value, largest, '.4g')
                raise InputError(
                    'range',
                    f'disturbance {name} = {value_text} {unit} is beyond the limit '
                    f'±{limit} {unit}; next: check its unit and origin',
                )

    def _check_step(self, stamp: float, pose: Pose, measured: Sequence[bool]) -> None:
        """Reject a stamp that is out of order, or an impossible change of a measured axis."""
        last = self._last
        elapsed = stamp - last.stamp
        if elapsed <= -MIN_INTERVAL or elapsed == 0.0:
            raise InputError.out_of_order('disturbance', -elapsed)
        allowed = self.LARGEST_JUMP + self.FASTEST_GONDOLA * abs(elapsed)
        for (name, unit, _), change, was_measured, is_axis_measured in zip(
            self.DISPLACEMENT_LIMITS,
            difference(pose, last.pose),
            last.known,
            measured,
            strict=True,
        ):
            if was_measured and is_axis_measured and abs(change) > allowed:
                jump, limit = compared(abs(change), allowed, '.4g', 4)
                raise InputError(
                    'jump',
                    f'disturbance {name} jumps by {jump} {unit} in '
                    f'{elapsed:.3f} s, above the limit {limit} {unit}',
                )

    def _estimate(
        self,
        stamp: float,
        place: Pose,
        received: Sequence[float],
        known: tuple[bool, ...],
    ) -> Estimate:
        """Return the estimate of the rail, with unknown axes at rest."""
        x, y, theta = place
        last = self._last_known
        is_x_known, is_y_known, is_theta_known = known
        self._last_known = Pose(
            x if is_x_known else last.x,
            y if is_y_known else last.y,
            theta if is_theta_known else last.theta,
        )

        variances = []
        for row, noise, is_known in zip(self._squares, self._noise, known, strict=True):
            variance = sum(map(mul, row, received)) if is_known else noise**2
            variances.append(variance)
        return Estimate(stamp, self._last_known, tuple(variances), known)

    def displacement(self, place: Pose) -> Pose:
        """Return the displacement of the estimator's mounting point in its axes [m, m, rad]."""
        x, y, _ = compose(Pose(0.0, 0.0, -self.settings.axes), self._mounting)
        return Pose(place.x - x, place.y - y, place.theta)


ZERO_DERIVATIVE = 1e-9  # m or 1; a smaller derivative of the rail's pose is zero


def _square(derivative: float) -> float:
    return 0.0 if abs(derivative) < ZERO_DERIVATIVE else derivative * derivative
