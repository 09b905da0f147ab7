"""Disturbance_estimator node: receives raw sensor data, publishes the pose of the rail."""

from __future__ import annotations

from functools import partial
import math
from time import monotonic
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import Imu, Range

from facade_manipulator import topics
from facade_manipulator.covariance import is_measured
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.estimation.estimator_settings import EstimatorSetup
from facade_manipulator.estimation.imu_checks import LARGEST_FORCE, LARGEST_RATE
from facade_manipulator.estimation.rail_pose_filter import (
    DisturbanceEstimator,
    RailMotion,
)
from facade_manipulator.estimation.wall_depth_levels import Channel
from facade_manipulator.kinematics import Pose
from facade_manipulator.kinematics.planar import POSE_AXES
from facade_manipulator.nodes.base_node import BaseNode
from facade_manipulator.nodes.conversions import (
    fill_pose,
    stamp,
    steady_seconds,
    steady_timer,
    system_time,
)
from facade_manipulator.nodes.diagnostics import diagnostic_status, Diagnostics
from facade_manipulator.nodes.node_parameters import NodeParameters
from facade_manipulator.nodes.node_subscriptions import PublisherWatch
from facade_manipulator.nodes.planar_messages import (
    estimated_pose,
    Frames,
    not_measured_error,
    require_measured,
)
from facade_manipulator.nodes.run import run
from facade_manipulator.rejections import Rejections


