"""
The disturbance as the compensator corrects it: believed, predicted, faded in and out smoothly.

Whatever happens (enable, disable, tare, a silent estimator, an estimate that changes the
prediction) changes the course at which the correction aims, never the correction itself: the
difference dies out.
"""

from __future__ import annotations

from dataclasses import dataclass
import enum
import math

from facade_manipulator.control.blend import AT_REST, Blend, Course, NOWHERE
from facade_manipulator.control.estimate import Estimate, EstimateMean
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import compose, inverse
from facade_manipulator.parameters import check_parameters, parameter
from facade_manipulator.prediction import make_predictor, PredictionSettings

DECAYS = 6.0
LONGEST_PAUSE = 0.5  # s
SMOOTHING_ACCELERATION = 16.0  # of what a new estimate changed, by that of fading


@dataclass(frozen=True)
class CorrectionSettings:
    """How the correction fades and how smoothly it takes new estimates."""

    enabled: bool = parameter(
        True, 'Whether the correction is enabled at start; later it is compensator/enable',
        read_only=True)
    fade_time: float = parameter(
        3.0, 'Time in which the correction fades in or out', unit='s', minimum=0.1, maximum=60.0)
    silence: float = parameter(
        0.5, 'Age of the newest estimate from which the estimator counts as silent', unit='s',
        minimum=0.05, maximum=10.0)
    settling_time: float = parameter(
        0.5, 'Time for which estimates must have come before the correction fades in', unit='s',
        minimum=0.0, maximum=60.0)
    smoothing: float = parameter(
        0.03, 'Time constant with which the correction takes what a new estimate changed',
        unit='s', minimum=0.0, maximum=1.0)
    blend_acceleration: tuple[float, ...] = parameter(
        (0.5, 0.5, 1.0), 'Highest acceleration of fading: x, y, theta', unit='m/s^2, rad/s^2',
        minimum=0.01, maximum=20.0, read_only=True, elements=Pose._fields)

    def __post_init__(self) -> None:
        check_parameters(self)


class Mode(enum.Enum):
    """What the correction aims at, as a sentence."""

    DISABLED = 'disabled by the operator'
    UNHEARD = 'no estimate of the disturbance has come yet'
    SETTLING = 'waiting until the estimates have settled'
    ACTIVE = 'compensating'
    SILENT = 'the estimator is silent: the correction has been faded out'


class Correction:
    """
    Decide which disturbance to correct at each instant.

    Parameters
    ----------
    settings : CorrectionSettings
    prediction : PredictionSettings

    Attributes
    ----------
    mode : Mode
    predictor : Predictor

    """

    def __init__(self, settings: CorrectionSettings, prediction: PredictionSettings) -> None:
        self.settings = settings
        self.predictor = make_predictor(prediction)
        self._mean = EstimateMean()
        self.enabled = settings.enabled
        self.mode = Mode.UNHEARD if settings.enabled else Mode.DISABLED
        self._nominal = NOWHERE
        self._time: float | None = None
        self._course = AT_REST  # at that time; what comes later continues it
        self._fade = Blend(settings.blend_acceleration)
        self._smooth = Blend(tuple(
            SMOOTHING_ACCELERATION * limit for limit in settings.blend_acceleration))

    def take(self, estimate: Estimate) -> None:
        """Learn from a believed estimate, from several at once where they come fast."""
        estimate = self._mean.add(estimate)
        if estimate is None:
            return
        smooth = self.mode is Mode.ACTIVE and self._time is not None
        self.predictor.update(estimate.stamp, estimate.pose, estimate.variances)
        if smooth:
            self._smooth.clear()
            self._smooth.begin(
                self._time, self._course.minus(self._aim()), self.settings.smoothing)

    def change_prediction(self, settings: PredictionSettings) -> None:
        """Learn anew by other settings; meanwhile the correction fades out, and in again."""
        self._change(mode=Mode.UNHEARD)
        self.predictor = make_predictor(settings)

    def tare(self, now: float) -> Pose:
        """
        Take the disturbance of the moment as the new nominal place and return it.

        Raises
        ------
        ManipulatorError
            If there is no fresh estimate.

        """
        if self.age(now) > self.settings.silence:
            heard = 'none has come yet' if self.predictor.stamp is None else (
                f'the newest is {self.age(now):.1f} s old, bound {self.settings.silence:g} s')
            raise ManipulatorError(f'cannot tare without a fresh estimate: {heard}')
        nominal = self.predictor.predict(now).place
        self._change(nominal=nominal)
        return nominal

    def at(self, now: float, time: float) -> Course:
        """
        Return the disturbance to correct at a time.

        Parameters
        ----------
        now : float
            Present time [s], which decides whether the estimator is silent.
        time : float
            When the head will be there [s].

        """
        mode = self._present_mode(now)
        if self._time is not None and not 0.0 <= time - self._time <= LONGEST_PAUSE:
            self._time = time  # the clock was set: go on from here
            self._change(mode=mode)
        elif mode is not self.mode:
            self._change(mode=mode)
        self._time = time
        self._course = self._aim()
        return self._course

    def deviations(self) -> Pose | None:
        """Return the prediction's standard deviations at the evaluation horizon, if known."""
        predictor = self.predictor
        if predictor.stamp is None:
            return None
        return predictor.deviations(
            predictor.stamp + predictor.settings.evaluation_horizon)

    def age(self, now: float) -> float:
        """Return the age of the newest estimate [s], infinity before the first."""
        return math.inf if self.predictor.stamp is None else now - self.predictor.stamp

    def _present_mode(self, now: float) -> Mode:
        if not self.enabled:
            return Mode.DISABLED
        if self.predictor.stamp is None:
            return Mode.UNHEARD
        if abs(self.age(now)) > self.settings.silence:
            return Mode.SILENT
        if self.predictor.stamp - self.predictor.since < self.settings.settling_time:
            return Mode.SETTLING
        return Mode.ACTIVE

    def _change(self, mode: Mode | None = None, nominal: Pose | None = None) -> None:
        """Aim at another course and fade over from where the correction is."""
        self.mode, self._nominal = mode or self.mode, nominal or self._nominal
        self._fade.clear()
        self._smooth.clear()
        if self._time is not None:
            self._fade.begin(
                self._time, self._course.minus(self._aim()), self.settings.fade_time / DECAYS)

    def _aim(self) -> Course:
        """Return the course with what is left of its predecessors."""
        if self._time is None:
            return AT_REST
        rest = self._smooth.at(self._time).plus(self._fade.at(self._time))
        return rest if self.mode is not Mode.ACTIVE else self._predicted().plus(rest)

    def _predicted(self) -> Course:
        course = self.predictor.predict(self._time)
        if self._nominal == NOWHERE:
            return course
        back = inverse(self._nominal)
        turn = Pose(0.0, 0.0, back.theta)
        return Course(compose(back, course.place), compose(turn, course.velocity)._replace(
            theta=course.velocity.theta))
