"""
Where the raw sensors are on the rail, how late and by which factor they measure, from a recording.

The estimator's own filter goes through the recording. Its innovations are white, and their
variances hardly depend on what is looked for: the values of which they are least are those of the
greatest likelihood, and their derivatives tell the information. The inertial sensor is the
reference of places and stamps, the line through the distances that of angles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice, pairwise
import math
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError, InputError, ParameterError
from facade_manipulator.estimation.inputs import ImuGate, rotation, YawComparison
from facade_manipulator.estimation.sensors import (
    innovation_of,
    make_sensors,
    residual_of,
    Wall,
    WallSensor,
)
from facade_manipulator.estimation.settings import DistanceSettings, EstimatorSetup
from facade_manipulator.estimation.state import InertialInput, Process
from facade_manipulator.tools.calibration.robust_fit import (
    HUBER,
    OUTLIER,
    robust_fit,
    robust_scatter,
)
from facade_manipulator.tools.calibration.tables import require_dense
from facade_manipulator.tools.calibration.unknowns import DEG, Unknown, values_of, with_values

MS, PERCENT = ('ms', 1e3), ('%', 1e2)
# what is looked for, of which sensors
DISTANCE, FIX, IMU = 'distance', 'fix', 'imu'
SOUGHT = {
    (DISTANCE, 'x'): Unknown('mounting', 0, 'x on the rail', 0.02),
    (DISTANCE, 'delay'): Unknown('delay', None, 'delay', 0.02, MS, 0.005),
    (FIX, 'delay'): Unknown('delay', None, 'delay', 0.05, MS, 0.005),
    (FIX, 'scale'): Unknown('scale', None, 'scale', 0.05, PERCENT, 0.01),
    (IMU, 'y'): Unknown('mounting', 1, 'y on the rail', 0.02),
    (IMU, 'yaw'): Unknown('mounting', 5, 'yaw to the line of the distances', 0.05, DEG, 0.01),
}
FIND = tuple(dict.fromkeys(name for _, name in SOUGHT))
INERTIAL_SCALE = 5e-3  # of rates and of accelerations: what industrial sensors promise
STEP = 0.02  # s, of the filter: 5 um at 0.1 m/s^2
SETTLING = 150  # steps, until gains hardly change; and until nobody sees where it began
# Of 22 made-up recordings the errors were up to 1.9 of the deviations (root of mean square): a
# sway passes the same places again, whose errors the filter takes for new ones.
AGAIN = 2.0
LEAST, LONGEST_GAP = 30.0, 0.1  # s, of the recording, of the inertial sensor
KNOWN_DELAY = 1e-5  # s: a delay that is looked for is no state as well
MOST_SCATTER = 3.0  # of what is expected
WORSE = 3.0  # by each value, on the half left out


class SensorRecording(NamedTuple):
    """What the sensors measured, by ascending stamps."""

    imu: np.ndarray  #: stamp [s], rates [rad/s] and accelerations [m/s²], shape (n, 7)
    walls: dict[str, np.ndarray]  #: of each distance and fix stamp [s] and value [m], shape (n, 2)


class SoughtValue(NamedTuple):
    """One number of one sensor."""

    sensor: str
    unknown: Unknown


class SensorFit(NamedTuple):
    """What was found."""

    setup: EstimatorSetup
    sought: list[SoughtValue]
    deviations: np.ndarray  #: of what was looked for [m, rad, s or 1]
    scatters: dict[str, tuple[float, float]]  #: on the half left out, before and after; 1 is right


def fit_sensors(
    setup: EstimatorSetup, recording: SensorRecording, find: Sequence[str] = FIND
) -> SensorFit:
    """
    Find places, delays and scales of the sensors from a swaying gondola.

    `find` has names of `FIND`. Raises a ParameterError for an unknown name, a CalibrationError if
    the recording has gaps, is too short, cannot show what is looked for, or contradicts itself.
    """
    if wrong := [name for name in find if name not in FIND]:
        raise ParameterError(f'{wrong[0]} is not one of {", ".join(FIND)}')
    sought = [SoughtValue(sensor, SOUGHT[kind, name]) for kind, sensors in (
        (DISTANCE, setup.distances), (FIX, setup.fixes), (IMU, (IMU,)))
        for sensor in sensors for name in find if (kind, name) in SOUGHT]
    first, second = _halves(recording)
    found, _ = _Course(setup, first).solve(setup, sought)
    left_out = _Course(found, second)
    scatters = _compared(left_out.innovations(setup), left_out.innovations(found), len(sought))
    found, deviations = _Course(found, recording).solve(found, sought, setup)
    _check_shown(sought, deviations)
    return SensorFit(found, sought, deviations, scatters)


def _halves(recording: SensorRecording) -> tuple[SensorRecording, SensorRecording]:
    require_dense(IMU, recording.imu[:, 0], LONGEST_GAP)
    begin = max(table[0, 0] for table in (recording.imu, *recording.walls.values()))
    end = min(table[-1, 0] for table in (recording.imu, *recording.walls.values()))
    if end - begin < LEAST:
        raise CalibrationError(f'the sensors have {max(end - begin, 0.0):.1f} s in common, '
                               f'{LEAST:g} s are needed, two minutes are good')
    middle = 0.5 * (begin + end)
    first, second = (
        SensorRecording(*_within(recording, span)) for span in pairwise((begin, middle, end)))
    return first, second


def _within(
    recording: SensorRecording, span: tuple[float, float]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    def cut(table: np.ndarray) -> np.ndarray:
        return table[(table[:, 0] >= span[0]) & (table[:, 0] <= span[1])]

    return cut(recording.imu), {name: cut(table) for name, table in recording.walls.items()}


class MeanMeasurement(NamedTuple):
    """The mean of what a sensor measured about a step."""

    sensor: str
    later: float  #: than the step [s], by the stamps and the delay of the sensor
    value: float
    share: float  #: of the variance of one measurement


class _Course:
    """A recording as steps of the filter; where its measurements belong is as the setup has it."""

    def __init__(self, setup: EstimatorSetup, recording: SensorRecording) -> None:
        self._setup = setup
        stamps, inertial = _checked(setup, recording)
        times = np.arange(stamps[0], stamps[-1], STEP)
        whole = np.vstack([np.zeros(6), np.cumsum(
            0.5 * np.diff(stamps)[:, None] * (inertial[1:] + inertial[:-1]), axis=0)])
        self._inputs = np.column_stack([
            np.diff(np.interp(times, stamps, column)) / STEP for column in whole.T])
        self._measured: list[list[MeanMeasurement]] = [[] for _ in self._inputs]
        self._middle = {}
        for name, sensor in _seeing(setup).items():
            table = _without_outliers(recording.walls[name])
            self._middle[name] = float(np.median(table[:, 1]))
            self._place(name, table - (sensor.delay, 0.0), times[1:])
        self._gains = [*self._filtered()]

    def _place(self, name: str, table: np.ndarray, times: np.ndarray) -> None:
        """Put means of measurements to the steps they are nearest to."""
        steps = np.round((table[:, 0] - times[0]) / STEP).astype(int)
        inside = (steps >= 0) & (steps < len(times))
        present, index, counts = np.unique(
            steps[inside], return_inverse=True, return_counts=True)
        laters, values = (np.bincount(index, column) / counts for column in table[inside].T)
        for step, stamp, value, count in zip(
                present.tolist(), laters.tolist(), values.tolist(), counts.tolist(), strict=True):
            self._measured[step].append(
                MeanMeasurement(name, stamp - times[step].item(), value, 1.0 / count))

    def innovations(
        self, setup: EstimatorSetup, scales: Sequence[float] = (1.0, 1.0)
    ) -> dict[str, np.ndarray]:
        """Return the innovations of each sensor by what is expected of them."""
        sensors, process = self._filter(setup)
        delays = {name: one.delay for name, one in _seeing(self._setup).items()}
        found = {name: list[float]() for name in sensors}
        mean, steps = self._settled.copy(), zip(
            self._inertial(setup, scales), self._measured, self._gains, strict=True)
        mean[:2] += np.subtract(setup.imu.mounting, self._setup.imu.mounting)[:2]
        for step, (inertial, measured, gains) in islice(enumerate(steps), SETTLING, None):
            mean, _ = process.moved(mean, inertial, STEP)
            for (name, later, value, _), (gain, deviation) in zip(measured, gains, strict=True):
                sensor = sensors[name]
                residual, _ = residual_of(
                    sensor, mean, inertial, later + delays[name] - sensor.delay,
                    value / sensor.scale)
                mean += residual * gain
                if step >= 2 * SETTLING:
                    found[name].append(residual * sensor.scale / deviation)
        return {name: np.array(values) for name, values in found.items()}

    def _filtered(self) -> Iterator[list[tuple[np.ndarray, float]]]:
        """
        Yield gains and deviations of the measurements of each step, by the setup.

        They are those of all that is tried: the least innovations of a filter that changes with
        what is looked for would be those of the filter that expects the most noise.
        """
        sensors, process = self._filter(self._setup)
        state = process.with_imu(process.unknown(), process.unknown_offsets())
        for step, (inertial, measured) in enumerate(zip(
                self._inertial(self._setup), self._measured, strict=True)):
            if step == SETTLING:
                self._settled = state.mean
            state, _ = process.advanced(state, inertial, STEP)
            gains = []
            for name, later, value, share in measured:
                sensor = sensors[name]
                one = innovation_of(
                    sensor, state, inertial, later, value / sensor.scale,
                    share * (sensor.noise / sensor.scale) ** 2)
                state = one.applied(state)
                gains.append((one.gain / one.variance, sensor.scale * math.sqrt(one.variance)))
            yield gains

    def _filter(self, setup: EstimatorSetup) -> tuple[dict[str, WallSensor], Process]:
        setup = self._placed(setup)
        sensors = make_sensors(setup, Wall(setup.wall))
        return {one.name: one for one in sensors}, Process(
            setup.imu, [state for sensor in sensors for state in sensor.states])

    def _inertial(
        self, setup: EstimatorSetup, scales: Sequence[float] = (1.0, 1.0)
    ) -> Iterator[InertialInput]:
        turn = rotation(0.0, 0.0, setup.imu.mounting[5] - self._setup.imu.mounting[5])
        rates, forces = (
            (part @ turn.T / scale).tolist() for part, scale in zip(
                np.split(self._inputs, 2, axis=1), scales, strict=True))
        return map(InertialInput, map(tuple, rates), map(tuple, forces))

    def _placed(self, setup: EstimatorSetup) -> EstimatorSetup:
        """Return a setup with the wall where the middle of what was measured is at rest."""
        def rest(name: str, one: DistanceSettings, axis: int) -> float:
            return self._middle[name] / one.scale + one.mounting[axis]

        distance = float(np.mean([rest(*one, 1) for one in setup.distances.items()]))
        return replace(
            setup, wall=replace(setup.wall, distance=distance), poses={}, fixes={
                name: replace(one, feature=rest(name, one, 0), feature_known=True,
                              delay_error=KNOWN_DELAY) for name, one in setup.fixes.items()})

    def solve(
        self, setup: EstimatorSetup, sought: Sequence[SoughtValue],
        expected: EstimatorSetup | None = None,
    ) -> tuple[EstimatorSetup, np.ndarray]:
        """Return the likeliest setup from a setup on, and the deviations of what is sought."""
        def misses(values: np.ndarray) -> np.ndarray:
            return np.concatenate([*self.innovations(
                _with_values(setup, sought, values[:-2]), values[-2:].tolist()).values()])

        tolerances = np.array([one.unknown.tolerance for one in sought] + 2 * [INERTIAL_SCALE])
        before, begin = (np.append(_values_of(one, sought), (1.0, 1.0))
                         for one in (expected or setup, setup))
        values, rates = robust_fit(misses, before, tolerances, begin)
        found = _with_values(setup, sought, values[:-2])
        scatters = np.concatenate([
            np.full(len(one), max(robust_scatter(one), 1.0))
            for one in self.innovations(found, values[-2:].tolist()).values()])
        rates /= scatters[:, None]
        covariance = np.linalg.inv(rates.T @ rates + np.eye(len(values)))
        return found, np.minimum(AGAIN * np.sqrt(np.diag(covariance)), 1.0)[:-2] * tolerances[:-2]


def _seeing(setup: EstimatorSetup) -> dict[str, DistanceSettings]:
    """Return the sensors that see the wall."""
    return setup.distances | setup.fixes


def _sensors(setup: EstimatorSetup) -> dict[str, Any]:
    return {IMU: setup.imu, **_seeing(setup)}


def _values_of(setup: EstimatorSetup, sought: Sequence[SoughtValue]) -> np.ndarray:
    sensors = _sensors(setup)
    return np.array([values_of(sensors[one.sensor], [one.unknown])[0] for one in sought])


def _with_values(
    setup: EstimatorSetup, sought: Sequence[SoughtValue], values: np.ndarray
) -> EstimatorSetup:
    sensors = _sensors(setup)
    for one, value in zip(sought, values.tolist(), strict=True):
        sensors[one.sensor] = with_values(sensors[one.sensor], [one.unknown], [value])
    return replace(
        setup, imu=sensors[IMU], distances={name: sensors[name] for name in setup.distances},
        fixes={name: sensors[name] for name in setup.fixes})


def _checked(
    setup: EstimatorSetup, recording: SensorRecording
) -> tuple[np.ndarray, np.ndarray]:
    """Return stamps and measurements of the inertial sensor along the rail's axes."""
    gate, comparison = ImuGate(setup.imu), YawComparison()
    rows, wrong = list[tuple[float, ...]](), None
    seen = sorted((stamp, setup.distances[name].mounting[0], value) for name in setup.distances
                  for stamp, value in recording.walls[name].tolist())
    seen.reverse()
    for stamp, *numbers in recording.imu.tolist():
        try:
            taken, rates, forces = gate.check(stamp, stamp, numbers[:3], numbers[3:])
        except InputError as error:
            wrong = error
            continue
        if rows:
            comparison.add_rate(rates[2], taken - rows[-1][0])
        rows.append((taken, *rates, *forces))
        while seen and seen[-1][0] <= stamp:
            at, place, value = seen.pop()
            if fault := comparison.add_distance(place, at, value):
                raise CalibrationError(fault)
    if wrong is not None and len(rows) < 0.5 * len(recording.imu):
        raise CalibrationError(str(wrong))
    table = np.array(rows)
    return table[:, 0], table[:, 1:]


