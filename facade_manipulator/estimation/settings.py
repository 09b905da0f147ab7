"""What is mounted where on the rail, how well it measures, and what the wall looks like."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from facade_manipulator.parameters import inherited, parameter, settings

PLACE = ('x', 'y', 'z')
Settings = TypeVar('Settings')


class Reader(Protocol):
    """Reads settings from the parameters of the node."""

    def __call__(self, kind: type[Settings], prefix: str = '') -> Settings:
        """Return those below a prefix."""
        ...


@settings
class SensorNames:
    """Which sensors there are; each name is that of a topic, and of the sensor's parameters."""

    distances: tuple[str, ...] = parameter(
        'Topics of sensors of the distance of the wall', default=('range_1', 'range_2'))
    fixes: tuple[str, ...] = parameter(
        'Topics of sensors that see a feature of the wall', default=('fix_x',))
    poses: tuple[str, ...] = parameter(
        "Topics of estimators of the rail's pose", default=('fix_pose',))


@settings
class ImuSettings:
    """The inertial sensor: where it is mounted and how well it measures."""

    mounting: tuple[float, ...] = parameter(
        'Where it is mounted on the rail, and how it is turned there: x, y, z, roll, pitch, yaw',
        default=(0.0,) * 6, unit='m, rad', minimum=-20.0, maximum=20.0,
        elements=(*PLACE, 'roll', 'pitch', 'yaw'))
    delay: float = parameter(
        'How much later than the motion its stamps are', default=0.0, unit='s', minimum=-0.1,
        maximum=0.1)
    gyroscope_noise: float = parameter(
        'Noise density of the turning rates', default=1.5e-4, unit='rad/s/√Hz', minimum=1e-6,
        maximum=1e-2)
    accelerometer_noise: float = parameter(
        'Noise density of the accelerations', default=2e-3, unit='m/s^2/√Hz', minimum=1e-5,
        maximum=1e-1)
    gyroscope_bias: float = parameter(
        'Standard deviation of the offset of the turning rates at start', default=0.01,
        unit='rad/s', minimum=1e-5, maximum=0.2)
    accelerometer_bias: float = parameter(
        'Standard deviation of the offset of the accelerations at start', default=0.1,
        unit='m/s^2', minimum=1e-3, maximum=1.0)
    largest_rate: float = parameter(
        'Turning rate from which on it is saturated', default=4.0, unit='rad/s', minimum=0.1,
        maximum=100.0)
    largest_acceleration: float = parameter(
        'Acceleration from which on it is saturated', default=30.0, unit='m/s^2', minimum=12.0,
        maximum=1000.0)


@settings
class DistanceSettings:
    """A sensor that measures the distance of the wall along the rail's y."""

    mounting: tuple[float, ...] = parameter(
        'Where it is mounted on the rail: x, y, z', default=(0.0, 0.0, 0.0), unit='m',
        minimum=-20.0, maximum=20.0, elements=PLACE)
    noise: float = parameter(
        'Standard deviation from one measurement to the next', default=2e-4, unit='m',
        minimum=1e-6, maximum=0.1)
    place_noise: float = parameter(
        'Standard deviation from one place of the wall to another', default=2e-4, unit='m',
        minimum=1e-6, maximum=0.1)
    delay: float = parameter(
        'How much later than the motion its stamps are', default=0.0, unit='s', minimum=-0.3,
        maximum=0.3)


@settings
class FixSettings(DistanceSettings):
    """A sensor that sees a feature of the wall: where that is along the rail's x."""

    noise: float = inherited(DistanceSettings, 'noise', default=5e-4)
    place_noise: float = inherited(DistanceSettings, 'place_noise', default=3e-4)
    feature: float = parameter(
        'Where the feature is along the wall', default=0.0, unit='m', minimum=-100.0,
        maximum=100.0)
    feature_known: bool = parameter(
        'Whether that is known; else the rail is at 0 at the start', default=False)
    delay_error: float = parameter(
        'Standard deviation of what is not known of the delay', default=2e-3, unit='s',
        minimum=1e-5, maximum=0.1)


@settings
class PoseFixSettings:
    """An estimator of the rail's pose, such as a camera with a software of its own."""

    position_noise: float = parameter(
        'Standard deviation in x and y where the message has none', default=1e-3, unit='m',
        minimum=1e-6, maximum=1.0)
    yaw_noise: float = parameter(
        'Standard deviation in yaw where the message has none', default=2e-3, unit='rad',
        minimum=1e-6, maximum=1.0)
    delay: float = inherited(DistanceSettings, 'delay', default=0.0)


@settings
class ProfileSettings:
    """The wall before the rail."""

    distance: float = parameter(
        'Distance of the wall from the rail at rest; 0 takes the first that is measured',
        default=0.0, unit='m', minimum=0.0, maximum=20.0)
    levels: tuple[float, ...] = parameter(
        'How much farther than the wall its recesses are; negative for mullions and transoms',
        default=(0.0,), unit='m', minimum=-5.0, maximum=5.0)


@dataclass(frozen=True)
class EstimatorSetup:
    """All sensors by their names, and the wall."""

    imu: ImuSettings = ImuSettings()
    wall: ProfileSettings = ProfileSettings()
    distances: dict[str, DistanceSettings] = field(default_factory=dict)
    fixes: dict[str, FixSettings] = field(default_factory=dict)
    poses: dict[str, PoseFixSettings] = field(default_factory=dict)

    @classmethod
    def read(cls, names: SensorNames, reader: Reader) -> EstimatorSetup:
        """Read the settings of all sensors; an empty name stands for none."""
        def each(chosen: tuple[str, ...], kind: type[Settings]) -> dict[str, Settings]:
            return {name: reader(kind, name) for name in chosen if name}

        return cls(reader(ImuSettings, 'imu'), reader(ProfileSettings, 'wall'),
                   each(names.distances, DistanceSettings), each(names.fixes, FixSettings),
                   each(names.poses, PoseFixSettings))
