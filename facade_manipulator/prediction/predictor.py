"""
Predict the disturbance: a Kalman filter per axis, an offset and two oscillations that adapt.

How hard the gusts push is not known and changes, so several opinions on it run side by side. Each
is judged by what matters: how well it foretold, one horizon ahead, the measurements that came.
The prediction is the mean of the opinions, weighted by that record; one more opinion, that the
axis just stands at its offset, wins where nothing can be foretold; there the correction fades. An
opinion that has lost the oscillations is started anew from the spectrum of what was measured. One
whose oscillations have met at the same frequency is started anew, too: only their sum is seen, and
they would grow in opposition without end.
"""

from __future__ import annotations

from collections import deque
import math

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import MotionState, Pose
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.prediction import oscillators
from facade_manipulator.prediction.filter_bank import FilterBank
from facade_manipulator.prediction.polynomial import PolynomialMotion
from facade_manipulator.prediction.spectrum import fit_oscillations

GRAVITY = 9.81
AXES = len(Pose._fields)
HISTORY_LENGTH = 1024
SEARCH_PERIOD = 1.0
SEED_INTERVAL = 8.0
SEED_EXPLAINED = 0.8
LOST_SHARE = 0.04
LOST_NOISE = 1.5
NOISE_IN_SCORE = 0.8
SCORE_FLOOR = 0.02
ASTRAY = 4.0  # amplitude by the RMS of the motion that no oscillation of it has
STRONGEST_MEMORY = 60.0  # s
FIRST_SCORE = 1e-4
JUDGE_PERIOD = 0.0245  # s: how well one foretells is not news at every estimate
COURSE_REACH = 0.02  # s: asked from the last estimate to the next one, an expansion holds
COURSE_DEGREE = 6


@settings
class PredictionSettings:
    """Settings of the disturbance's prediction."""

    model: str = parameter(
        'oscillations', 'What the disturbance is taken for; none: as it was last seen',
        choices=('oscillations', 'acceleration', 'none'))
    jerk_noise: float = parameter(
        0.1, 'Model acceleration: root of the jerk spectral density', unit='m/s^2.5',
        minimum=1e-6, maximum=1000.0)
    cable_length: float = parameter(
        0.0, "Length of the gondola's cables, to start from their pendulum; 0 if not known",
        unit='m', minimum=0.0, maximum=1000.0)
    frequencies: tuple[float, ...] = parameter(
        (0.12, 0.35), 'Frequencies of the two oscillations to start from', unit='Hz',
        minimum=0.04, maximum=5.0, elements=('first', 'second'))
    gusts: tuple[float, ...] = parameter(
        (0.0005, 0.003, 0.02, 0.15),
        'Opinions on the gusts: root of the acceleration spectral density',
        unit='m/s^1.5', minimum=1e-6, maximum=100.0)
    offset_drift: float = parameter(
        5e-4, 'Random walk of the offset in 1 s', unit='m', minimum=0.0, maximum=1.0)
    frequency_drift: float = parameter(
        0.01, 'Random walk of each frequency in 1 s, relative to it', minimum=0.0, maximum=1.0)
    judged_horizon: float = parameter(
        0.12, 'Time ahead for which the opinions are judged', unit='s', minimum=0.02, maximum=1.0)
    memory: float = parameter(
        3.0, 'Time constant with which an old prediction error is forgotten', unit='s',
        minimum=0.1, maximum=100.0)
    mean_time: float = parameter(
        5.0, 'Time constant of the mean that is corrected where nothing can be foretold',
        unit='s', minimum=0.1, maximum=600.0)
    decisiveness: float = parameter(
        8.0, 'Power of the inverse error in the weights of the opinions', minimum=1.0,
        maximum=30.0)
    window: float = parameter(
        20.0, 'Time over which the spectrum is searched for oscillations', unit='s', minimum=2.0,
        maximum=120.0)
    bandwidth: float = parameter(
        3.0, 'Frequency above which a compensated oscillation fades, to none at twice it',
        unit='Hz', minimum=0.1, maximum=5.0)
    longest_gap: float = parameter(
        3.0, 'Longest gap between measurements that the oscillations survive', unit='s',
        minimum=0.1, maximum=60.0)
    acceleration: tuple[float, ...] = parameter(
        (1.0, 0.7, 1.4),
        'Acceleration beyond which an oscillation is compensated in part: x, y, theta',
        unit='m/s^2, rad/s^2', minimum=1e-3, maximum=100.0, elements=Pose._fields)

    def __post_init__(self) -> None:
        if not self.gusts:
            raise ParameterError('gusts has no element, expected at least 1')

    def initial_frequencies(self) -> np.ndarray:
        """Return the angular frequencies to start from [rad/s]."""
        start = 2.0 * math.pi * np.array(self.frequencies)
        if self.cable_length > 0.0:
            start[0] = math.sqrt(GRAVITY / self.cable_length)
        return start

    def noise(self) -> oscillators.ProcessNoise:
        """Return the process noise, one acceleration density per opinion."""
        return oscillators.ProcessNoise(
            np.square(self.gusts), self.offset_drift ** 2, self.frequency_drift ** 2)