def _without_outliers(table: np.ndarray) -> np.ndarray:
    """Return a table without what is far from its neighbours."""
    from scipy.ndimage import median_filter

    off = table[:, 1] - median_filter(table[:, 1], 7)
    return table[np.abs(off) <= max(OUTLIER * float(robust_scatter(off)), 1e-9)]


def _compared(
    before: dict[str, np.ndarray], after: dict[str, np.ndarray], count: int
) -> dict[str, tuple[float, float]]:
    """Return the scatters of innovations on the half left out; raise where they do not fit."""
    def cost(innovations: dict[str, np.ndarray]) -> float:
        sizes = np.abs(np.concatenate([*innovations.values()]))
        return float(np.where(
            sizes < HUBER, sizes ** 2, 2.0 * HUBER * sizes - HUBER ** 2).sum())

    if cost(after) > cost(before) + WORSE * count:
        raise CalibrationError(
            'what the first half of the recording says does not hold in the second: was a sensor '
            'touched meanwhile, or did the wall have steps there?')
    scatters = {name: (float(robust_scatter(before[name])), float(robust_scatter(one)))
                for name, one in after.items()}
    for name, (_, scatter) in scatters.items():
        if scatter > MOST_SCATTER:
            raise CalibrationError(
                f'{name} scatters by {scatter:.2g} times what {name}.noise and place_noise say: '
                'state its noise, or look for what is wrong with it')
    return scatters


