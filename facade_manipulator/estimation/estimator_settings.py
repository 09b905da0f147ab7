"""Settings of the estimator: mounting and noise of each sensor, and the wall."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

from facade_manipulator.parameters import (
    inherited,
    parameter,
    ParameterSource,
    require_topics,
    settings,
)

PLACE = ('x', 'y', 'z')
Sensor = TypeVar('Sensor')


@settings
class SensorNames:
    """Topics of the sensors; each name is also the prefix of the sensor's parameters."""

    distances: tuple[str, ...] = parameter(
        'Topics of distance sensors', default=('range_1', 'range_2')
    )
    fixes: tuple[str, ...] = parameter(
        'Topics of sensors that see a feature of the wall', default=('fix_x',)
    )
    poses: tuple[str, ...] = parameter(
        'Topics of estimators that publish the pose of the rail', default=('fix_pose',)
    )

    def __post_init__(self) -> None:
        """Raise a ParameterError if a topic has a name that ROS rejects."""
        for kind in ('distances', 'fixes', 'poses'):
            require_topics(kind, filter(None, getattr(self, kind)))


@settings
class ImuSettings:
    """Mounting and noise of the IMU."""

    mounting: tuple[float, ...] = parameter(
        'Place and attitude on the rail: x, y, z, roll, pitch, yaw',
        default=(0.0,) * 6,
        unit='m, rad',
        minimum=-20.0,
        maximum=20.0,
        elements=(*PLACE, 'roll', 'pitch', 'yaw'),
    )
    delay: float = parameter(
        'Delay of the stamps', default=0.0, unit='s', minimum=-0.1, maximum=0.1
    )
    gyroscope_noise: float = parameter(
        'Noise density of the turning rates',
        default=1.5e-4,
        unit='rad/s/√Hz',
        minimum=1e-6,
        maximum=1e-2,
    )
    accelerometer_noise: float = parameter(
        'Noise density of the accelerations',
        default=2e-3,
        unit='m/s^2/√Hz',
        minimum=1e-5,
        maximum=1e-1,
    )


@settings
class DistanceSettings:
    """Settings of a sensor that measures the wall's distance along the rail's y."""

    mounting: tuple[float, ...] = parameter(
        'Place on the rail: x, y, z',
        default=(0.0, 0.0, 0.0),
        unit='m',
        minimum=-20.0,
        maximum=20.0,
        elements=PLACE,
    )
    noise: float = parameter(
        'Standard deviation between measurements',
        default=2e-4,
        unit='m',
        minimum=1e-6,
        maximum=0.1,
    )
    place_noise: float = parameter(
        'Standard deviation between places of the wall',
        default=2e-4,
        unit='m',
        minimum=1e-6,
        maximum=0.1,
    )
    delay: float = parameter(
        'Delay of the stamps', default=0.0, unit='s', minimum=-0.3, maximum=0.3
    )


@settings
class FixSettings(DistanceSettings):
    """Settings of a sensor that measures a wall feature's position along the rail's x."""

    noise: float = inherited(DistanceSettings, 'noise', default=5e-4)
    place_noise: float = inherited(DistanceSettings, 'place_noise', default=3e-4)
    feature: float = parameter(
        'Place of the feature along the wall; 0 if unknown; the node then measures it',
        default=0.0,
        unit='m',
        minimum=-100.0,
        maximum=100.0,
    )
    delay_error: float = parameter(
        'Standard deviation of the delay',
        default=2e-3,
        unit='s',
        minimum=1e-5,
        maximum=0.1,
    )


@settings
class PoseFixSettings:
    """Settings of another estimator of the rail's pose."""

    noise: tuple[float, ...] = parameter(
        'Standard deviations for a message without covariance',
        default=(1e-3, 1e-3, 2e-3),
        unit='m, m, rad',
        minimum=1e-6,
        maximum=1.0,
        elements=('x', 'y', 'yaw'),
    )
    delay: float = inherited(DistanceSettings, 'delay', default=0.0)


@settings
class ProfileSettings:
    """Settings of the wall profile in front of the rail."""

    distance: float = parameter(
        'Distance of the wall from the rail at rest; 0 uses the first measurement',
        default=0.0,
        unit='m',
        minimum=0.0,
        maximum=20.0,
    )
    levels: tuple[float, ...] = parameter(
        'Offsets of recesses behind the wall; negative for mullions and transoms',
        default=(0.0,),
        unit='m',
        minimum=-5.0,
        maximum=5.0,
    )


@dataclass(frozen=True)
class EstimatorSetup:
    """Settings of all sensors by name, and of the wall."""

    imu: ImuSettings = ImuSettings()
    wall: ProfileSettings = ProfileSettings()
    distances: dict[str, DistanceSettings] = field(default_factory=dict)
    fixes: dict[str, FixSettings] = field(default_factory=dict)
    poses: dict[str, PoseFixSettings] = field(default_factory=dict)

    @classmethod
    def read(cls, source: ParameterSource) -> EstimatorSetup:
        """Read the parameters of the estimator; each named sensor has its own group."""
        names = source.read(SensorNames)
        return cls(
            imu=source.read(ImuSettings, 'imu'),
            wall=source.read(ProfileSettings, 'wall'),
            distances=_by_name(source, DistanceSettings, names.distances),
            fixes=_by_name(source, FixSettings, names.fixes),
            poses=_by_name(source, PoseFixSettings, names.poses),
        )


def _by_name(
    source: ParameterSource, cls: type[Sensor], names: tuple[str, ...]
) -> dict[str, Sensor]:
    """Return the settings of one kind of sensor by sensor name, without empty names."""
    return {name: source.read(cls, name) for name in names if name}
