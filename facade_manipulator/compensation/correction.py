"""
The disturbance as the compensator corrects it: checked, predicted, faded in and out smoothly.

Whatever happens (enable, disable, tare, a silent estimator, an estimate that changes the
prediction) changes the trajectory at which the correction aims, never the correction itself: the
difference decays.
"""

from __future__ import annotations

import enum
import math

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import (
    compose,
    invert,
    MotionState,
    Pose,
    Twist,
    ZERO_POSE,
    ZERO_STATE,
)
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.prediction import (
    ALL_KNOWN,
    DisturbancePredictor,
    Estimate,
    EstimateMean,
    PredictionSettings,
)

QUICKEST = 1e-3  # s, least time constant: no division by 0 where nothing remains
DEAD_AFTER = 40.0  # time constants: 1e-16 of the remainder is left
DECAYS = 6.0  # time constants in a fade: 2 % of the difference remain at its end
LONGEST_PAUSE = 0.5  # s, a longer one means that the clock was set
SETTLING_TIME = 0.5  # s, for which estimates must have come before the correction fades in
SMOOTHING = 0.03  # s, time constant of what a new estimate changes: an estimator at 30 Hz
SMOOTHING_ACCELERATION = 16.0  # of what a new estimate changed, by that of fading
FADE_ACCELERATION = (0.5, 0.5, 1.0)  # m/s², m/s², rad/s²: highest of fading, far below the drives'


@settings
class CorrectionSettings:
    """How the correction fades in and out."""

    enabled: bool = parameter(
        'Whether the correction is enabled at start; later it is compensator/enable', default=True,
        read_only=True)
    fade_time: float = parameter(
        'Time in which the correction fades in or out', default=3.0, unit='s', minimum=0.1,
        maximum=60.0)
    silence: float = parameter(
        'Age of the newest estimate from which the estimator counts as silent', default=0.5,
        unit='s', minimum=0.05, maximum=10.0)


class CorrectionMode(enum.Enum):
    """What the correction aims at, as a message."""

    DISABLED = 'disabled by the operator'
    NO_ESTIMATE = 'no valid estimate of the disturbance has come yet'
    SETTLING = 'waiting until the estimates have settled'
    ACTIVE = 'compensating'
    SILENT = 'the estimator is silent or rejected: the correction has been faded out'


class Blend:
    """
    The remainder of an old trajectory, to be added to the new one; it decays, critically damped.

    At its start the sum continues position and velocity of the old one; later it is the new one.

    It adds about the acceleration of each axis [m/s², m/s², rad/s²] at most: what would need a
    greater one takes longer.
    """

    def __init__(self, acceleration: tuple[float, ...]) -> None:
        self._acceleration = acceleration
        self.clear()

    def clear(self) -> None:
        """Forget the remainder."""
        self._start = self.end = -math.inf  #: until when anything remains [s]

    def begin(self, time: float, difference: MotionState, constant: float) -> None:
        """
        Begin with a new remainder, in place of the present one.

        At a time [s]: the difference of the old trajectory less the new one, which decays with a
        time constant [s] that is lengthened where the acceleration would be too high.
        """
        position, velocity = difference
        constants = [
            max(constant, QUICKEST, _least_constant(*axis))
            for axis in zip(position, velocity, self._acceleration, strict=True)]
        self._start, self.end = time, time + DEAD_AFTER * max(constants)
        self._constants = constants
        self._position = position
        self._slope = [v + p / c for p, v, c in zip(position, velocity, constants, strict=True)]

    def at(self, time: float) -> MotionState:
        """Return the remainder at a time [s]: (p + s t) exp(−t/T) of each axis."""
        if time > self.end:
            return ZERO_STATE
        t = max(time - self._start, 0.0)
        (a, b, c), (x, y, theta), (dx, dy, dtheta) = self._constants, self._position, self._slope
        decay_x, decay_y, decay_theta = math.exp(-t / a), math.exp(-t / b), math.exp(-t / c)
        x, y, theta = x + dx * t, y + dy * t, theta + dtheta * t
        return MotionState(
            Pose(x * decay_x, y * decay_y, theta * decay_theta),
            Twist((dx - x / a) * decay_x, (dy - y / b) * decay_y,
                  (dtheta - theta / c) * decay_theta))


