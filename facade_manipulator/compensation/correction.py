"""
Correction of the disturbance: prediction from checked estimates, with smooth fades.

Enable, disable, tare, a silent estimator and a changed prediction are events. An event changes the
target trajectory of the correction, never the correction itself. The difference then decays.
"""

from __future__ import annotations

from collections.abc import Sequence
import enum
import math

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import add, compose, invert, Pose, Twist
from facade_manipulator.kinematics.planar import (
    MotionState,
    ZERO_POSE,
    ZERO_STATE,
    ZERO_TWIST,
)
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.prediction.continuation import STAMP_ROUNDING
from facade_manipulator.prediction.estimate import ALL_KNOWN, Estimate, MIN_INTERVAL
from facade_manipulator.prediction.predictor import DisturbancePredictor
from facade_manipulator.rejections import Rejections

# s, age of the newest estimate from which the estimator counts as silent
ESTIMATOR_SILENCE = 0.5
FADE_AFTER = 1.05  # s, age from which the correction fades out; after 1.1 s learning begins again
LONGEST_PAUSE = 0.5  # s, a longer pause means that the clock was set


@settings
class CorrectionSettings:
    """Settings of the correction: initial state and fade time."""

    enabled: bool = parameter(
        'Whether the correction is enabled at the start; compensator/enable changes it later',
        default=True,
    )
    fade_time: float = parameter(
        'Time in which the correction fades in or out',
        default=3.0,
        unit='s',
        minimum=0.1,
        maximum=60.0,
    )


class CorrectionMode(enum.Enum):
    """Modes of the correction; the values are used in messages."""

    DISABLED = 'disabled by the operator'
    NO_ESTIMATE = 'no valid estimate of the disturbance was received yet'
    SETTLING = 'waiting until the estimates have settled'
    ACTIVE = 'compensating'
    SILENT = 'the correction has been faded out without a valid estimate'


class Remainder:
    """
    Critically damped difference between an old and a new trajectory.

    Each jump of the trajectory is added to the rest of the previous jumps. The sum of trajectory
    and remainder therefore continues in position and velocity. The remainder is linear, so that
    the sum is bounded however often the trajectory jumps. This holds also if two remainders share
    the jumps: one remainder takes the jumps of the position with the time constant T, the other
    takes those of the velocity with the time constant U.

    Proof: a unit jump of the position leaves g = (1 + t/T) exp(−t/T), a unit jump of the velocity
    leaves h = t exp(−t/U). Let the trajectory a begin at 0 and be within P, and between its jumps
    a' within V and a'' within A. With the jumps p of the position and v of the velocity as
    impulses, the derivative of a is a' − p, that of a' is a'' − v. Partial integration gives

        a + g ∗ p = g ∗ a' − g' ∗ a,    h ∗ v = h ∗ a'' − h' ∗ a'.

    The integrals of |g|, |g'|, |h| and |h'| are 2 T, 1, U² and 2 U/e. Hence the sum of trajectory
    and remainders is within P + 2 T V + 2 U V/e + U² A.

    The time constant may also change, if one remainder takes the jumps of both position and
    velocity. The sum f of trajectory and remainder is then smooth, and a critically damped filter
    of the trajectory,

        f'' + 2 f'/T + f/T² = u,    u = a'' + 2 a'/T + a/T².

    With T between L and H, count time in units of their geometric mean τ = √(L H), so that r = τ/T
    is between √(L/H) and √(H/L). For W² = f² + √2 f f' + f'² and u = 0,

        (W²)' = −√2 r² f² + (2 − 2√2 r − 2 r²) f f' + (√2 − 4 r) f'².

    This form is negative definite where 4√2 r² (4 r − √2) > (2 − 2√2 r − 2 r²)². Division by 4 r²
    and s = r + 1/r make it 2√2 s − 4 > s² − 4, that is s < 2√2. The condition holds for all r, and
    W² is a common Lyapunov function, if H/L < (1 + √2)² = 3 + 2√2. For H = 2 L, W decays at least
    by the rate √2/4. As u adds at most |u| to the derivative of W, W remains within 2√2 max |u|.
    With |f| ≤ √2 W the sum is within 4 (2 P + 2 H V + L H A).

    Parameters
    ----------
    constant : float
        Time constant [s], until `add` changes it.

    """

    DEAD_AFTER = 40.0  # time constants: 1e-16 of the remainder is left

    def __init__(self, constant: float) -> None:
        self._constant = constant
        self.clear()

    def clear(self) -> None:
        """Remove the remainder of all jumps."""
        # begin and end of the remainder [s]
        self._start = -math.inf
        self._end = -math.inf
        # p and s of (p + s t) exp(−t/T)
        self._position = ZERO_POSE
        self._slope = ZERO_TWIST

    def add(
        self, time: float, jump: MotionState, constant: float | None = None
    ) -> None:
        """
        Add a jump at a time [s]: the old trajectory minus the new trajectory.

        From then on the remainder decays with the time constant [s], by default the previous one.
        """
        left = self.at(time)
        if constant is not None:
            self._constant = constant

        # at t = 0 the remainder is p, and its velocity s − p/T
        self._position = add(left.position, jump.position)
        slope = []
        for rest_velocity, jump_velocity, position in zip(
            left.velocity, jump.velocity, self._position, strict=True
        ):
            slope.append(rest_velocity + jump_velocity + position / self._constant)
        self._slope = Twist(*slope)
        self._start = time
        self._end = time + self.DEAD_AFTER * self._constant

    def at(self, time: float) -> MotionState:
        """Return the remainder at a time [s]: (p + s t) exp(−t/T) for each axis."""
        if time > self._end:
            return ZERO_STATE
        t = max(time - self._start, 0.0)
        constant = self._constant
        decay = math.exp(-t / constant)

        # p + s t along each axis; loops would take twice as long
        vx, vy, omega = self._slope
        x, y, theta = self._position
        x += vx * t
        y += vy * t
        theta += omega * t
        return MotionState(
            Pose(decay * x, decay * y, decay * theta),
            Twist(
                decay * (vx - x / constant),
                decay * (vy - y / constant),
                decay * (omega - theta / constant),
            ),
        )