def _check_shown(sought: Sequence[SoughtValue], deviations: np.ndarray) -> None:
    words = (unknown.blind(deviation, f'{name} ')
             for (name, unknown), deviation in zip(sought, deviations.tolist(), strict=True))
    if blind := [*filter(None, words)]:
        raise CalibrationError(
            f'the recording cannot show {", ".join(blind)}: let the gondola sway and turn more, '
            'push it along the wall and at one end every ten seconds, or look for less with '
            '--find')


def changed_parameters(found: SensorFit) -> dict[str, dict[str, Any]]:
    """Return what was looked for by the sensor's name and the parameter's."""
    sensors, changed = _sensors(found.setup), dict[str, dict[str, Any]]()
    for name, unknown in found.sought:
        changed.setdefault(name, {})[unknown.field] = getattr(sensors[name], unknown.field)
    return changed


def report_sensors(found: SensorFit) -> list[str]:
    """Return what was found, line by line."""
    values = _values_of(found.setup, found.sought).tolist()
    return [
        *(f'{f"{name} {unknown.words}":44s} {unknown.known(value, deviation)}'
          for (name, unknown), value, deviation in zip(
              found.sought, values, found.deviations.tolist(), strict=True)),
        *(f'{name}: innovations of the half left out {before:.2f} times what is expected before, '
          f'{after:.2f} after' for name, (before, after) in found.scatters.items())]
