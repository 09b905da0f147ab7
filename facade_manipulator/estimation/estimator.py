"""
The pose of the rail on the façade, from an IMU and sensors of the wall.

An error-state Kalman filter over the last moments: `model` has the equations, `history` puts late
measurements in order, `channel` finds the level of the wall to which a measurement belongs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.estimation import model, start
from facade_manipulator.estimation.channel import (
    Channel,
    COASTING_GATE,
    GATE,
    OUTLIER,
    wall_levels,
)
from facade_manipulator.estimation.history import History, mean_input, Measurement, Step
from facade_manipulator.estimation.inputs import ImuGate, LEAD, OLDEST, YawComparison
from facade_manipulator.estimation.model import X, Y, YAW
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.kinematics import Pose, Twist

COASTING_STEP = 0.005  # s, without an IMU
LONGEST_GAP = 0.5  # s without a call, after which everything starts again
ONE_SIDED = 0.05 ** 2  # rad², variance of the first yaw by one distance
UNKNOWN = (1.0, 1.0, 0.1)  # m², m², rad²: published for x, y and yaw that are not known
GIVEN_UP = (0.1, 0.1, 0.01)  # m², m², rad²: variances from which on an axis is no longer known
LOST = 1.0  # s without a measurement that fits, after which an axis starts again
ARRIVING = 0.5  # s, age of the newest measurement of a sensor that works
EVENTS = 50  # newest ones that are kept
SILENCE = 0.03  # s without a measurement of the IMU, after which the filter coasts
REPORTED_SILENCE = 0.1  # s; a shorter silence is bridged without an event


class EstimatorEvent(NamedTuple):
    """An event of an axis or a sensor and its time [s]."""

    stamp: float
    subject: str
    reason: str


class RailMotion(NamedTuple):
    """Pose of the rail in `facade`, and its twist along the axes of `rail`."""

    stamp: float  #: [s]
    pose: Pose  #: [m, m, rad]
    covariance: np.ndarray  #: of the pose, shape (3, 3)
    twist: Twist  #: [m/s, m/s, rad/s]
    twist_covariance: np.ndarray  #: shape (3, 3)


class DisturbanceEstimator:
    """Estimate pose and velocity of the rail."""

    def __init__(self, setup: EstimatorSetup) -> None:
        self._imu_place = setup.imu.mounting[:3]
        self._to_middle = [-coordinate for coordinate in self._imu_place]
        self._gate, self._wall = ImuGate(setup.imu), model.Wall(setup.wall.distance)
        self._levels = wall_levels(setup.wall.levels)
        sensors = model.make_sensors(setup, self._wall)
        #: the sensors of the wall by their names
        self.channels = {sensor.name: Channel(
            sensor, self._levels if sensor.name in setup.distances else wall_levels())
            for sensor in sensors}
        self._distances = [self.channels[name] for name in setup.distances]
        self._groups = [self._distances] * bool(self._distances) + [  # that start together
            [channel] for name, channel in self.channels.items() if name not in setup.distances]
        self._process = model.Process(
            setup.imu, [state for sensor in sensors for state in sensor.states])
        #: the newest: starts and restarts of axes, new levels, the IMU silent and back
        self.events: deque[EstimatorEvent] = deque(maxlen=EVENTS)
        #: a wrong connection or unit that spoils all estimates: there are none any longer
        self.fault = ''
        self._now = -math.inf
        self._reset()

    def _reset(self) -> None:
        self._history = History(self._process, self._correct, self._now - OLDEST)
        self._gate.stamp = self._imu_arrival = -math.inf
        self._last_input: tuple[float, ...] = ()
        self._comparison = YawComparison()
        self.started: set[int] = set()  #: axes that are known
        self.is_coasting = True  #: whether the filter runs without the IMU
        for channel in self.channels.values():
            channel.reset()

    def _set_time(self, now: float) -> None:
        """Set the present time [s]; reset everything if the clock was set."""
        elapsed = now - self._now
        if not -LEAD <= elapsed <= LONGEST_GAP:
            if math.isfinite(self._now):
                self._note('all', f'the clock advanced by {elapsed:.3f} s: all axes start again')
            self._now = now
            self._reset()
        self._now = max(now, self._now)

    def add_imu(
        self, now: float, stamp: float, rates: Sequence[float], forces: Sequence[float]
    ) -> None:
        """
        Add turning rates [rad/s] and specific forces [m/s²] along the axes of the IMU.

        Raises an InputError as `ImuGate.check`.
        """
        self._set_time(now)
        before = self._gate.stamp
        stamp, newest = self._gate.check(now, stamp, rates, forces)
        self._imu_arrival = now
        mean = newest
        if stamp - before < SILENCE:
            mean = mean_input(self._last_input, newest, 0.5)
            self._comparison.add_rate(newest[2], stamp - before)
        self._last_input = newest
        if self.is_coasting:
            self.is_coasting = False
            self._note('imu', 'measuring')
        if stamp > self._history.oldest:
            self._history.add_input(stamp, mean)

    def add(
        self, name: str, now: float, stamp: float, value: float, variance: float | None = None
    ) -> None:
        """
        Add a measurement of a sensor of the wall, with its variance if that is known.

        Raises
        ------
        InputError
            With reason ``'not_finite'``, ``'unit'``, ``'stale'``, ``'future'`` or
            ``'out_of_order'``.

        """
        self._set_time(now)
        channel = self.channels[name]
        sensor, stamp = channel.sensor, channel.receive(now, stamp, value)
        if isinstance(sensor, model.DistanceSensor) and not self.is_coasting and not self.fault:
            self.fault = self._comparison.add_distance(sensor.lever[0], stamp, value)
            if self.fault:
                self._note('all', self.fault)
        if not self.started.issuperset(sensor.axes):
            channel.first.add(stamp, value)
        elif stamp > self._history.oldest:
            if isinstance(sensor, model.FeatureSensor) and sensor.feature is None:
                sensor.locate_feature(self._history.newest.state.mean.tolist(), value)
            self._history.add_measurement(Measurement(
                name, stamp, value, sensor.noise ** 2 if variance is None else variance))

    def advance(self, now: float) -> RailMotion | None:
        """Return the newest motion of the rail; None before a start or after a fault."""
        self._set_time(now)
        silence = now - self._imu_arrival  # by arrival: a late IMU would be overtaken each time
        if silence > SILENCE:
            if not self.is_coasting and silence > REPORTED_SILENCE:
                self.is_coasting = True
                self._note('imu', f'silent for {silence:.2f} s: constant acceleration is assumed')
            while (stamp := self._history.stamp + COASTING_STEP) <= now:
                self._history.add_input(stamp, None)
        for group in self._groups:
            if not self.started.issuperset(group[0].sensor.axes):
                self._start(group)
        self._give_up_lost_axes()
        return None if self.fault or not self.started else self._motion(self._history.newest)

    def delays(self) -> dict[str, tuple[float, float]]:
        """Return the estimated delay of each fix and its standard deviation [s]."""
        mean, covariance = self._history.newest.state
        return {name: (sensor.delay + float(mean[sensor.first + 1]),
                       math.sqrt(covariance[sensor.first + 1, sensor.first + 1]))
                for name, channel in self.channels.items()
                if isinstance(sensor := channel.sensor, model.FeatureSensor)}

    def _correct(self, step: Step, measurement: Measurement) -> model.FilterState:
        """Return the state of a step after a measurement of about that time."""
        state, channel = step.state, self.channels[measurement.sensor]
        if measurement.level == OUTLIER and not measurement.spread:
            return state
        expected, jacobian = channel.sensor.expect(
            state.mean.tolist(), measurement.stamp - step.stamp)
        cross = state.covariance.dot(jacobian)  # of vectors in half of the time of @
        variance = max(float(cross.dot(jacobian)), 0.0) + measurement.variance
        residual = measurement.value - expected
        if measurement.level is None:
            event = channel.decide(
                measurement, residual, math.sqrt(variance), GATE if step.imu else COASTING_GATE)
            if event:
                self._note(measurement.sensor, event)
        if measurement.spread:
            covariance = state.covariance.copy()
            axes = channel.sensor.axes
            covariance[axes, axes] += measurement.spread ** 2
            return model.FilterState(state.mean, covariance)
        if measurement.level is None or measurement.level == OUTLIER:
            return state
        return model.update(state, cross, variance, residual - measurement.level)

    def _start(self, group: list[Channel]) -> None:
        """Start the axes that sensors measure together, once enough has been measured."""
        spans = [one.first.span(self._now) for one in group]
        ready = [one for one, span in zip(group, spans, strict=True) if span >= start.PERIOD]
        if not ready or (len(ready) < len(group) and max(spans) < start.PATIENCE):
            return
        sensor = ready[0].sensor
        state, values = self._without(sensor.axes), [one.first.densest() for one in ready]
        reason = f'started by {", ".join(one.sensor.name for one in ready)}'
        if isinstance(sensor, model.DistanceSensor):
            self._wall.distance, y, yaw = start.start_at_wall(
                self._wall.distance, np.add([one.sensor.lever for one in ready], self._imu_place),
                values, [level.offset for level in self._levels])
            along, across, _ = self._imu_place
            state.mean[Y] = y + math.sin(yaw) * along + math.cos(yaw) * across
            state.mean[YAW] = yaw
            if len(ready) == 1:
                state.covariance[YAW, YAW] = ONE_SIDED
            reason += f', {1e3 * self._wall.distance:.0f} mm from the wall'
        else:
            if isinstance(sensor, model.FeatureSensor):
                if self._distances and not self._wall.distance:
                    return  # the place of the feature depends on it
                if sensor.feature is None:  # the rail begins at 0
                    state.mean[X] -= model.pose_at(state.mean.tolist(), self._to_middle)[0][X]
                    sensor.locate_feature(state.mean.tolist(), values[0])
            axis, = sensor.axes
            expected, jacobian = sensor.observe(state.mean.tolist())
            state.mean[axis] += (values[0] - expected) / jacobian[axis]
        self._restart(state, sensor.axes, reason)
        self.started.update(sensor.axes)

    def _without(self, axes: Sequence[int]) -> model.FilterState:
        """Return the newest state without knowledge of some axes and their velocities."""
        mean, covariance = map(np.copy, self._history.newest.state)
        for axis in axes:
            model.forget(covariance, axis, model.POSE_ON_START[axis])
            if axis != YAW:
                model.forget(covariance, model.VX + axis, model.VELOCITY_ON_START)
                mean[model.VX + axis] = 0.0
        return model.FilterState(mean, covariance)

    def _restart(self, state: model.FilterState, axes: Sequence[int], reason: str) -> None:
        """Continue from another state of some axes at the newest time."""
        self._history.restart(state)
        self._note(', '.join(Pose._fields[axis] for axis in axes), reason)
        for channel in self.channels.values():
            if set(axes) & set(channel.sensor.axes):
                channel.first = start.FirstMeasurements()
                channel.fitted = self._history.stamp

    def _give_up_lost_axes(self) -> None:
        """Start axes again that nothing has measured for too long, or nothing that fits."""
        mean, covariance = self._history.newest.state
        variances = covariance.diagonal().tolist()
        if not (math.isfinite(sum(mean.tolist())) and all(one >= 0.0 for one in variances)):
            self._note('all', 'the filter has diverged: all axes start again')
            self._reset()
            return
        for axis in (X, Y, YAW):
            axes = (Y, YAW) if axis != X and self._distances else (axis,)
            if axis not in self.started:
                if variances[axis] > 100.0 * GIVEN_UP[axis]:  # rounding would spoil the others
                    self._history.restart(self._without(axes))
                continue
            if variances[axis] > GIVEN_UP[axis]:
                reason = 'given up: not measured for too long'
            elif self._is_locked_out(axis):
                reason = f'given up: no measurement has fitted for {LOST:g} s'
            else:
                continue
            self._restart(self._without(axes), axes, reason)
            self.started.difference_update(axes)

    def _is_locked_out(self, axis: int) -> bool:
        """Return whether measurements of an axis arrive and none fits."""
        channels = [one for one in self.channels.values() if axis in one.sensor.axes]
        return (any(self._now - one.stamp < ARRIVING for one in channels)
                and all(self._now - one.fitted > LOST for one in channels))

    def _motion(self, step: Step) -> RailMotion:
        """Return the motion of the rail's middle."""
        mean, covariance = step.state
        x, y, _ = self._to_middle
        values = mean.tolist()
        pose, *_ = model.pose_at(values, self._to_middle)
        cosine, sine = math.cos(pose[YAW]), math.sin(pose[YAW])
        by_state = np.zeros((6, len(mean)))
        by_state[:3] = model.pose_jacobian(values, self._to_middle)
        by_state[3:, model.RATES] = (cosine, sine, -y), (-sine, cosine, x), (0.0, 0.0, 1.0)
        both = by_state @ covariance @ by_state.T
        for axis in {X, Y, YAW} - self.started:
            both[axis, axis] += UNKNOWN[axis]
        return RailMotion(step.stamp, Pose(*pose), both[:3, :3],
                          Twist(*(by_state[3:] @ mean).tolist()), both[3:, 3:])

    def _note(self, subject: str, reason: str) -> None:
        self.events.append(EstimatorEvent(self._now, subject, reason))
