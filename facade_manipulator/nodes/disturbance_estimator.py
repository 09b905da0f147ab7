"""The disturbance estimator node: raw sensors on the rail in, where the rail is out."""

from __future__ import annotations

from functools import partial
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import numpy as np
from rclpy.node import Node

from facade_manipulator import interfaces
from facade_manipulator.estimation.association import SensorRecord
from facade_manipulator.estimation.estimator import DisturbanceEstimator, RailMotion
from facade_manipulator.estimation.messages import FIX, IMU, Input, inputs, POSE, RANGE
from facade_manipulator.estimation.settings import EstimatorSetup, SensorNames
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import planar_numbers
from facade_manipulator.nodes.parameters import declare
from facade_manipulator.ros.clocks import steady_timer
from facade_manipulator.ros.codec import (
    Codec,
    estimate_codec,
    IMU_FIELDS,
    odometry_codec,
    POINT_FIELDS,
    RANGE_FIELDS,
    SensorReader,
)
from facade_manipulator.ros.conversions import frames, node_time
from facade_manipulator.ros.diagnostics import diagnostic_status, DiagnosticsPublisher, Rejections
from facade_manipulator.ros.interfaces import class_of, publisher
from facade_manipulator.ros.message_queues import MessageQueue
from facade_manipulator.ros.publisher_watch import PublisherWatch
from facade_manipulator.ros.runtime import run

WAITING = 100  # messages of a sensor from one estimate to the next: 1000 Hz for 0.1 s
SILENT = 1.0  # s without a measurement of a sensor
MOST_OUTLIERS = 0.5  # share of the measurements of a sensor since it was looked at last
# of x, y and yaw in a covariance of six
PLANAR = [6 * row + column for row in (0, 1, 5) for column in (0, 1, 5)]
INTERFACES: dict[Input, interfaces.Topic] = {
    IMU: interfaces.IMU, RANGE: interfaces.RANGE_1,
    FIX: interfaces.FIX_X, POSE: interfaces.FIX_POSE}
FIELDS = {IMU: IMU_FIELDS, RANGE: RANGE_FIELDS,
          FIX: POINT_FIELDS}
SCALES = (1e3, 1e3, math.degrees(1.0))  # mm and degrees of metres and radians