class Correction:
    """Correction: computes the disturbance to correct at any time."""

    LONG_GAP = 0.3  # s between two estimates, after which the prediction may change by centimetres
    CATCH_UP = 0.1  # s, time constant of such a change: 2 m/s² for 20 mm
    DECAYS = 6.0  # time constants in a fade: 2 % of the difference remain at its end
    # s, time constant of a velocity that ends: 1.6 m/s² from 0.2 m/s
    LONGEST_BRAKING = 0.25
    # s, minimum duration of estimates before the correction fades in
    SETTLING_TIME = 0.5
    NONE_KNOWN: tuple[bool, ...] = (False, False, False)
    # a share of 0 minus a share of 1
    NO_SHARE = MotionState(Pose(-1.0, -1.0, -1.0), ZERO_TWIST)
    # s, time constant of a change by an estimate with the usual noise: 30 Hz
    SMOOTHING = 0.03
    LEAST_SMOOTHING = 0.015  # s, the same with less than half of this noise
    USUAL_NOISE = (1e-3, 1e-3, 1.75e-3)  # m, m, rad

    def __init__(self, settings: CorrectionSettings) -> None:
        self.settings = settings
        self.predictor = DisturbancePredictor()
        self.rejections = Rejections()  #: of the estimates
        self.enabled = settings.enabled
        self.mode = (
            CorrectionMode.NO_ESTIMATE if settings.enabled else CorrectionMode.DISABLED
        )
        #: tare offset: pose of the rail that counts as zero
        self.nominal = ZERO_POSE
        #: mask of the compensated axes x, y, theta: known for at least `SETTLING_TIME`
        self.usable = ALL_KNOWN
        # stamp of the estimate since which each axis is known [s]: infinity while it is unknown;
        # an axis that is known in the first estimate is usable at once
        self._known_since = [-math.inf] * len(self.usable)
        # axes that at least one estimate has measured
        self._measured = [False] * len(self.usable)
        #: velocity of the correction by its fades, without a motion of the rail [m/s, m/s, rad/s]
        self.fading = ZERO_TWIST
        # time of the newest correction [s], None before the first
        self._time: float | None = None
        self._state = ZERO_STATE  # state at this time; later states continue from it
        # axes that were corrected when the estimates ended
        self._interrupted = self.NONE_KNOWN
        constant = settings.fade_time / self.DECAYS
        # changes of the prediction by each new estimate
        self._smooth = Remainder(self.SMOOTHING)
        # of each axis's share of the correction, minus 1
        self._missing = Remainder(constant)
        # Position and velocity of other changes. The velocity decays sooner, because in a long
        # fade it would move the correction far away.
        self._fade = Remainder(constant)
        self._brake = Remainder(min(constant, self.LONGEST_BRAKING))
        # changes of the prediction by a long gap
        self._catch_up = Remainder(self.CATCH_UP)

    def add_estimate(self, estimate: Estimate) -> None:
        """Learn from a checked estimate if it is 15 ms newer than the last used estimate."""
        self.rejections.clear()
        self._update_usable(estimate)
        elapsed = estimate.stamp - self.predictor.stamp
        if -MIN_INTERVAL < elapsed < MIN_INTERVAL - STAMP_ROUNDING:
            return
        predicted = self._predicted
        has_stepped = self.predictor.update(
            estimate.stamp, estimate.pose, estimate.variances
        )
        if self._time is None:
            return
        if has_stepped or self.predictor.since == estimate.stamp:
            # The estimator may be wrong: the head follows no faster than the correction fades in.
            self._fade_from(self._time, self._target(predicted))
        elif elapsed > self.LONG_GAP:
            jump = self._target(predicted).minus(self._target(self._predicted))
            self._catch_up.add(self._time, jump)
        else:
            jump = predicted.minus(self._predicted)
            self._smooth.add(self._time, jump, self._smoothing)

    def _update_usable(self, estimate: Estimate) -> None:
        """
        Fade an axis out when it becomes unknown; fade it in after it has been known long enough.

        After the clock was set back, an axis has been known since the present stamp.
        """
        stamp = estimate.stamp
        usable = []
        for axis, is_known in enumerate(estimate.known):
            if not is_known:
                self._known_since[axis] = math.inf
            elif self._known_since[axis] > stamp:
                self._known_since[axis] = stamp
            self._measured[axis] = self._measured[axis] or is_known
            usable.append(stamp - self._known_since[axis] >= self.SETTLING_TIME)

        if tuple(usable) != self.usable:
            self._change(usable=tuple(usable))

    def tare(self, now: float) -> Pose:
        """
        Use the present disturbance as the nominal pose, and return it [m, m, rad].

        An axis that no estimate has ever measured keeps its nominal value. Raises a
        ManipulatorError if there is no fresh estimate, if no axis is measured, or if an axis that
        was measured before is not usable.
        """
        if self.age(now) > ESTIMATOR_SILENCE:
            newest = 'no estimate was received yet'
            if self._has_estimates:
                newest = (
                    f'the newest estimate is {self.age(now):.1f} s old, '
                    f'above the limit {ESTIMATOR_SILENCE:g} s'
                )
            raise ManipulatorError(
                f'tare rejected: {newest}: {self.silence_cause(now)}'
            )
        if not any(self.usable) or self._has_lost_axis:
            raise ManipulatorError(f'tare rejected: {self.unmeasured_axes()}')

        nominal = list(self.nominal)
        for axis, present in enumerate(self.predictor.predict(now).position):
            if self._measured[axis]:
                nominal[axis] = present
        self._change(nominal=Pose(*nominal))
        return self.nominal

    @property
    def _has_lost_axis(self) -> bool:
        """Return whether an axis that was measured before is not usable."""
        axes = zip(self._measured, self.usable, strict=True)
        return any(was_measured and not is_usable for was_measured, is_usable in axes)

    def at(self, now: float, time: float) -> MotionState:
        """
        Return the disturbance to correct when the head reaches its pose, at a time [s].

        The present time `now` [s] decides whether the estimator is silent. A time before the last
        call, or more than `LONGEST_PAUSE` after the last call, continues from the last correction.
        """
        mode = self._present_mode(now)
        if self._time is not None and not 0.0 <= time - self._time <= LONGEST_PAUSE:
            self._restart(time, mode)  # the clock was set
        elif mode is not self.mode:
            self._change(mode=mode)
        self._time = time
        target = self._target(self._predicted)
        fade = self._fade.at(time).plus(self._brake.at(time))
        fade = fade.plus(self._catch_up.at(time))
        self.fading = fade.velocity
        self._state = target.plus(fade)
        return self._state

    def deviations(self, time: float) -> tuple[float, ...] | None:
        """Return `predictor.deviations` at a time [s]; None before the first estimate."""
        return self.predictor.deviations(time) if self._has_estimates else None

    def age(self, now: float) -> float:
        """Return the age of the newest estimate [s]; infinite before the first estimate."""
        return now - self.predictor.stamp

    def is_silent(self, now: float) -> bool:
        """
        Return whether the rail's pose is too uncertain for a contact, a goal or a tare.

        The prediction continues the correction for longer, up to `FADE_AFTER`.
        """
        return self._has_estimates and abs(self.age(now)) > ESTIMATOR_SILENCE

    @property
    def _smoothing(self) -> float:
        """
        Return the time constant [s] with which a change due to a new estimate is smoothed.

        The changes due to the noise of the estimates determine the jerk of the carriages, so that
        less noise needs less smoothing. The axis with the most noise determines the result.
        """
        noise = 0.0
        for variance, usual in zip(
            self.predictor.innovations.tolist(), self.USUAL_NOISE, strict=True
        ):
            noise = max(noise, math.sqrt(variance) / usual)
        return min(max(noise * self.SMOOTHING, self.LEAST_SMOOTHING), self.SMOOTHING)

    def unmeasured_axes(self) -> str:
        """Return the names of the axes that are not usable, with the next step; or ``''``."""
        names = []
        for name, is_usable in zip(Pose._fields, self.usable, strict=True):
            if not is_usable:
                names.append(name)
        if not names:
            return ''
        verb = 'is' if len(names) == 1 else 'are'
        return (
            f'{", ".join(names)} {verb} not measured or too uncertain; '
            'next: check the sensor'
        )

    def silence_cause(self, now: float) -> str:
        """Return why no valid estimate is received at a time [s], with the next step."""
        if rejection := self.rejections.message(now):
            return f'each estimate is rejected: {rejection}'
        return 'the estimator is silent; next: check the estimator'

    @property
    def _has_estimates(self) -> bool:
        return self.predictor.stamp > -math.inf

    def _present_mode(self, now: float) -> CorrectionMode:
        """Return the mode that follows from operator and estimates at a time [s]."""
        if not self.enabled:
            return CorrectionMode.DISABLED
        if not self._has_estimates:
            return CorrectionMode.NO_ESTIMATE
        if abs(self.age(now)) > FADE_AFTER:
            return CorrectionMode.SILENT
        if self.predictor.stamp - self.predictor.since < self.SETTLING_TIME:
            return CorrectionMode.SETTLING
        return CorrectionMode.ACTIVE

    def _change(
        self,
        mode: CorrectionMode | None = None,
        nominal: Pose | None = None,
        usable: tuple[bool, ...] | None = None,
    ) -> None:
        """
        Change mode, tare offset or usable axes, and fade from the current correction.

        The share of an axis begins at 0, unless a silence has only interrupted its correction.
        """
        before = self._target(self._predicted)
        corrected = self._corrected
        if mode is CorrectionMode.SILENT:
            self._interrupted = corrected
        elif self.mode is CorrectionMode.SILENT and mode is CorrectionMode.ACTIVE:
            corrected = self._interrupted

        self.mode = mode or self.mode
        self.nominal = nominal or self.nominal
        self.usable = usable or self.usable
        if self._time is None:
            return

        begun = []
        for is_corrected, was_corrected in zip(self._corrected, corrected, strict=True):
            begun.append(is_corrected and not was_corrected)
        if any(begun):
            left = self._missing.at(self._time)
            self._missing.add(self._time, _along(begun, self.NO_SHARE.minus(left)))
        self._fade_from(self._time, before)

    def _restart(self, time: float, mode: CorrectionMode) -> None:
        """Continue from the current correction at another time [s]."""
        self._smooth.clear()
        self._missing.clear()
        self._fade.clear()
        self._brake.clear()
        self._catch_up.clear()
        self._time = time
        self.mode = mode
        self._interrupted = self.NONE_KNOWN
        self._fade_from(time, self._state)

    def _fade_from(self, time: float, before: MotionState) -> None:
        """Fade from the previous motion to the current target, beginning at a time [s]."""
        jump = before.minus(self._target(self._predicted))
        self._fade.add(time, jump._replace(velocity=ZERO_TWIST))
        self._brake.add(time, jump._replace(position=ZERO_POSE))

    @property
    def _corrected(self) -> tuple[bool, ...]:
        """Return a mask of the currently corrected axes x, y, theta."""
        return self.usable if self.mode is CorrectionMode.ACTIVE else self.NONE_KNOWN

    @property
    def _predicted(self) -> MotionState:
        """Return the prediction for the corrected axes."""
        if self._time is None or not any(self._corrected):
            return ZERO_STATE
        return _along(self._corrected, self.motion(self._time))

    def _target(self, predicted: MotionState) -> MotionState:
        """
        Return the target of the correction: a share of the smoothed prediction for each axis.

        The share of an axis rises from 0 to 1 when its correction begins. The correction then
        stays below the prediction, even while the prediction of the axis is still poor.
        """
        if self._time is None:
            return ZERO_STATE
        smooth = predicted.plus(_along(self._corrected, self._smooth.at(self._time)))
        missing = self._missing.at(self._time)
        if missing is ZERO_STATE:
            return smooth

        # (1 + m) p and its derivative, with the missing share m, which rises from −1 to 0
        positions = []
        velocities = []
        for p, v, missing_share, rise in zip(
            smooth.position,
            smooth.velocity,
            missing.position,
            missing.velocity,
            strict=True,
        ):
            share = 1.0 + missing_share
            positions.append(share * p)
            velocities.append(share * v + rise * p)
        return MotionState(Pose(*positions), Twist(*velocities))

    def disturbance(self, time: float) -> Pose:
        """Return the pose of the rail [m, m, rad] at a time [s]; zero before any estimate."""
        return self.motion(time).position if self._has_estimates else ZERO_POSE

    def rail(self, now: float) -> Pose | None:
        """
        Return the current pose of the rail [m, m, rad]; None if no axis is usable.

        Axes that are not usable are 0, and a disabled correction does not change this pose.
        """
        if self.age(now) > ESTIMATOR_SILENCE or not any(self.usable):
            return None
        return _along(self.usable, self.motion(now)).position

    def motion(self, time: float) -> MotionState:
        """Return the rail's motion at a time [s]; an estimate must have been received."""
        predicted = self.predictor.predict(time)
        if self.nominal == ZERO_POSE:
            return predicted
        back = invert(self.nominal)
        cosine = math.cos(back.theta)
        sine = math.sin(back.theta)
        vx, vy, omega = predicted.velocity
        velocity = Twist(cosine * vx - sine * vy, sine * vx + cosine * vy, omega)
        return MotionState(compose(back, predicted.position), velocity)


def _along(mask: Sequence[bool], motion: MotionState) -> MotionState:
    """Return a motion in which the axes outside a mask of x, y and theta are zero."""
    if all(mask):
        return motion
    positions = []
    velocities = []
    for is_inside, position, velocity in zip(
        mask, motion.position, motion.velocity, strict=True
    ):
        positions.append(position if is_inside else 0.0)
        velocities.append(velocity if is_inside else 0.0)
    return MotionState(Pose(*positions), Twist(*velocities))