class Correction:
    """Decide which disturbance to correct at each instant."""

    def __init__(self, settings: CorrectionSettings, prediction: PredictionSettings) -> None:
        self.settings = settings
        self._prediction = prediction
        self.predictor = DisturbancePredictor(prediction)
        self._mean = EstimateMean()
        self.enabled = settings.enabled
        self.mode = CorrectionMode.NO_ESTIMATE if settings.enabled else CorrectionMode.DISABLED
        #: where the estimates have the rail that is to count as not displaced
        self.nominal = ZERO_POSE
        #: which of x, y, theta are compensated: of the others nobody knows where the rail is
        self.known = ALL_KNOWN
        self._found = [-math.inf] * len(self.known)  # since when each axis is known [s]
        self._time: float | None = None
        self._state = ZERO_STATE  # at that time; what comes later continues it
        self._fade = Blend(FADE_ACCELERATION)
        self._smooth = Blend(tuple(SMOOTHING_ACCELERATION * limit for limit in FADE_ACCELERATION))

    def add_estimate(self, estimate: Estimate) -> None:
        """Learn from a checked estimate, from several at once where they come fast."""
        self._note_known(estimate)
        mean = self._mean.add(estimate)
        if mean is None:
            return
        smooth = self.mode is CorrectionMode.ACTIVE
        if self.predictor.update(mean.stamp, mean.pose, mean.variances):
            self._change()  # it may lie: the head follows no faster than the correction fades in
        elif smooth and self._time is not None:
            self._smooth.clear()
            self._smooth.begin(
                self._time, self._state.minus(self._aim(self._time)), SMOOTHING)

    def _note_known(self, estimate: Estimate) -> None:
        """Fade an axis out that is not known any more, and in when it has settled."""
        self._found = [
            (math.inf if not known else since if since <= estimate.stamp else estimate.stamp)
            for known, since in zip(estimate.known, self._found, strict=True)]
        known = tuple(estimate.stamp - since >= SETTLING_TIME for since in self._found)
        if known != self.known:
            self._change(known=known)

    def predicted(self, estimate: Estimate) -> Pose:
        """Return what was predicted for an estimate, itself where nothing was."""
        if not self._has_estimates:
            return estimate.pose
        return self.predictor.predict(estimate.stamp).position

    def change_prediction(self, settings: PredictionSettings) -> None:
        """Learn again by other settings; meanwhile the correction fades out, and in again."""
        self._prediction = settings
        self.learn_again()

    def learn_again(self) -> None:
        """Forget every estimate: the correction fades out, and in again."""
        self._change(mode=CorrectionMode.NO_ESTIMATE)
        self.predictor = DisturbancePredictor(self._prediction)

    def tare(self, now: float) -> Pose:
        """
        Make the disturbance of the moment the new nominal position and return it.

        Raises a ManipulatorError if there is no fresh estimate.
        """
        if self.age(now) > self.settings.silence:
            newest = 'none has come yet' if not self._has_estimates else (
                f'the newest is {self.age(now):.1f} s old, bound {self.settings.silence:g} s')
            raise ManipulatorError(f'cannot tare without a fresh estimate: {newest}')
        nominal = self.predictor.predict(now).position
        self._change(nominal=nominal)
        return nominal

    def at(self, now: float, time: float) -> MotionState:
        """
        Return the disturbance to correct at a time [s], when the head will be there.

        The present time [s] decides whether the estimator is silent.
        """
        mode = self._present_mode(now)
        if self._time is not None and not 0.0 <= time - self._time <= LONGEST_PAUSE:
            self._time = time  # the clock was set: go on from here
            self._change(mode=mode)
        elif mode is not self.mode:
            self._change(mode=mode)
        self._time = time
        self._state = self._aim(time)
        return self._state

    def deviations(self, now: float, ahead: float) -> tuple[tuple[float, ...], ...] | None:
        """Return the prediction's standard deviations some time ahead [s], and the estimator's."""
        if not self._has_estimates:
            return None
        return (self.predictor.deviations(now + ahead),
                self.predictor.estimators_share(now + ahead, ahead))

    def age(self, now: float) -> float:
        """Return the age of the newest estimate [s], infinity before the first."""
        return now - self.predictor.stamp

    @property
    def _has_estimates(self) -> bool:
        return self.predictor.stamp > -math.inf

    def _present_mode(self, now: float) -> CorrectionMode:
        if not self.enabled:
            return CorrectionMode.DISABLED
        if not self._has_estimates:
            return CorrectionMode.NO_ESTIMATE
        if abs(self.age(now)) > self.settings.silence:
            return CorrectionMode.SILENT
        if self.predictor.stamp - self.predictor.since < SETTLING_TIME:
            return CorrectionMode.SETTLING
        return CorrectionMode.ACTIVE

    def _change(
        self, mode: CorrectionMode | None = None, nominal: Pose | None = None,
        known: tuple[bool, ...] | None = None,
    ) -> None:
        """Aim at another trajectory and fade over from where the correction is."""
        self.mode, self.nominal = mode or self.mode, nominal or self.nominal
        self.known = known or self.known
        self._fade.clear()
        self._smooth.clear()
        if self._time is not None:
            self._fade.begin(
                self._time, self._state.minus(self._aim(self._time)),
                self.settings.fade_time / DECAYS)

    def _aim(self, time: float) -> MotionState:
        """Return the prediction with the remainders of what was aimed at before."""
        active = self.mode is CorrectionMode.ACTIVE
        aim = _along(self.known, self.motion(time)) if active else ZERO_STATE
        for remainder in (self._smooth, self._fade):
            if time <= remainder.end:
                aim = aim.plus(remainder.at(time))
        return aim

    def disturbance(self, time: float) -> Pose:
        """Return where the rail is at a time [s], whether that is corrected or not."""
        return self.motion(time).position if self._has_estimates else ZERO_POSE

    @property
    def is_blind(self) -> bool:
        """Whether nobody knows where on the wall the head is."""
        return self.mode in (CorrectionMode.DISABLED, CorrectionMode.NO_ESTIMATE)

    def motion(self, time: float) -> MotionState:
        """Return the rail's motion at a time [s] by the estimates, of which there must be some."""
        predicted = self.predictor.predict(time)
        if self.nominal == ZERO_POSE:
            return predicted
        back = invert(self.nominal)
        cosine, sine = math.cos(back.theta), math.sin(back.theta)
        vx, vy, omega = predicted.velocity
        velocity = Twist(cosine * vx - sine * vy, sine * vx + cosine * vy, omega)
        return MotionState(compose(back, predicted.position), velocity)


def _along(known: tuple[bool, ...], motion: MotionState) -> MotionState:
    """Return a motion along the axes that are known alone."""
    if known == ALL_KNOWN:
        return motion
    position, velocity = (tuple(value if is_known else 0.0 for is_known, value in zip(
        known, values, strict=True)) for values in motion)
    return MotionState(Pose(*position), Twist(*velocity))


def _least_constant(position: float, velocity: float, acceleration: float) -> float:
    """Return the time constant of a decay within an acceleration, about."""
    return max(math.sqrt(abs(position) / acceleration), 2.0 * abs(velocity) / acceleration)