class DisturbanceEstimatorNode(Node):
    """
    Publish where the rail is at a rate, by what has come until then.

    The sensors wake nobody: to be called for each measurement costs more than to make use of it.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('disturbance_estimator', **kwargs)
        names = declare(self, SensorNames)
        setup = EstimatorSetup.read(names, partial(declare, self))
        self._estimator = DisturbanceEstimator(setup)
        self._motion: RailMotion | None = None
        self._published = -math.inf
        self._seen: dict[str, tuple[int, int]] = {}
        self._logged = 0.0
        self._rejections = Rejections(self)
        self._sources = PublisherWatch(self, self._rejections)
        self._frames = frames(self)
        self._codec = odometry_codec(
            'disturbance_odometry', self._frames.facade, self._frames.rail)
        self._odometry = publisher(self, interfaces.DISTURBANCE_ODOMETRY)
        self._queues = [
            ((taken, name, self._reader(taken, name)),
             MessageQueue(self, INTERFACES[taken]._replace(name=name), WAITING))
            for name, taken in inputs(setup).items()]
        for (_, name, _), _ in self._queues:
            self._sources.watch(name)
        self._diagnostics = DiagnosticsPublisher(self, self._components)
        steady_timer(self, 1.0 / names.rate, self._publish)

    def _reader(self, taken: Input, name: str) -> Codec | SensorReader:
        if taken is POSE:
            return estimate_codec(name, self._frames.facade)
        return SensorReader(
            class_of(INTERFACES[taken]), FIELDS[taken], taken.numbers_of, name)

    def _publish(self) -> None:
        now = self._take()
        motion = self._motion = self._estimator.advance(now)
        if motion is not None and motion.stamp != self._published:
            self._published = motion.stamp
            self._odometry.publish(self._codec.write(motion.stamp, odometry_numbers(motion)))
        self._log_events()

    def _take(self) -> float:
        """Hand over what has come; return the time then [s], which is later than all of it."""
        received = [(source, data) for source, queue in self._queues for _, data in queue.take()]
        now = node_time(self)
        for (taken, name, reader), data in received:
            with self._rejections:
                self._sources.require_sole(name)
                taken.add(self._estimator, name, now, *reader.read(data))
        return now

    def _log_events(self) -> None:
        new = [event for event in self._estimator.events if event.stamp > self._logged]
        for event in new:
            self.get_logger().info(f'{event.subject}: {event.reason}')
            self._logged = event.stamp

    def _components(self) -> list[DiagnosticStatus]:
        now = node_time(self)
        delays = self._estimator.delays() if self._estimator.started else {}
        return [self._summary(), *(
            self._sensor(name, record, now, delays.get(name))
            for name, record in self._estimator.records.items())]

    def _summary(self) -> DiagnosticStatus:
        estimator, motion = self._estimator, self._motion
        values: dict[str, Any] = dict(self._rejections.values())
        values |= {f'event {event.stamp:.2f}': f'{event.subject}: {event.reason}'
                   for event in list(estimator.events)[-5:]}
        if self._sources.fault:
            return diagnostic_status('motion', 'error', self._sources.fault, values)
        if motion is None:
            return diagnostic_status(
                'motion', 'error', estimator.fault or 'nothing has been measured yet', values)
        for axis, scale, unit, variance in zip(
                Pose._fields, SCALES, ('mm', 'mm', 'deg'), np.diag(motion.covariance),
                strict=True):
            values[f'standard deviation of {axis} [{unit}]'] = scale * math.sqrt(variance)
        if lost := [axis for k, axis in enumerate(Pose._fields) if k not in estimator.started]:
            return diagnostic_status(
                'motion', 'error', f'{", ".join(lost)}: not known', values)
        if estimator.is_coasting:
            return diagnostic_status(
                'motion', 'warn', 'without an inertial sensor: constant acceleration', values)
        return diagnostic_status('motion', 'ok', 'estimating', values)

    def _sensor(
        self, name: str, record: SensorRecord, now: float,
        delay: tuple[float, float] | None,
    ) -> DiagnosticStatus:
        counts = record.counts
        used, outliers = counts['used'] + counts['other level'], counts['outlier']
        before = self._seen.get(name, (0, 0))
        self._seen[name] = used, outliers
        state = sensor_state(now - record.stamp, used - before[0], outliers - before[1])
        return diagnostic_status(f'sensor {name}', *state, {
            'rate [Hz]': 1.0 / record.period if record.period else math.nan,
            'age when it comes [ms]': 1e3 * record.age,
            'normalised innovation squared': record.square,
            **({} if delay is None else {
                'delay found [ms]': f'{1e3 * delay[0]:.1f} +- {1e3 * delay[1]:.1f}'}),
            **{f'measurements: {kind}': count for kind, count in sorted(counts.items())}})


def sensor_state(age: float, used: int, outliers: int) -> tuple[str, str]:
    """Return level and message by the newest measurement's age [s] and how many were which."""
    if not math.isfinite(age):
        return 'ok', 'nothing has come of it'
    if age >= SILENT:
        return 'warn', 'silent or rejected'
    if outliers > MOST_OUTLIERS * (used + outliers):
        return 'warn', 'most of it fits nothing'
    return 'ok', 'measuring'


def odometry_numbers(motion: RailMotion) -> list[float]:
    """Return the numbers of an Odometry: the twist is along the axes of the rail."""
    cosine, sine = math.cos(motion.pose.theta), math.sin(motion.pose.theta)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    covariances = np.zeros((2, 36))
    covariances[0, PLANAR] = motion.covariance.reshape(-1)
    covariances[1, PLANAR] = (turn @ motion.velocity_covariance @ turn.T).reshape(-1)
    pose, twist = covariances.tolist()
    along, across, turning = (turn @ motion.velocity).tolist()
    return [*planar_numbers(motion.pose), *pose, along, across, 0.0, 0.0, 0.0, turning, *twist]


main = partial(run, lambda: [DisturbanceEstimatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
