"""
Where the rail is on the façade, of an inertial sensor and what sees the wall.

An error-state filter of the last moments: see `state` for the equations, `history` for late
measurements, `association` for what a measurement belongs to.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import chain
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.estimation import association, sensors, start
from facade_manipulator.estimation.history import History, Measurement
from facade_manipulator.estimation.inputs import ImuGate, LEAD, OLDEST, YawComparison
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.estimation.state import (
    COASTING,
    FilterState,
    forget,
    InertialInput,
    mean_input,
    Process,
    RATE_Z,
    VX,
    VY,
    X,
    Y,
    YAW,
)
from facade_manipulator.kinematics import Pose, Twist

AXES = Pose._fields
COASTING_STEP = 0.005  # s, of the filter without an inertial sensor
LONGEST_GAP = 0.5  # s without any call, after which everything starts again
UNKNOWN = (1.0, 1.0, 0.1)  # variances of x, y and yaw that mean that nothing is known
ON_START = (0.015 ** 2, 0.015 ** 2, 0.02 ** 2)  # likewise of what the first measurements say
VELOCITY = 0.15 ** 2  # likewise of a velocity
ONE_SIDED = 0.05 ** 2  # likewise of the yaw by a single distance
ALMOST_UNKNOWN = 0.1  # share of these from which on an axis is not known any more
ARRIVING = 0.5  # s, age of the newest measurement of a sensor that is there
EVENTS, STAMPS = 50, 32  # the newest are kept; of each sensor: a doubled stamp is rejected
LOOKING_PERIOD = 0.02  # s, between looks whether axes start or are lost
SILENCE = 0.03  # s without an inertial measurement, after which the filter goes on without it
REPORTED_SILENCE = 0.1  # s, of the inertial sensor; a shorter one is bridged without a word
RATE_BANDWIDTH = 100.0  # Hz, of the turning rate that is published


class EstimatorEvent(NamedTuple):
    """What happened to an axis or a sensor, and when [s]."""

    stamp: float
    subject: str
    reason: str


class RailMotion(NamedTuple):
    """Pose and velocity of the rail along the axes of `facade`, and how certain they are."""

    stamp: float  #: [s]
    pose: Pose
    velocity: Twist
    covariance: np.ndarray  #: of the pose, shape (3, 3)
    velocity_covariance: np.ndarray  #: shape (3, 3)

    def twist(self) -> tuple[Twist, np.ndarray]:
        """Return the velocity along the axes of `rail` [m/s, m/s, rad/s] and its covariance."""
        cosine, sine = math.cos(self.pose.theta), math.sin(self.pose.theta)
        turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        return (Twist(*(turn @ np.array(self.velocity)).tolist()),
                turn @ self.velocity_covariance @ turn.T)


class DisturbanceEstimator:
    """Estimate pose and velocity of the rail."""

    def __init__(self, setup: EstimatorSetup) -> None:
        self._setup = setup
        self._gate = ImuGate(setup.imu)
        self._wall = sensors.Wall(setup.wall)
        self._sensors = sensors.make_sensors(setup, self._wall)
        self._index = {sensor.name: k for k, sensor in enumerate(self._sensors)}
        self._levels = association.Levels(setup.wall.levels)
        self._associations = [
            association.Association(
                self._levels if isinstance(sensor, sensors.DistanceSensor)
                else association.Levels(), 6.0 * sensor.noise) for sensor in self._sensors]
        #: what became of the measurements of each sensor of the wall, by its name
        self.records: dict[str, association.SensorRecord] = {
            sensor.name: one.record
            for sensor, one in zip(self._sensors, self._associations, strict=True)}
        self._middle = (-setup.imu.mounting[0], -setup.imu.mounting[1], -setup.imu.mounting[2])
        self._has_distances = bool(setup.distances)
        self._process = Process(
            setup.imu, [*chain.from_iterable(sensor.states for sensor in self._sensors)])
        #: the newest ones: starts and restarts, levels found, the inertial sensor lost and back
        self.events: deque[EstimatorEvent] = deque(maxlen=EVENTS)
        #: what makes every estimate wrong, so that nothing is estimated any more; else empty
        self.fault = ''
        self._now = self._looked = -math.inf
        self._restart_everything()

    def _restart_everything(self) -> None:
        self._history = History(self._process, self._corrected)
        self._gate.stamp = self._imu_came = -math.inf
        self._last_input: InertialInput | None = None
        self.started: set[int] = set()  #: axes that are known
        self._collected: list[deque[tuple[float, float]]] = [deque() for _ in self._sensors]
        self._stamps: list[deque[float]] = [deque(maxlen=STAMPS) for _ in self._sensors]
        self._comparison = YawComparison()
        self.is_coasting = True  #: whether it runs without the inertial sensor
        for record in self.records.values():
            record.stamp = record.fitted = -math.inf

    def _begin(self, now: float) -> None:
        """Note the present time [s]; where it is not later than the last, start again."""
        if self._history.begun and not -LEAD <= now - self._now <= LONGEST_GAP:
            self._note('all', f'time went on by {now - self._now:.3f} s: everything starts again')
            self._restart_everything()
        self._now = max(now, self._now) if self._history.begun else now
        if not self._history.begun:
            self._history.begin(
                now - OLDEST, self._process.unknown(), self._process.unknown_offsets())

    def add_imu(
        self, now: float, stamp: float, rates: Sequence[float], forces: Sequence[float]
    ) -> None:
        """
        Go on by turning rates [rad/s] and accelerations [m/s²] along the sensor's own axes.

        Raises
        ------
        InputError
            As `ImuGate.check`.

        """
        self._begin(now)
        before = self._gate.stamp
        stamp, turning, forced = self._gate.check(now, stamp, rates, forces)
        self._imu_came = now
        newest = last = InertialInput(turning, forced)
        if self._last_input is not None and stamp - before < SILENCE:
            last = self._last_input
            self._comparison.add_rate(turning[2], stamp - before)
        self._last_input = newest
        if self.is_coasting:
            self.is_coasting = False
            self._note('imu', 'is there')
        if stamp > self._history.oldest:
            self._history.add_input(stamp, mean_input(last, newest))

    def add(
        self, name: str, now: float, stamp: float, value: float, variance: float | None = None
    ) -> None:
        """
        Take a number of a sensor of the wall, with the variance of its noise if that is known.

        Raises
        ------
        InputError
            With reason ``'not_finite'``, ``'stale'``, ``'future'`` or ``'out_of_order'``.

        """
        self._begin(now)
        index = self._index[name]
        sensor, record = self._sensors[index], self.records[name]
        if not math.isfinite(value):
            record.counts['not finite'] += 1
            raise InputError.not_finite(name, value)
        stamp -= sensor.delay
        require_recent(name, now - stamp, OLDEST, LEAD)
        if stamp in self._stamps[index]:
            raise InputError.out_of_order(name, 0.0)
        self._stamps[index].append(stamp)
        record.note_arrival(now, stamp)
        if isinstance(sensor, sensors.DistanceSensor) and not self.is_coasting:
            self._set_fault(self._comparison.add_distance(sensor.mounting[0], stamp, value))
        if X in self.started and isinstance(sensor, sensors.FeatureSensor):
            self._name_feature(sensor, value)
        if not self.started.issuperset(sensor.axes):
            self._collected[index].append((stamp, value))
        elif stamp > self._history.oldest:
            self._history.add_measurement(Measurement(
                index, stamp, value, sensor.noise ** 2 if variance is None else variance))

    def _name_feature(self, sensor: sensors.FeatureSensor, value: float) -> None:
        """Find out where the feature of a second sensor is, by what the first ones say."""
        if sensor.feature is None:
            (seen, _), _, _ = sensors.place(self._history.newest.state.mean, sensor.lever)
            sensor.feature = seen + value

    def _set_fault(self, fault: str) -> None:
        if fault and fault != self.fault:
            self.fault = fault
            self._note('all', fault)

    def advance(self, now: float) -> RailMotion | None:
        """Return the newest motion of the rail, None before anything is known or after a fault."""
        self._begin(now)
        self._coast(now)
        if not 0.0 <= now - self._looked < LOOKING_PERIOD:
            self._looked = now
            self._start(now)
            self._find_lost()
        if self.fault or not self.started:
            return None
        step = self._history.newest
        return self._motion(step.stamp, step.state, step.inertial)

    def delays(self) -> dict[str, tuple[float, float]]:
        """Return how late the stamps of each fix are, as found, and the deviation of that [s]."""
        mean, covariance = self._history.newest.state
        return {sensor.name: (sensor.delay + float(mean[sensor.first + 1]),
                              math.sqrt(covariance[sensor.first + 1, sensor.first + 1]))
                for sensor in self._sensors if isinstance(sensor, sensors.FeatureSensor)}

    def _coast(self, now: float) -> None:
        """Go on to the present without the inertial sensor if that is silent."""
        silent = now - self._imu_came  # by what comes: who is late would be overtaken each time
        if silent <= SILENCE:
            return
        if not self.is_coasting and silent > REPORTED_SILENCE:
            self.is_coasting = True
            self._note('imu', f'silent for {silent:.2f} s: going on by constant acceleration')
        while (stamp := self._history.stamp + COASTING_STEP) <= now:
            self._history.add_input(stamp, COASTING)

    def _corrected(
        self, stamp: float, state: FilterState, inertial: InertialInput, measurement: Measurement
    ) -> FilterState:
        """Return the state at a stamp corrected by a measurement of about then."""
        if measurement.level == association.OUTLIER and not measurement.spread:
            return state
        sensor, later = self._sensors[measurement.sensor], measurement.stamp - stamp
        innovation = sensors.innovation_of(
            sensor, state, inertial, later, measurement.value, measurement.variance)
        if measurement.level is None:
            self._decide(measurement, sensor.name, innovation.residual,
                         math.sqrt(innovation.variance),
                         association.GATE if inertial.measured else association.COASTING_GATE)
        if measurement.spread:
            covariance = state.covariance.copy()
            covariance[sensor.axes, sensor.axes] += measurement.spread ** 2
            return FilterState(state.mean, covariance)
        if measurement.level is None or measurement.level == association.OUTLIER:
            return state
        return innovation._replace(
            residual=innovation.residual - measurement.level).applied(state)

    def _decide(
        self, measurement: Measurement, name: str, residual: float, deviation: float, gate: float
    ) -> None:
        """Decide what a measurement belongs to, once."""
        verdict = self._associations[measurement.sensor].decide(
            measurement.stamp, residual, deviation, gate)
        measurement.level, measurement.spread = verdict.level, verdict.spread
        if verdict.event:
            self._note(name, verdict.event)

    def _start(self, now: float) -> None:
        """Start axes of which enough has been measured."""
        for index, collected in enumerate(self._collected):
            while collected and collected[-1][0] - collected[0][0] > start.PATIENCE:
                collected.popleft()
            axes = self._sensors[index].axes
            if not collected or self.started.issuperset(axes):
                continue
            if len(axes) > 1:
                self._start_wall(now)
            else:
                self._start_axis(index, axes[0])

    def _start_wall(self, now: float) -> None:
        """Start y and yaw by the distances, all of them or those that come."""
        distances = {k: sensor for k, sensor in enumerate(self._sensors)
                     if isinstance(sensor, sensors.DistanceSensor)}
        ready = [k for k in distances if self._is_ready(k)]
        first = min(one[0][0] for k in distances if (one := self._collected[k]))
        if len(ready) < len(distances) and now - first < start.PATIENCE or not ready:
            return
        found = start.start_at_wall(
            self._wall.distance, [distances[k].mounting for k in ready],
            [self._typical(k) for k in ready], [level.offset for level in self._levels.known])
        self._wall.distance = found.distance
        x, y, _ = self._setup.imu.mounting[:3]
        state = self._forgotten((Y, YAW))
        state.mean[Y] = found.y + math.sin(found.yaw) * x + math.cos(found.yaw) * y
        state.mean[YAW] = found.yaw
        if len(ready) == 1:
            state.covariance[YAW, YAW] = ONE_SIDED
        self._restart_from(state, (Y, YAW), f'start at {1e3 * found.distance:.0f} mm by '
                           f'{", ".join(distances[k].name for k in ready)}')
        self.started |= {Y, YAW}

    def _start_axis(self, index: int, axis: int) -> None:
        """Start one axis by a sensor of it alone; the first feature is where the rail is at 0."""
        sensor = self._sensors[index]
        state = self._forgotten((axis,))
        state.mean[axis] -= sensors.pose_at(state.mean, self._middle)[0][axis]
        value = self._typical(index)
        if isinstance(sensor, sensors.FeatureSensor):
            if not self._is_ready(index) or not self._wall.distance and self._has_distances:
                return
            (seen, _), _, _ = sensors.place(state.mean, sensor.lever)
            sensor.feature = seen + value if sensor.feature is None else sensor.feature
            value = sensor.feature - seen - value
        state.mean[axis] += value
        self._restart_from(state, (axis,), f'start by {sensor.name}')
        self.started.add(axis)

    def _is_ready(self, index: int) -> bool:
        """Return whether enough of a sensor has come to start by."""
        collected = self._collected[index]
        return (len(collected) >= start.FEWEST
                and collected[-1][0] - collected[0][0] >= start.PERIOD)

    def _typical(self, index: int) -> float:
        """Return the newest of what a sensor measured mostly in the last moments."""
        collected = self._collected[index]
        newest = collected[-1][0]
        return start.densest([
            value for stamp, value in collected if stamp >= newest - start.PERIOD])

    def _forgotten(self, axes: Sequence[int]) -> FilterState:
        """Return the newest state without what it knows of some axes and their velocities."""
        mean, covariance = map(np.copy, self._history.newest.state)
        for axis in axes:
            forget(covariance, slice(axis, axis + 1), ON_START[axis])
            if axis != YAW:
                velocity = VX + axis
                forget(covariance, slice(velocity, velocity + 1), VELOCITY)
                mean[velocity] = 0.0
        return FilterState(mean, covariance)

    def _restart_from(self, state: FilterState, axes: Sequence[int], reason: str) -> None:
        """Go on from another state at the newest time."""
        self._history.begin(self._history.stamp, state)
        names = ', '.join(AXES[axis] for axis in axes)
        self._note(names, reason)
        for index, sensor in enumerate(self._sensors):
            if set(axes) & set(sensor.axes):
                self._collected[index].clear()
                self.records[sensor.name].fitted = self._history.stamp

    def _find_lost(self) -> None:
        """Give up axes of which nothing has been measured for too long, or nothing that fits."""
        state = self._history.newest.state
        variances = np.diag(state.covariance)
        if not (np.isfinite(state.mean).all() and (variances >= 0.0).all()):
            self._note('all', 'the filter has diverged: everything starts again')
            self._restart_everything()
            return
        for axis in (X, Y, YAW):
            if axis in self.started:
                if variances[axis] > ALMOST_UNKNOWN * UNKNOWN[axis]:
                    self._give_up(axis, 'nothing has been measured of it for too long')
                elif self._is_locked_out(axis):
                    self._give_up(
                        axis, f'nothing that was measured for {association.LOST:g} s fits')
            elif variances[axis] > UNKNOWN[axis] / ALMOST_UNKNOWN:
                self._give_up(axis, '')

    def _is_locked_out(self, axis: int) -> bool:
        """Return whether measurements of an axis come, and none fits."""
        records = [self.records[sensor.name] for sensor in self._sensors if axis in sensor.axes]
        return (any(self._now - record.stamp < ARRIVING for record in records)
                and all(self._now - record.fitted > association.LOST for record in records))

    def _give_up(self, axis: int, reason: str) -> None:
        """Start an axis again; y with the yaw where distances measure both."""
        axes = (Y, YAW) if axis != X and self._has_distances else (axis,)
        state = self._forgotten(axes)
        for lost in axes:
            state.covariance[lost, lost] = UNKNOWN[lost]
        if reason:
            self._restart_from(state, axes, reason)
        else:
            self._history.begin(self._history.stamp, state)
        self.started.difference_update(axes)

    def _motion(self, stamp: float, state: FilterState, inertial: InertialInput) -> RailMotion:
        """Return the motion of the rail's middle."""
        mean, covariance = state
        pose, jacobian = sensors.pose_at(mean, self._middle)
        x, y, yaw = pose.tolist()
        here_x, here_y, _, vx, vy = mean[:VY + 1].tolist()
        along, across, turning = x - here_x, y - here_y, inertial.rates[2] - float(mean[RATE_Z])
        by_state = np.zeros((6, len(mean)))
        by_state[:3] = jacobian
        by_state[3, VX] = by_state[4, VY] = 1.0
        by_state[3:, RATE_Z] = turned = np.array((across, -along, -1.0))
        both = by_state @ covariance @ by_state.T
        noise = RATE_BANDWIDTH * self._setup.imu.gyroscope_noise ** 2
        return RailMotion(
            stamp, Pose(x, y, yaw), Twist(vx - turning * across, vy + turning * along, turning),
            both[:3, :3], both[3:, 3:] + noise * turned[:, None] * turned)

    def _note(self, subject: str, reason: str) -> None:
        self.events.append(EstimatorEvent(self._now, subject, reason))