class DisturbancePredictor:
    """
    Foretell the disturbance from its estimates.

    Parameters
    ----------
    settings : PredictionSettings

    """

    def __init__(self, settings: PredictionSettings) -> None:
        self.settings = settings
        self.stamp: float | None = None
        self.since: float | None = None
        self._searched_axis = 0
        self._room = np.array(settings.acceleration)[:, None, None]
        self._forget()

    def update(self, stamp: float, values: Pose, variances: Pose) -> None:
        """
        Learn from an estimate.

        Parameters
        ----------
        stamp : float
            When the disturbance was there [s]; if it is earlier than that of the estimate
            before, or much later, everything is learnt anew.
        values : Pose
            Estimated disturbance.
        variances : Pose
            Variances of the estimate's noise, above 0.

        """
        measured, noise = np.array((*values, *variances)).reshape(2, AXES)
        if self.stamp is None or not 0.0 < stamp - self.stamp <= self.settings.longest_gap:
            self._start(stamp, measured)
        else:
            interval = stamp - self.stamp
            self._bank.update(interval, measured, noise)
            share = interval / min(self.settings.mean_time, stamp - self.since)
            self._mean = self._mean + share * (measured - self._mean)
        self.stamp = stamp
        self._history.append((stamp, measured))
        self._past.append((stamp, self._bank.states, self._mean))
        if stamp - self._judged >= JUDGE_PERIOD:
            self._judge(measured, noise)
        if stamp >= self._next_search:
            self._search(noise)
        self._course = None

    def predict(self, time: float) -> MotionState:
        """
        Return the disturbance to compensate at a time, of the past or the future [s].

        Oscillations beyond the bandwidth or the acceleration are contained in part.
        """
        if self._course is None or not self._course.covers(time):
            self._course = self._expand(time + COURSE_REACH)
        return self._course.at(time)

    def _expand(self, centre: float) -> PolynomialMotion:
        """
        Return the weighted prediction around a time, the reach behind and ahead of it.

        The next term of the series stays below 1e-7 of the acceleration's limit (in s²), even at
        the highest frequency of a state.
        """
        weights, states = self._weights[:, :-1], self._bank.states
        phasors, frequencies = oscillators.phasors(states), states[..., oscillators.FREQUENCIES]
        compensated = weights[..., None] * self._compensated_shares(phasors, frequencies)
        coefficients = oscillators.taylor_coefficients(
            compensated * phasors, frequencies, centre - self.stamp, COURSE_DEGREE)
        offsets = weights * states[..., oscillators.OFFSET]
        coefficients[0] += np.add.reduce(offsets, axis=-1)
        coefficients[0] += self._weights[:, -1] * self._mean
        return PolynomialMotion(centre, COURSE_REACH, coefficients[::-1].tolist())

    @property
    def frequencies(self) -> np.ndarray:
        """Frequencies of the opinion that weighs most on each axis [Hz], shape (3, 2)."""
        leading = self._weights[:, :-1].argmax(axis=-1)
        states = self._bank.states[np.arange(AXES), leading]
        return states[:, oscillators.FREQUENCIES] / (2.0 * math.pi)

    def _forget(self) -> None:
        opinions = len(self.settings.gusts) + 1
        self._history: deque[tuple[float, np.ndarray]] = deque(maxlen=HISTORY_LENGTH)
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self._scores = np.full((AXES, opinions), FIRST_SCORE)
        self._strongest = np.zeros(AXES)
        self._weights = np.full((AXES, opinions), 1.0 / opinions)
        self._seeded = np.full((AXES, opinions - 1), -math.inf)

    def _start(self, stamp: float, values: np.ndarray) -> None:
        self._forget()
        self.since = self._next_search = self._judged = stamp
        self._mean = values
        self._bank = FilterBank(
            values, self.settings.initial_frequencies(), self.settings.noise())

    def _judge(self, values: np.ndarray, noise: np.ndarray) -> None:
        """Compare what the opinions said one horizon ago with what is now."""
        past, horizon = self._past, self.settings.judged_horizon
        interval, self._judged = self.stamp - self._judged, self.stamp
        if self.stamp - past[0][0] < horizon:
            return
        while self.stamp - past[1][0] >= horizon:
            past.popleft()
        stamp, states, mean = past[0]
        foretold = oscillators.place_after(states, self.stamp - stamp)
        errors = values[:, None] - np.concatenate((foretold, mean[:, None]), axis=-1)
        memory = min(self.settings.memory, self.stamp - self.since - horizon + interval)
        share = interval / max(memory, interval)
        self._scores += share * (errors * errors - self._scores)
        self._weigh(noise)

    def _weigh(self, noise: np.ndarray) -> None:
        """Weigh the opinions by their scores."""
        noise = noise[:, None]
        excess = np.maximum(self._scores - NOISE_IN_SCORE * noise, SCORE_FLOOR * noise)
        least = np.minimum.reduce(excess, axis=-1, keepdims=True)
        weights = (least / excess) ** (0.5 * self.settings.decisiveness)
        self._weights = weights / np.add.reduce(weights, axis=-1, keepdims=True)

    def _search(self, noise: np.ndarray) -> None:
        """Look for opinions to start anew: those astray, and on one axis at a time those lost."""
        self._next_search = self.stamp + SEARCH_PERIOD / AXES
        self._restart_astray(noise)
        self._searched_axis = (self._searched_axis + 1) % AXES
        self._seed_lost(self._searched_axis, noise)

    def _seed_lost(self, axis: int, noise: np.ndarray) -> None:
        """Start opinions that have lost an axis's oscillations anew from its spectrum."""
        least = LOST_NOISE * noise[axis]
        if not self._lost_opinions(axis, least):
            return  # whatever the window says
        window = [item for item in self._history if item[0] >= self.stamp - self.settings.window]
        times = np.array([time for time, _ in window])
        values = np.array([value[axis] for _, value in window])
        lost = self._lost_opinions(axis, max(least, noise[axis] + LOST_SHARE * values.var()))
        fit = fit_oscillations(times, values) if lost else None
        if fit is None or fit.explained < SEED_EXPLAINED:
            return
        for opinion in lost:
            self._bank.seed(axis, opinion, fit, noise[axis])
            self._seeded[axis, opinion] = self.stamp
            self._scores[axis, opinion] = self._scores[axis].min()

    def _restart_astray(self, noise: np.ndarray) -> None:
        """Start opinions anew whose oscillations are far beyond the motion; they prove it anew."""
        fade = math.exp(-SEARCH_PERIOD / AXES / STRONGEST_MEMORY)
        self._strongest = np.maximum(fade * self._strongest, self._scores[:, -1])
        power = np.square(np.abs(oscillators.phasors(self._bank.states)))
        ripe = self.stamp - np.maximum(self._seeded, self.since) > self.settings.window
        astray = ripe & (power.max(axis=-1) > ASTRAY ** 2 * self._strongest[:, None])
        for axis, opinion in np.argwhere(astray).tolist():
            self._bank.restart(axis, opinion, self._mean[axis])
            self._seeded[axis, opinion] = self.stamp
            self._scores[axis, opinion] = self._scores[axis].max()
        if astray.any():
            self._weigh(noise)

    def _lost_opinions(self, axis: int, bound: float) -> list[int]:
        """Return the opinions, but for the last, with errors far above the noise."""
        ripe = self.stamp - self._seeded[axis] > SEED_INTERVAL
        lost = ripe & (self._scores[axis, :-1] > bound)
        return np.flatnonzero(lost[:-1]).tolist()

    def _compensated_shares(self, phasors: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
        """Return which share of each oscillation to compensate, shape (3, opinions, 2)."""
        demands = np.abs(phasors) * (frequencies * frequencies) + 1e-12
        limits = _shares(demands, frequencies, self._room)
        band = 2.0 - frequencies / (2.0 * math.pi * self.settings.bandwidth)
        return np.maximum(np.minimum(np.minimum(limits, band), 1.0), 0.0)


def _shares(demands: np.ndarray, frequencies: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Return which share of two demands fits in the room, the slower oscillation's first."""
    slower = frequencies <= frequencies[..., ::-1]
    slower[..., 1] = ~slower[..., 0]
    taken = np.where(slower, np.minimum(demands, room), 0.0)
    return (room - taken[..., ::-1]) / demands
