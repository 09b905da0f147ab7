"""Whether an estimate of the disturbance can be true: everything else is rejected here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
from typing import NamedTuple

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.prediction.mounting import rail_pose, turned

UNITS = ('m', 'm', 'rad')
OLDEST_ESTIMATE = 0.3  # s: an older one is stale
LARGEST = (2.0, 2.0, 0.6)  # m, m, rad: several times what the head can correct
FUTURE_TOLERANCE = 0.01  # s, lead of the estimator's clock: synchronised clocks keep within
# A change from one estimate to the next beyond this and what speed explains is a jump.
JUMP = (0.03, 0.03, 0.03)  # m, m, rad
FASTEST = 1.0  # m/s or rad/s, that a gondola moves: a real jump is accepted after a while
LEAST_NOISE = 1e-4  # m or rad, standard deviation: below it a filter would trust nothing else
OVERTAKING = 0.015  # s: an estimate may be older than the last one by less than this
LARGEST_TILT = 0.05  # rad, of the rail out of the plane; it is left out of the estimate


@settings
class EstimateSettings:
    """How noisy the estimates of the disturbance are, and of what and when they are."""

    position_noise: float = parameter(
        'Standard deviation in x and y where the message has none', default=1e-3, unit='m',
        minimum=1e-5, maximum=1.0)
    yaw_noise: float = parameter(
        'Standard deviation in yaw where the message has none', default=1.75e-3, unit='rad',
        minimum=1e-5, maximum=1.0)
    mounting: tuple[float, ...] = parameter(
        'Where the estimator is mounted on the rail: x, y, yaw', default=(0.0, 0.0, 0.0),
        unit='m, m, rad', minimum=-20.0, maximum=20.0, elements=('x', 'y', 'yaw'))
    axes: float = parameter(
        "Angle from the axes of facade to those of the estimator's x and y", default=0.0,
        unit='rad', minimum=-math.pi, maximum=math.pi)
    delay: float = parameter(
        'How much later than the motion the stamps of the estimator are', default=0.0, unit='s',
        minimum=-0.5, maximum=0.5)
    largest_deviation: tuple[float, ...] = parameter(
        'Standard deviation of an estimate beyond which its axis is not known: x, y, theta',
        default=(0.01, 0.01, 0.02), unit='m, m, rad', minimum=1e-4, maximum=1.0,
        elements=('x', 'y', 'theta'))


class Variances(NamedTuple):
    """Variances of x, y and theta [m², m², rad²]."""

    x: float
    y: float
    theta: float


ALL_KNOWN: tuple[bool, ...] = (True, True, True)


class Estimate(NamedTuple):
    """Disturbance [m, m, rad] at a stamp [s] with the variances of its noise."""

    stamp: float
    pose: Pose
    variances: Variances
    known: tuple[bool, ...] = ALL_KNOWN  #: which axes; of others it is what was known last


class EstimateGate:
    """Let the estimates through that can be true."""

    def __init__(self, settings: EstimateSettings) -> None:
        self._last: Estimate | None = None
        self._known: Estimate | None = None
        self.settings = settings
        self._mounting = Pose(*settings.mounting)
        self._noise = settings.position_noise, settings.position_noise, settings.yaw_noise

    def check(
        self, now: float, stamp: float, pose: Pose,
        variances: Sequence[float] = (0.0, 0.0, 0.0), tilt: float = 0.0,
    ) -> Estimate:
        """
        Return the estimate if it can be true.

        Parameters
        ----------
        now, stamp : float
            Present time and when the disturbance was there [s].
        pose : Pose
            [m, m, rad].
        variances : sequence of float
            Of x, y and θ; 0, negative or NaN means unknown. Beyond the largest deviation, as
            infinity is, that axis is not known: it may be found again anywhere.
        tilt : float
            Angle by which the rail is out of the plane [rad].

        Raises
        ------
        InputError
            With reason ``'not_finite'``, ``'range'``, ``'out_of_plane'``, ``'stale'``,
            ``'future'``, ``'out_of_order'`` or ``'jump'``. A jump that lasts is accepted as soon
            as the fastest gondola could have got there. An estimate that is older than the last
            one by less than 15 ms is in order.

        """
        stamp -= self.settings.delay
        known = tuple(not largest ** 2 < variance for largest, variance in zip(
            self.settings.largest_deviation, variances, strict=True))
        _check_values(pose, known)
        if tilt > LARGEST_TILT:
            raise InputError(
                'out_of_plane', f'disturbance is tilted by {tilt:.4g} rad out of the plane, bound '
                f'{LARGEST_TILT:g} rad')
        require_recent('disturbance', now - stamp, OLDEST_ESTIMATE, FUTURE_TOLERANCE)
        if self._last is not None and self._last.stamp - now > FUTURE_TOLERANCE:
            self._last = None  # the clock was set back: its stamps mean nothing any more
        if self._last is not None:
            _check_step(stamp - self._last.stamp, self._last.pose, pose, [
                now and before for now, before in zip(known, self._last.known, strict=True)])
        estimate = Estimate(
            stamp, pose, Variances(*map(_variance, variances, self._noise)), known)
        if self._last is None or stamp > self._last.stamp:
            self._last = estimate
        self._known = self._kept(self._of_rail(estimate))
        return self._known

    def _kept(self, estimate: Estimate) -> Estimate:
        """Return an estimate that rests, along axes that are not known, where these were last."""
        place = self._known.pose if self._known else ZERO_POSE
        noise = [deviation ** 2 for deviation in self._noise]

        def either(new: Sequence[float], instead: Sequence[float]) -> Iterator[float]:
            return (a if known else b for known, a, b in zip(
                estimate.known, new, instead, strict=True))

        return estimate._replace(
            pose=Pose(*either(estimate.pose, place)),
            variances=Variances(*either(estimate.variances, noise)))

    def displacement(self, place: Pose) -> Pose:
        """Return how far an estimator has moved of where it is itself, both along its axes."""
        x, y = turned(self._mounting.x, self._mounting.y, -self.settings.axes)
        return Pose(place.x - x, place.y - y, place.theta)

    def _of_rail(self, estimate: Estimate) -> Estimate:
        """Return the estimate of the rail; noise of the yaw is noise of where the rail is."""
        (x, y, _), axes = self._mounting, self.settings.axes
        along, across, yaw = estimate.variances
        mixed = math.sin(axes) ** 2 * (across - along)
        return Estimate(estimate.stamp, rail_pose(estimate.pose, self._mounting, axes), Variances(
            along + mixed + y * y * yaw, across - mixed + x * x * yaw, yaw),
            self._known_of_rail(estimate.known))

    def _known_of_rail(self, known: tuple[bool, ...]) -> tuple[bool, ...]:
        """Return which axes of the rail are known: a place beside it and turned axes mix them."""
        x, y, theta = known
        beside_x, beside_y, _ = self._mounting
        is_turned = math.sin(self.settings.axes) != 0.0
        return ((x and (theta or not beside_y)) and (y or not is_turned),
                (y and (theta or not beside_x)) and (x or not is_turned), theta)


def _check_values(pose: Pose, known: Sequence[bool]) -> None:
    """Reject what is not finite, or beyond where a gondola can be along axes that are known."""
    for name, value, bound, unit, is_known in zip(
            Pose._fields, pose, LARGEST, UNITS, known, strict=True):
        if not math.isfinite(value):
            raise InputError.not_finite(f'disturbance {name}', value)
        if is_known and abs(value) > bound:
            raise InputError(
                'range', f'disturbance {name} = {value:.4g} {unit} is beyond ±{bound:g} {unit}')


def _check_step(elapsed: float, before: Pose, pose: Pose, known: Sequence[bool]) -> None:
    """Reject what a gondola cannot have moved in a time [s] along the axes that are known."""
    if elapsed <= -OVERTAKING or elapsed == 0.0:
        raise InputError.out_of_order('disturbance', -elapsed)
    for name, last, value, bound, unit, is_known in zip(
            Pose._fields, before, pose, JUMP, UNITS, known, strict=True):
        change, allowed = abs(value - last), bound + FASTEST * abs(elapsed)
        if is_known and change > allowed:
            raise InputError(
                'jump', f'disturbance {name} jumps by {change:.4g} {unit} in {elapsed:.3f} s, '
                f'bound {allowed:.4g} {unit}')


def _variance(variance: float, unknown: float) -> float:
    """Return the variance to use of one that was published, by the standard deviation else."""
    return max(variance, LEAST_NOISE ** 2) if 0.0 < variance < math.inf else unknown * unknown
