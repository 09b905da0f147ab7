"""Settings of the prediction."""

from __future__ import annotations

from facade_manipulator.kinematics import Pose
from facade_manipulator.parameters import parameter, settings


@settings
class PredictionSettings:
    """Settings of the disturbance's prediction."""

    model: str = parameter(
        'continuation', 'What predicts: the learnt continuation of the motion, its acceleration '
        'held, or nothing', choices=('continuation', 'acceleration', 'none'))
    memory: float = parameter(
        20.0, 'Time constant with which what was learnt is forgotten', unit='s', minimum=5.0,
        maximum=600.0)
    evaluation_horizon: float = parameter(
        0.12, 'Time ahead for which the standard deviation is published', unit='s',
        minimum=0.02, maximum=0.6)
    speed: tuple[float, ...] = parameter(
        (2.0, 2.0, 2.0), 'Speed beyond which no motion is predicted: x, y, theta',
        unit='m/s, rad/s', minimum=1e-3, maximum=100.0, elements=Pose._fields)
    acceleration: tuple[float, ...] = parameter(
        (1.0, 0.7, 1.4),
        'Acceleration beyond which a motion is compensated in part: x, y, theta',
        unit='m/s^2, rad/s^2', minimum=1e-3, maximum=100.0, elements=Pose._fields)
