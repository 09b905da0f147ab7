"""
Estimator of the rail's pose on the façade, from an IMU and wall sensors.

The estimator is an extended Kalman filter over the last 0.4 s, driven by the IMU.
`rail_pose_model` contains the equations, and `history` puts late measurements in order.
`wall_depth_levels` finds the level of the wall to which a measurement belongs.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.covariance import used_variance
from facade_manipulator.estimation import rail_pose_model, start
from facade_manipulator.estimation.estimator_settings import EstimatorSetup
from facade_manipulator.estimation.history import History, mean_input, Measurement, Step
from facade_manipulator.estimation.imu_checks import (
    ImuGate,
    OLDEST_MEASUREMENT,
    SENSOR_CLOCK_TOLERANCE,
    YawComparison,
)
from facade_manipulator.estimation.rail_pose_model import WALL, X, Y, YAW
from facade_manipulator.estimation.wall_depth_levels import Channel, Level, OUTLIER
from facade_manipulator.kinematics import Pose, Twist


class EstimatorEvent(NamedTuple):
    """Event of the estimator: time [s], and a text that begins with the axis or the sensor."""

    stamp: float
    text: str


class RailMotion(NamedTuple):
    """Pose of the rail in `facade`, and its twist in the axes of `rail`."""

    stamp: float  #: [s]
    pose: Pose  #: [m, m, rad]
    covariance: np.ndarray  #: of the pose, shape (3, 3)
    twist: Twist  #: [m/s, m/s, rad/s]
    twist_covariance: np.ndarray  #: shape (3, 3)


class DisturbanceEstimator:
    """
    Extended Kalman filter for the pose and velocity of the rail.

    The node adds each measurement when it arrives, and calls `advance` in each cycle.
    """

    LONGEST_PAUSE_OF_CALLS = 0.5  # s between two calls, after which all axes restart
    # m², m², rad²: above these variances x, y and yaw count as unknown; ten times the variance is
    # then published
    GIVEN_UP = (0.1, 0.1, 0.01)
    # m², m², rad²: largest variances of x, y and yaw at the start, which grow until the next
    # measurement; a coarser measurement does not replace a guess
    COARSEST_START = (0.09, 0.09, 0.009)
    LOST = 1.0  # s of rejected measurements, after which an axis restarts
    # s without a measurement of the IMU, after which the filter coasts
    IMU_SILENCE = 0.1

    def __init__(self, setup: EstimatorSetup) -> None:
        self._gate = ImuGate(setup.imu)
        # each level once, the wall itself first; the distance sensors share the levels
        self._wall_offsets = list(dict.fromkeys((0.0, *setup.wall.levels)))
        levels: list[Level] = []
        if setup.wall.distance:
            levels += map(Level, self._wall_offsets)
        #: the sensors of the wall by their names
        self.channels: dict[str, Channel] = {}
        states: list[rail_pose_model.SensorState] = []
        for sensor in rail_pose_model.make_sensors(setup):
            own_levels = [Level(0.0)]
            if isinstance(sensor, rail_pose_model.DistanceSensor):
                own_levels = levels
            elif isinstance(sensor, rail_pose_model.FeatureSensor):
                own_levels = [Level(0.0)] if sensor.feature else []
            self.channels[sensor.name] = Channel(sensor, own_levels)
            states += sensor.states
        # they measure the same axes and share their levels
        self._distances: list[Channel] = []
        others: list[list[Channel]] = []
        for channel in self.channels.values():
            if isinstance(channel.sensor, rail_pose_model.DistanceSensor):
                self._distances.append(channel)
            else:
                others.append([channel])
        # sensors that start together
        self._groups = [self._distances, *others] if self._distances else others
        self._middle = rail_pose_model.pose_sensors(
            'rail', (0.0, 0.0, 0.0), 0.0, setup.imu
        )
        self._process = rail_pose_model.Process(setup.imu, states)
        #: axes of which a sensor has defined place 0; a restart keeps it
        self._origins: set[int] = set()
        #: those whose place 0 is where the rail was at the start
        self._guessed: set[int] = set()
        #: the newest events: (re)starts of axes, new levels, loss and return of the IMU
        self.events: deque[EstimatorEvent] = deque(maxlen=50)
        #: a wrong connection or unit, after which no estimates are published
        self.fault = ''
        self._now = -math.inf  # latest present time that was passed [s]
        self._reset()

    def _reset(self, reason: str = '') -> None:
        """Restart all axes; if an axis had started, record the reason as an event."""
        state = self._process.initial_state()
        if reason:
            self._note('all', f'{reason}: all axes restart')
            # the wall stays where it was found
            before = self._history.update().state
            variance = before.covariance[WALL, WALL]
            if variance >= 0.0:
                state.mean[WALL] = before.mean[WALL]
                state.covariance[WALL, WALL] = variance
        self._history: History = History(
            self._process, self._correct, self._now - OLDEST_MEASUREMENT
        )
        self._history.restart(state)
        self._gate.reset()
        self._comparison = YawComparison()
        self.started: set[int] = set()  #: axes that are known
        self.is_coasting = True  #: whether the filter runs without the IMU
        for channel in self.channels.values():
            channel.reset()

    def _set_time(self, now: float) -> None:
        """Set the present time [s]; restart all axes if the clock was set."""
        elapsed = now - self._now
        if not -SENSOR_CLOCK_TOLERANCE <= elapsed <= self.LONGEST_PAUSE_OF_CALLS:
            self._now = now
            is_first = not math.isfinite(elapsed)
            self._reset('' if is_first else f'the clock advanced by {elapsed:.3f} s')
        self._now = max(now, self._now)

    def add_imu(
        self, now: float, stamp: float, rates: Sequence[float], forces: Sequence[float]
    ) -> None:
        """
        Add angular rates [rad/s] and specific forces [m/s²] in the axes of the IMU.

        The filter uses the mean of this and the previous measurement for the time between them.
        The comparison of yaws integrates the turning rate about z.

        Raises the InputErrors of `ImuGate.check`.
        """
        self._set_time(now)
        before = self._gate.stamp
        last = self._gate.newest
        stamp, newest = self._gate.check(now, stamp, rates, forces)
        mean = mean_input(last or newest, newest, 0.5)
        # The first interval is infinite; any value is suitable, because only changes are compared.
        self._comparison.turned += newest[2] * min(stamp - before, self.IMU_SILENCE)
        if self.is_coasting:
            self.is_coasting = False
            self._note('imu', 'measuring')
        if stamp > self._history.oldest:
            self._history.add_input(stamp, mean)

    def add(
        self,
        name: str,
        now: float,
        stamp: float,
        value: float,
        variance: float = 0.0,
    ) -> None:
        """
        Add a sensor's measurement [m or rad] and its variance [m² or rad²], 0 if unknown.

        Raises
        ------
        InputError
            With reason ``'not_finite'``, ``'unit'``, ``'stale'``, ``'future'`` or
            ``'out_of_order'``.

        """
        self._set_time(now)
        channel = self.channels[name]
        sensor = channel.sensor
        stamp = channel.receive(now, stamp, value)
        if isinstance(sensor, rail_pose_model.DistanceSensor) and not self.fault:
            place = sensor.lever[0]
            self.fault = self._comparison.add_distance(place, stamp, value)
            if self.fault:
                self._note('all', self.fault)

        variance = used_variance(variance, sensor.noise)
        if self._is_starting(channel):
            axis = sensor.axes[0]
            if axis in self._guessed and variance > self.COARSEST_START[axis]:
                channel.counts['too uncertain'] += 1
            else:
                channel.first.add(stamp, value, variance)
        elif self._can_use(channel) and stamp > self._history.oldest:
            self._history.add_measurement(Measurement(name, stamp, value, variance))

    def advance(self, now: float) -> RailMotion | None:
        """
        Return the motion of the rail at the newest step, which may be before `now`.

        None while no axis is known, or after a fault.
        """
        self._set_time(now)
        # by arrival, because the stamps of a late IMU would always seem old
        silence = now - self._gate.arrival
        if silence > self.IMU_SILENCE:
            if not self.is_coasting:
                self.is_coasting = True
                self._note(
                    'imu',
                    f'silent for {silence:.2f} s: the filter runs without the IMU',
                )
            self._history.add_input(self._now, None)

        for group in self._groups:
            if self._is_starting(group[0]):
                self._start(group)
        self._give_up_lost_axes()
        if self.fault or not self.started:
            return None
        return self._motion(self._history.update())

    def delays(self) -> dict[str, tuple[float, float]]:
        """Return the estimated delay of each fix, and its standard deviation [s]."""
        mean, covariance = self._history.update().state
        delays = {}
        for name, channel in self.channels.items():
            sensor = channel.sensor
            if isinstance(sensor, rail_pose_model.FeatureSensor):
                index = sensor.first + 1
                deviation = math.sqrt(covariance[index, index])
                delays[name] = (sensor.delay + float(mean[index]), deviation)
        return delays

    def _correct(
        self, step: Step, measurement: Measurement
    ) -> rail_pose_model.FilterState:
        """Return the state of a step after correction with a measurement."""
        state = step.state
        channel = self.channels[measurement.sensor]
        if measurement.level != OUTLIER:
            time_offset = measurement.stamp - step.stamp  # 0 or negative
            expected, jacobian = channel.sensor.expect(state.mean.tolist(), time_offset)
            # dot() takes half the time of @ for vectors
            cross = state.covariance.dot(jacobian)
            known = max(float(cross.dot(jacobian)), 0.0)
            variance = known + measurement.variance
            residual = measurement.value - expected
            if math.isnan(measurement.level):
                deviation = math.sqrt(variance)
                event = channel.decide(measurement, residual, deviation, not step.imu)
                if event:
                    self._note(measurement.sensor, event)
            if measurement.level != OUTLIER:
                residual -= measurement.level
                excess = known - measurement.level_variance
                if excess <= 0.0:
                    return state
                # the share of the reduction known² / variance that leaves the level's variance
                share = min(excess * variance / known**2, 1.0)
                return rail_pose_model.update(state, cross, variance, residual, share)

        if measurement.spread:
            covariance = state.covariance.copy()
            axes = channel.sensor.axes
            covariance[axes, axes] += measurement.spread**2
            state = rail_pose_model.FilterState(state.mean, covariance)
        return state

    def _is_starting(self, channel: Channel) -> bool:
        """
        Return whether the measurements of a sensor define a place, or replace a guess.

        A pose up to `COARSEST_START` replaces a guess, although the guess has a smaller variance.
        The guess chooses place 0, and its variance describes only the motion of the rail since
        then. Only the pose relates the rail to the façade.
        """
        axes = channel.sensor.axes
        is_better = channel.is_absolute and not self._guessed.isdisjoint(axes)
        is_wall_unknown = channel in self._distances and not channel.levels
        return is_better or is_wall_unknown or not self.started.issuperset(axes)

    def _can_use(self, channel: Channel) -> bool:
        """Return whether the place of a feature does not depend on an unknown wall distance."""
        is_feature = isinstance(channel.sensor, rail_pose_model.FeatureSensor)
        return not (is_feature and self._distances and not self._distances[0].levels)

    def _start(self, group: list[Channel]) -> None:
        """Start the axes of a sensor group, or find its wall, after sufficient measurements."""
        ready = [one for one in group if one.first.suffice(self._now)]
        begin = min(one.first.begin for one in group)
        is_waiting = len(ready) < len(group) and self._now - begin < start.LONGEST_START
        if not ready or is_waiting or not self._can_use(ready[0]):
            return
        sensor = ready[0].sensor
        axis = sensor.axes[0]
        is_guess = not ready[0].levels and axis not in self.started
        if is_guess and not self._can_define_origin(axis):
            return

        state = self._history.update().state
        if axis in self._guessed and ready[0].is_absolute:
            self._withdraw_guess(axis)
        axes = [one for one in sensor.axes if one not in self.started]
        state = self._process.forget(state, axes)
        if isinstance(sensor, rail_pose_model.DistanceSensor):
            state = self._place_before_wall(state, ready)
        else:
            self._place_at(state, ready[0])
        self._history.restart(state)
        self._note_start(ready, axes)
        self.started.update(axes)
        self._origins.add(axis)
        if is_guess:
            self._guessed.add(axis)

        for channel in self.channels.values():
            if not set(sensor.axes).isdisjoint(channel.sensor.axes):
                channel.first = start.FirstMeasurements()
                channel.accept(self._now)

    def _note_start(self, ready: Sequence[Channel], axes: Sequence[int]) -> None:
        """Record which axes some sensors have started, and the distance of their wall."""
        sensor = ready[0].sensor
        names = ', '.join(one.sensor.name for one in ready)
        event = f'started by {names}'
        if isinstance(sensor, rail_pose_model.DistanceSensor):
            distance = f'{1e3 * sensor.distance:.0f} mm'
            event += f', {distance} from the wall'
            if not axes:
                self._note(names, f'wall found at {distance}')
                return
        self._note(_names(axes), event)

    def _withdraw_guess(self, axis: int) -> None:
        """Forget an axis that began at 0, and the places on the wall that depend on it."""
        self._note(_names([axis]), 'the place assumed at the start is replaced')
        self._guessed.discard(axis)
        self.started.discard(axis)
        for channel in self.channels.values():
            if axis in channel.sensor.axes and not channel.is_absolute:
                channel.forget_place()

    def _place_before_wall(
        self, state: rail_pose_model.FilterState, ready: Sequence[Channel]
    ) -> rail_pose_model.FilterState:
        """
        Return a state whose unknown axes are set from the distance sensors.

        An unknown wall distance is computed from y, and contains the error of y. If y is unknown,
        the rail is at y = 0 and the distance counts as exact.
        """
        middle = self._middle[X].lever
        mountings = np.subtract([one.sensor.lever for one in ready], middle)
        values = [one.first.densest() for one in ready]
        levels = ready[0].levels
        offsets = [level.offset for level in levels] or self._wall_offsets

        y = 0.0
        if Y in self.started:
            y, by_state = self._middle[Y].expect(state.mean.tolist(), 0.0)
            if not levels:
                state = self._process.find_wall(state, by_state)
        wall = 0.0  # m, distance of the wall; 0 is unknown
        if levels:
            wall = ready[0].sensor.distance + state.mean[WALL]
        distance, found_y, found_yaw = start.start_at_wall(
            wall, mountings, values, offsets, y, state.mean[YAW]
        )
        if not levels:
            # all distance sensors share the list
            levels += map(Level, offsets)
            for channel in self.channels.values():
                channel.sensor.distance = distance
        if YAW not in self.started:
            state.mean[YAW] = found_yaw
        if Y not in self.started:
            y = found_y
        state.mean[Y] += self._middle[Y].shift(state.mean, y)
        return state

    def _can_define_origin(self, axis: int) -> bool:
        """
        Return whether a sensor without a known place may put the rail at place 0 of an axis.

        For 1 s from its first measurement, a sensor with a known place takes precedence. After a
        restart place 0 is defined, and the rail may be elsewhere.
        """
        if axis in self._origins:
            return False
        for channel in self.channels.values():
            if axis not in channel.sensor.axes or not channel.is_absolute:
                continue
            begin = channel.first.begin  # infinite before the first measurement
            if math.isfinite(begin) and self._now - begin < start.LONGEST_START:
                return False
        return True

    def _place_at(self, state: rail_pose_model.FilterState, channel: Channel) -> None:
        """
        Set the axis that a sensor measures, to explain its first measurements [m or rad].

        The axis is as uncertain as these measurements, up to `COARSEST_START`.
        """
        sensor = channel.sensor
        value = channel.first.densest()  # m or rad
        if isinstance(sensor, rail_pose_model.FeatureSensor) and not channel.levels:
            # the rail is at 0, and the feature is where the sensor sees it
            state.mean[X] += self._middle[X].shift(state.mean, 0.0)
            sensor.feature -= sensor.shift(state.mean, value)
            channel.levels.append(Level(0.0))
        value -= channel.levels[0].offset
        axis = sensor.axes[0]
        state.mean[axis] += sensor.shift(state.mean, value)
        variance = min(channel.first.variance, self.COARSEST_START[axis])
        state.covariance[axis, axis] = max(variance, state.covariance[axis, axis])

    def _give_up_lost_axes(self) -> None:
        """Restart each axis that had no accepted measurement for too long."""
        variances = self._history.update().state.covariance.diagonal().tolist()
        if not min(variances) >= 0.0:
            self._reset('the filter has diverged')
            return
        for axis in (X, Y, YAW):
            # Rounding of the variance of an unknown axis would corrupt the other axes.
            if variances[axis] > self.GIVEN_UP[axis]:
                reason = 'restarted: not measured for too long'
            elif axis in self.started and self._is_locked_out(axis):
                reason = f'restarted: no measurement was accepted for {self.LOST:g} s'
            else:
                continue
            axes: tuple[int, ...] = (axis,)
            if axis != X and axis in self.started and self._distances:
                axes = (Y, YAW)  # the distances start both
            state = self._process.forget(self._history.update().state, axes)
            self._history.restart(state)
            if axis in self.started:
                self._note(_names(axes), reason)
                self.started.difference_update(axes)

    def _is_locked_out(self, axis: int) -> bool:
        """
        Return whether all measurements of an axis were rejected for `LOST` [s].

        A silence does not count: the variance then grows up to `GIVEN_UP`.
        """
        channels = [one for one in self.channels.values() if axis in one.sensor.axes]
        is_rejected = any(one.rejected_for > self.LOST for one in channels)
        return is_rejected and all(
            self._now - one.fitted > self.LOST for one in channels
        )

    def _motion(self, step: Step) -> RailMotion:
        """Return the motion of the rail's midpoint [m, rad, s]."""
        mean, covariance = step.state
        values = mean.tolist()
        by_state = np.zeros((6, len(mean)))  # derivatives of pose and twist
        pose = []
        for axis, sensor in enumerate(self._middle):
            value, by_state[axis] = sensor.expect(values, 0.0)
            pose.append(value)

        # velocity of the middle along the axes of the rail: R(ψ)ᵀ v + ω × lever
        x, y, z = self._middle[X].lever
        cosine = math.cos(pose[YAW])
        sine = math.sin(pose[YAW])
        by_state[3, rail_pose_model.RATES] = (cosine, sine, -y)
        by_state[4, rail_pose_model.RATES] = (-sine, cosine, x)
        by_state[5, rail_pose_model.RATES] = (0.0, 0.0, 1.0)
        # The IMU measures ω_x and ω_y, which are not states. Without it their mean is 0.
        rate_x = 0.0
        rate_y = 0.0
        with_imu, without_imu = self._process.tilt_rate_variances
        if step.imu:
            rate_x, rate_y, *_ = step.imu
            by_state[3, rail_pose_model.GYROSCOPE_Y] = -z
            by_state[4, rail_pose_model.GYROSCOPE_X] = z
        twist = (by_state[3:] @ mean + (z * rate_y, -z * rate_x, 0.0)).tolist()

        both = by_state @ covariance @ by_state.T
        both[[3, 4], [3, 4]] += z**2 * (with_imu if step.imu else without_imu)
        for axis in {X, Y, YAW} - self.started:
            both[axis, axis] += 10.0 * self.GIVEN_UP[axis]
        return RailMotion(
            step.stamp, Pose(*pose), both[:3, :3], Twist(*twist), both[3:, 3:]
        )

    def _note(self, subject: str, reason: str) -> None:
        self.events.append(EstimatorEvent(self._now, f'{subject}: {reason}'))


def _names(axes: Sequence[int]) -> str:
    return ', '.join(Pose._fields[axis] for axis in axes)
