"""Messages of the sensors as measurements, received or recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import Any, NamedTuple

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.estimation.settings import EstimatorSetup
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import estimate_numbers, projected

Add = Callable[[DisturbanceEstimator, str, float, float, Sequence[float]], None]


class Input(NamedTuple):
    """How a kind of message is taken: what is read of it, and what adds that to an estimator."""

    numbers_of: Callable[[Any], Sequence[float]]
    add: Add  #: by the sensor's name, the present time and the stamp [s], and the numbers


def imu_numbers(message: Any) -> tuple[float, ...]:
    """
    Return rates and forces of a sensor_msgs/Imu, each with the first number of its covariance.

    Its orientation is not read.
    """
    rates, forces = message.angular_velocity, message.linear_acceleration
    return (rates.x, rates.y, rates.z, float(message.angular_velocity_covariance[0]),
            forces.x, forces.y, forces.z, float(message.linear_acceleration_covariance[0]))


def rates_and_forces(numbers: Sequence[float]) -> tuple[Sequence[float], Sequence[float]]:
    """
    Return the rates and the forces among the numbers of a sensor_msgs/Imu.

    Raises
    ------
    InputError
        With reason ``'not_measured'``: a covariance that begins with -1 says so.

    """
    for quantity, covariance in (('turning rate', numbers[3]), ('acceleration', numbers[7])):
        if covariance < 0.0:
            raise InputError('not_measured', f'imu measures no {quantity}: its covariance begins '
                             f'with {covariance:g}')
    return numbers[:3], numbers[4:7]


def range_numbers(message: Any) -> tuple[float, ...]:
    """Return the bounds of a sensor_msgs/Range, then what it measured."""
    return message.min_range, message.max_range, message.range


def fix_numbers(message: Any) -> tuple[float, ...]:
    """Return where a geometry_msgs/PointStamped has a feature, as the sensor sees it."""
    return message.point.x,


def _add_imu(estimator: DisturbanceEstimator, _: str, now: float, stamp: float,
             numbers: Sequence[float]) -> None:
    estimator.add_imu(now, stamp, *rates_and_forces(numbers))


def _add_range(estimator: DisturbanceEstimator, name: str, now: float, stamp: float,
               numbers: Sequence[float]) -> None:
    least, most, measured = numbers
    if not least <= measured <= most:
        raise InputError('range', f'{name} = {measured:.4g} m is not between its '
                         f'{least:.4g} and {most:.4g} m')
    estimator.add(name, now, stamp, measured)


def _add_fix(estimator: DisturbanceEstimator, name: str, now: float, stamp: float,
             numbers: Sequence[float]) -> None:
    estimator.add(name, now, stamp, numbers[0])


def _add_pose(estimator: DisturbanceEstimator, name: str, now: float, stamp: float,
              numbers: Sequence[float]) -> None:
    """Take the axes of a pose whose variance is neither negative nor infinite; 0 is not known."""
    *numbers, x, y, yaw = numbers
    pose, _ = projected(numbers, name)
    for axis, value, variance in zip(Pose._fields, pose, (x, y, yaw), strict=True):
        if not (variance < 0.0 or variance == math.inf):
            estimator.add(f'{name}.{axis}', now, stamp, value,
                          variance if variance > 0.0 else None)


IMU, RANGE, FIX, POSE = (
    Input(imu_numbers, _add_imu), Input(range_numbers, _add_range), Input(fix_numbers, _add_fix),
    Input(estimate_numbers, _add_pose))


def inputs(setup: EstimatorSetup) -> dict[str, Input]:
    """Return how the messages of each sensor are taken, by its name, that of its topic."""
    return {'imu': IMU, **dict.fromkeys(setup.distances, RANGE),
            **dict.fromkeys(setup.fixes, FIX), **dict.fromkeys(setup.poses, POSE)}
