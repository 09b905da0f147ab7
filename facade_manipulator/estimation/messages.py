"""Messages of the sensors as measurements, received or recorded."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import estimate_numbers, projected, seconds

Add = Callable[[DisturbanceEstimator, str, float, Any], None]


def inputs(setup: EstimatorSetup) -> dict[str, Add]:
    """Return how the messages of each sensor are taken, by its name, that of its topic."""
    return {'imu': add_imu, **dict.fromkeys(setup.distances, add_range),
            **dict.fromkeys(setup.fixes, add_fix), **dict.fromkeys(setup.poses, add_pose)}


def add_imu(estimator: DisturbanceEstimator, _: str, now: float, message: Any) -> None:
    """Take a sensor_msgs/Imu; its orientation is not read."""
    rates, forces = message.angular_velocity, message.linear_acceleration
    estimator.add_imu(now, seconds(message.header.stamp), (rates.x, rates.y, rates.z),
                      (forces.x, forces.y, forces.z))


def add_range(estimator: DisturbanceEstimator, name: str, now: float, message: Any) -> None:
    """Take a sensor_msgs/Range that is within its own bounds."""
    if not message.min_range <= message.range <= message.max_range:
        raise InputError('range', f'{name} = {message.range:.4g} m is not between its '
                         f'{message.min_range:.4g} and {message.max_range:.4g} m')
    estimator.add(name, now, seconds(message.header.stamp), message.range)


def add_fix(estimator: DisturbanceEstimator, name: str, now: float, message: Any) -> None:
    """Take a geometry_msgs/PointStamped: a feature as the sensor sees it."""
    estimator.add(name, now, seconds(message.header.stamp), message.point.x)


def add_pose(estimator: DisturbanceEstimator, name: str, now: float, message: Any) -> None:
    """Take the axes of a pose whose variance is not negative; 0 is not known."""
    *numbers, x, y, yaw = estimate_numbers(message)
    pose, _ = projected(numbers, name)
    for axis, value, variance in zip(Pose._fields, pose, (x, y, yaw), strict=True):
        if not variance < 0.0:
            estimator.add(f'{name}.{axis}', now, seconds(message.header.stamp), value,
                          variance if 0.0 < variance < math.inf else None)