class DisturbanceEstimatorNode(BaseNode):
    """Estimator node: publishes pose and velocity of the rail at a fixed rate."""

    ESTIMATE_PERIOD = 0.01  # s, between two estimates
    PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw in a covariance of six

    wants_priority = True

    def __init__(self, **kwargs: Any) -> None:
        super().__init__('disturbance_estimator', **kwargs)
        setup = EstimatorSetup.read(NodeParameters(self))
        self._estimator = DisturbanceEstimator(setup)
        self._motion: RailMotion | None = None
        self._published = self._logged = -math.inf  # newest stamps [s]
        self._seen: dict[
            str, tuple[int, int]
        ] = {}  # used and outliers at the previous look

        # rejections of each channel; valid measurements do not end them, because
        # `sensor_outcome` checks the age
        self._rejections = {name: Rejections() for name in self._estimator.channels}

        self.diagnostics = Diagnostics(self, self._components)
        self._frames = Frames.of(self.get_namespace())
        self._odometry = self.create_publisher(*topics.DISTURBANCE_ODOMETRY)
        self._message = Odometry(child_frame_id=self._frames.rail)  # of each estimate
        self._message.header.frame_id = self._frames.facade
        self._inputs = PublisherWatch(self, self.diagnostics)
        self._inputs.subscribe(topics.IMU, self._receive_imu)
        for names, topic, receive, frame_id in (
            (setup.distances, topics.RANGE_1, self._receive_distance, ''),
            (setup.fixes, topics.FIX_X, self._receive_fix, ''),
            (setup.poses, topics.FIX_POSE, self._receive_pose, self._frames.facade),
        ):
            for name in names:
                self._inputs.subscribe(
                    topic._replace(name=name),
                    partial(receive, name),
                    partial(self._reject, name),
                    frame_id,
                )
        steady_timer(self, self.ESTIMATE_PERIOD, self._publish)

    def _receive_imu(self, message: Imu) -> None:
        """Add rates and accelerations, unless a covariance marks them as not measured."""
        for quantity, covariance, largest in (
            ('turning rate', message.angular_velocity_covariance, LARGEST_RATE),
            ('acceleration', message.linear_acceleration_covariance, LARGEST_FORCE),
        ):
            require_measured(f'imu {quantity}', covariance[0], largest)
        rates, forces = message.angular_velocity, message.linear_acceleration
        self._estimator.add_imu(
            monotonic(),
            steady_seconds(message.header.stamp),
            (rates.x, rates.y, rates.z),
            (forces.x, forces.y, forces.z),
        )

    def _receive_distance(self, name: str, message: Range) -> None:
        if not message.min_range <= message.range <= message.max_range:
            raise InputError(
                'range',
                f'{name} = {message.range:.4g} m is outside the range of the sensor, '
                f'{message.min_range:.4g} to {message.max_range:.4g} m',
            )
        require_measured(name, message.variance)
        self._estimator.add(
            name, monotonic(), steady_seconds(message.header.stamp), message.range
        )

    def _receive_fix(self, name: str, message: PointStamped) -> None:
        self._estimator.add(
            name, monotonic(), steady_seconds(message.header.stamp), message.point.x
        )

    def _receive_pose(self, name: str, message: PoseWithCovarianceStamped) -> None:
        """Add the measured axes of a pose."""
        now = monotonic()
        time = steady_seconds(message.header.stamp)
        pose, _, variances = estimated_pose(message, name)
        for axis, value, variance in zip(Pose._fields, pose, variances, strict=True):
            channel = f'{name}.{axis}'
            if not is_measured(variance):
                self._rejections[channel].add(
                    now, not_measured_error(channel, variance)
                )
                continue
            self._estimator.add(channel, now, time, value, variance)

    def _reject(self, name: str, _: object, error: ManipulatorError) -> None:
        for channel in self._estimator.channels:
            if channel.partition('.')[0] == name:
                self._rejections[channel].add(monotonic(), error)

    def _publish(self) -> None:
        motion = self._motion = self._estimator.advance(monotonic())
        if motion is not None and motion.stamp != self._published:
            self._published = motion.stamp
            self._odometry.publish(self._odometry_message(motion))
        for event in self._estimator.events:
            if event.stamp > self._logged:
                self.get_logger().info(event.text)
        self._logged = max(
            (event.stamp for event in self._estimator.events), default=self._logged
        )

    def _odometry_message(self, motion: RailMotion) -> Odometry:
        message = self._message
        message.header.stamp = stamp(system_time(motion.stamp))
        fill_pose(message.pose.pose, motion.pose)
        message.pose.covariance.reshape(6, 6)[self.PLANAR] = motion.covariance
        linear, angular = message.twist.twist.linear, message.twist.twist.angular
        linear.x, linear.y, angular.z = motion.twist
        message.twist.covariance.reshape(6, 6)[self.PLANAR] = motion.twist_covariance
        return message

    def _components(self) -> list[DiagnosticStatus]:
        estimator, motion, now = self._estimator, self._motion, monotonic()
        values: dict[str, Any] = {
            f'event {system_time(event.stamp):.2f}': event.text
            for event in list(estimator.events)[-5:]
        }
        if motion is not None:
            values |= {
                f'standard deviation of {axis} [{unit}]': scale * math.sqrt(variance)
                for (axis, scale, unit), variance in zip(
                    POSE_AXES, np.diag(motion.covariance), strict=True
                )
            }
        delays = estimator.delays() if estimator.started else {}
        return [
            diagnostic_status('motion', *self._outcome(), values),
            *(
                self._sensor_status(name, channel, now, delays.get(name))
                for name, channel in estimator.channels.items()
            ),
        ]

    def _outcome(self) -> tuple[str, str]:
        """Return level and message of the estimate."""
        estimator = self._estimator
        if self._inputs.fault:
            return 'error', self._inputs.fault
        if self._motion is None:
            return 'error', estimator.fault or (
                'no measurement has been received; next: check the sensors and their topics'
            )
        unknown = [
            axis for k, axis in enumerate(Pose._fields) if k not in estimator.started
        ]
        if unknown:
            return 'error', f'{", ".join(unknown)} is unknown; next: check its sensors'
        if estimator.is_coasting:
            return (
                'warn',
                'the acceleration is not measured; next: check the inertial sensor',
            )
        return 'ok', 'estimating'

    def _sensor_status(
        self, name: str, channel: Channel, now: float, delay: tuple[float, float] | None
    ) -> DiagnosticStatus:
        counts = channel.counts
        used, outliers = counts['used'] + counts['other level'], counts['outlier']
        seen_used, seen_outliers = self._seen.get(name, (0, 0))
        self._seen[name] = used, outliers
        outcome = sensor_outcome(
            now - channel.stamp,
            used - seen_used,
            outliers - seen_outliers,
            self._rejections[name].message(now),
        )
        return diagnostic_status(
            f'sensor {name}',
            *outcome,
            {
                'rate [Hz]': 1.0 / channel.period if channel.period else math.nan,
                'age on arrival [ms]': 1e3 * channel.age,
                'normalised innovation squared': channel.square,
                **(
                    {}
                    if delay is None
                    else {
                        'estimated delay [ms]': f'{1e3 * delay[0]:.1f} +- {1e3 * delay[1]:.1f}'
                    }
                ),
                **{
                    f'measurements: {kind}': count
                    for kind, count in sorted(counts.items())
                },
            },
        )


# s without a measurement of a sensor, after which it counts as silent
SENSOR_SILENCE = 1.0
OUTLIER_BOUND = 0.5  # share of outliers since the previous look


def sensor_outcome(
    age: float, used: int, outliers: int, rejection: str
) -> tuple[str, str]:
    """
    Return level and message of one sensor.

    Both depend on the age of the newest valid measurement [s], the counts since the previous look,
    and the message of the recent rejections, ``''`` for none.
    """
    if age >= SENSOR_SILENCE and rejection:
        return 'warn', f'each measurement is rejected: {rejection}'
    if not math.isfinite(age):
        return 'ok', 'no measurement has been received'
    if age >= SENSOR_SILENCE:
        return 'warn', 'silent; next: check the sensor and its topic'
    if outliers > OUTLIER_BOUND * (used + outliers):
        return 'warn', 'most measurements are outliers; next: check mounting and noise'
    return 'ok', 'measuring'


main = partial(run, lambda: [DisturbanceEstimatorNode()])

if __name__ == '__main__':
    raise SystemExit(main())
