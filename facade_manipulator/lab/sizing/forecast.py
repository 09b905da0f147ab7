"""
Is a gondola compensable: what will be left on the wall, and how long its goals are in reach.

No loop runs. Of sines the errors of the prediction follow from the bound of Cramér and Rao, of
gusts, spectra and recordings from the covariance that their power has; `LEARNING` is how much
worse one is who has to learn the law. The horizon is the compensator's; drives that lag by more or
less than is assumed leave that much of the speed. What is out of reach is tried pose by pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_toeplitz

from facade_manipulator.compensation import WorkspaceLimit
from facade_manipulator.kinematics import Geometry, Pose, relative
from facade_manipulator.lab.gondola import (
    covariance,
    EstimatorSettings,
    FREQUENCY_DEVIATION,
    LEAST_POWER,
    Motion,
    rms,
    Scenario,
    SinesPrediction,
    Sway,
    wind_law,
    WINDOW,
)

SETTLED = 20.0  # s, after which nothing fades in any more
RECORDED_STEP = 0.05  # s, between the samples whose power is taken
INSIDE_STEP, INSIDE_FOR = 0.1, 240.0  # s, between the poses that are tried, and in all
SKIPPED = 25  # estimates, from one at which the bound of sines is taken to the next
OUTSIDE = 1e-4  # m or rad, of which a pose is held back at least where it counts as outside
#: the learner's errors in closed loops by the bound's, from 20 s on: docs/design.md
LEARNING = {'sines': 1.3, 'gusts': 1.13}


class Forecast(NamedTuple):
    """Standard deviations are of x, y, θ [m, m, rad]."""

    before: np.ndarray  #: of the rail's motion
    predicted: np.ndarray  #: of what the prediction leaves
    lagged: np.ndarray  #: of what the drives leave
    held_back: np.ndarray  #: of what the workspace takes away
    inside: float  #: share of the time

    @property
    def residual(self) -> np.ndarray:
        """Standard deviations of the head's error on the wall."""
        return np.sqrt(self.predicted ** 2 + self.lagged ** 2 + self.held_back ** 2)


def forecast(geometry: Geometry, scenario: Scenario, lag_error: float = 0.0) -> Forecast:
    """
    Return what a machine will leave of a gondola's motion.

    Parameters
    ----------
    geometry : Geometry
    scenario : Scenario
        Its motion, goals, estimator and compensator.
    lag_error : float
        By how much the drives' lag is longer than `controller.drive_lag` says [s].

    """
    motion, mission = scenario.motion(), scenario.mission
    times = np.arange(SETTLED, SETTLED + INSIDE_FOR, INSIDE_STEP)
    rails = np.array([motion(time) for time in times.tolist()])
    speeds = np.gradient(rails, INSIDE_STEP, axis=0, edge_order=2)
    limit = WorkspaceLimit(geometry, scenario.compensator.workspace_limit)
    back = np.array([limit.saturate(relative(Pose(*rail), mission.goal(time))).saturation_error
                     for time, rail in zip(times.tolist(), rails.tolist(), strict=True)])
    held = np.abs(back).max(axis=1) > OUTSIDE
    return Forecast(
        rms(rails), _predicted(scenario, motion), abs(lag_error) * rms(speeds), rms(back),
        float(1.0 - held.mean()))


def _predicted(scenario: Scenario, motion: Motion) -> np.ndarray:
    """Return the errors that the prediction makes at the head, which yaw moves by its lever."""
    x, y, yaw = _rail_errors(scenario, motion)
    lever = rms(np.array(scenario.mission.plan))
    return np.array((math.hypot(x, lever[1] * yaw), math.hypot(y, lever[0] * yaw), yaw))


def _rail_errors(scenario: Scenario, motion: Motion) -> np.ndarray:
    """Return the standard deviations of the prediction's errors, by the kind of the motion."""
    mission = scenario.mission
    ahead = scenario.compensator.compensation.horizon + mean_age(scenario.estimator)
    if mission.motion == 'sway':
        return LEARNING['sines'] * sines_bound(scenario, ahead)
    law = (wind_law(scenario.gondola, scenario.wind) if mission.motion == 'wind'
           else power_of(motion, mission.duration))
    return LEARNING['gusts'] * gusts_bound(*law, scenario.estimator, ahead)


def mean_age(estimator: EstimatorSettings) -> float:
    """Return how old the newest estimate is on average [s]."""
    return estimator.latency + 0.5 / _rate(estimator)


def _rate(estimator: EstimatorSettings) -> float:
    return estimator.rate * max(1.0 - estimator.loss, 0.01)


def power_of(motion: Motion, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [Hz] and the power of each axis there, of what a motion did."""
    times = np.arange(0.0, duration, RECORDED_STEP)
    values = np.array([motion(time) for time in times.tolist()])
    window = np.hanning(len(times))[:, None]
    spectrum = np.abs(np.fft.rfft(window * (values - values.mean(axis=0)), axis=0)) ** 2
    power = 2.0 * spectrum / (len(times) * np.sum(window ** 2))
    return np.fft.rfftfreq(len(times), RECORDED_STEP), power.T


def gusts_bound(
    frequencies: np.ndarray, power: np.ndarray, estimator: EstimatorSettings, ahead: float
) -> np.ndarray:
    """
    Return the errors of who knows the power of each frequency, but not what comes, shape (3,).

    The newest of the estimates of `WINDOW` is `ahead` old [s].
    """
    lags = np.arange(0.0, WINDOW, 1.0 / _rate(estimator))
    known, sought = (covariance(frequencies, power, of) for of in (lags, ahead + lags))
    alike = np.exp(-lags / estimator.correlation) if estimator.correlation else lags == 0.0
    left = [of[0] - of_sought @ solve_toeplitz(of + noise * alike, of_sought)
            for of, of_sought, noise in zip(
                known + LEAST_POWER, sought, estimator.variances(), strict=True)]
    return np.sqrt(np.maximum(left, 0.0))


def sines_bound(scenario: Scenario, ahead: float) -> np.ndarray:
    """Return the errors of who has to find the sines' frequencies, shape (3,), from 20 s on."""
    estimator, interval = scenario.estimator, 1.0 / _rate(scenario.estimator)
    bound = SinesPrediction(scenario.sway, 0.0, FREQUENCY_DEVIATION)
    errors = []
    for number in range(round(scenario.mission.duration / interval)):
        stamp = number * interval
        bound.update(stamp, Sway(scenario.sway).at(stamp), estimator.variances())
        if stamp + ahead >= SETTLED and number % SKIPPED == 0:
            errors.append(bound.deviations(stamp + ahead))
    return rms(np.array(errors))
