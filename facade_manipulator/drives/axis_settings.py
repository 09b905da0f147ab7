"""Settings of the three axes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.units import AxisScale
from facade_manipulator.errors import ParameterError
from facade_manipulator.parameters import parameter, parameter_fields, settings

AXIS_NAMES = ('q1', 'q2', 'q3')
Triple = tuple[float, float, float]
OF_ONE_AXIS = frozenset({  # settings by which the axes may differ
    'node_id', 'serial_number', 'lead', 'direction', 'home_position', 'homing_method',
    'homing_rank'})


@settings
class AxisSettings(AxisScale):
    """
    One axis: which drive, on which mechanics, within which limits.

    The defaults suit the published prototype (motor of 54.5 mN·m, gear 4.3:1) on a screw of 20 mm
    lead, where 0.5 m/s are 6450 revolutions of the motor per minute.

    """

    velocity_unit: str = 'counts_per_second'  # the drive's profile says it, not the operator
    node_id: int = parameter(
        'CANopen node id of the drive', default=1, minimum=1, maximum=pdo.MASTER_NODE_ID - 1)
    profile: str = parameter(
        'Drive type: name of a file in config/drives', default='simulated')
    serial_number: int = parameter(
        'Serial number the drive must have (1018h:4); 0 accepts any, swapped axes included',
        default=0, minimum=0, maximum=2**32 - 1)
    max_speed: float = parameter(
        'Speed limit of the drive', default=0.6, unit='m/s', minimum=0.001, maximum=5.0)
    max_acceleration: float = parameter(
        'Acceleration limit of the drive', default=6.0, unit='m/s^2', minimum=0.01, maximum=100.0)
    stop_deceleration: float = parameter(
        'Deceleration of a quick stop', default=6.0, unit='m/s^2', minimum=0.01, maximum=100.0)
    following_error_window: float = parameter(
        'Following error that trips the drive, and difference of two that stops all: at '
        'most three quarters of what carriage_gap keeps carriages from touching', default=0.015,
        unit='m', minimum=1e-5, maximum=0.5)
    home_position: float = parameter(
        'Where the carriage is at its home position', default=0.0, unit='m', minimum=-10.0,
        maximum=10.0)
    homing_method: int = parameter(
        'Homing method of CiA 402; 37 takes the present position as home', default=37,
        minimum=-128, maximum=127)
    homing_rank: int = parameter(
        'Axes of one rank home together, lower ranks first', default=1, minimum=1, maximum=3)
    homing_speed: float = parameter(
        'Speed towards the switch or hard stop', default=0.05, unit='m/s', minimum=1e-4,
        maximum=1.0)
    homing_current: float = parameter(
        'Motor current that means a hard stop', default=1.0, unit='A', minimum=0.01, maximum=100.0)

    # fixed: the stroke is the mechanism's, of the rest only tests have a reason to change it
    vendor_id: int = 0  # 1018h:1 by the profile of the drive; 0 accepts any
    product_code: int = 0  # 1018h:2 by the profile of the drive; 0 accepts any
    limit_margin: float = 0.005  # m, from the stroke to the drive's own position limits
    lower_limit: float = -0.5  # m
    upper_limit: float = 0.5  # m
    following_error_time: float = 0.01  # s, for which the following error may leave its window
    homing_acceleration: float = 0.5  # m/s^2
    homing_zero_share: float = 0.2  # of homing_speed, away from the switch or hard stop
    homing_strokes: float = 3.0  # that a carriage may take to home, at homing_speed

    @property
    def homing_zero_speed(self) -> float:
        """Speed away from the switch or hard stop [m/s]."""
        return self.homing_zero_share * self.homing_speed

    @property
    def stop_time(self) -> float:
        """Longest time that a quick stop takes [s]."""
        return self.max_speed / self.stop_deceleration

    @property
    def homing_timeout(self) -> float:
        """Longest time for homing [s]."""
        return self.homing_strokes * (self.upper_limit - self.lower_limit) / self.homing_speed

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lower_limit >= self.upper_limit:
            raise ParameterError(
                f'lower_limit = {self.lower_limit:g} m is not below '
                f'upper_limit = {self.upper_limit:g} m')
        if not self.lower_limit <= self.home_position <= self.upper_limit:
            raise ParameterError(
                f'home_position = {self.home_position:g} m is outside the stroke '
                f'{self.lower_limit:g} m to {self.upper_limit:g} m')


# the home pose of the prototype is q = (-0.1, 0.1, 0) m; along the rail the order is q1, q3, q2
DEFAULT_AXES = (
    AxisSettings(node_id=1, home_position=-0.1),
    AxisSettings(node_id=2, home_position=0.1),
    AxisSettings(node_id=3, home_position=0.0),
)


def _axis_defaults(stroke: tuple[float, ...]) -> dict[str, dict[str, Any]]:
    """Return the defaults of each axis on a stroke [m]."""
    return {
        name: {'node_id': axis.node_id, 'home_position': axis.home_position,
               'lower_limit': stroke[0], 'upper_limit': stroke[1]}
        for name, axis in zip(AXIS_NAMES, DEFAULT_AXES, strict=True)}


def read_axes(
    read: Callable[..., AxisSettings], stroke: tuple[float, ...]
) -> tuple[AxisSettings, ...]:
    """
    Read the settings of the three axes, whose carriages have one stroke [m].

    `read` takes the class, the group of parameters, its fields, and other defaults, as `declare`
    of a node does, or `settings_from` with the values of a file. The group ``axes`` has the
    settings that all axes share, the groups ``q1`` to ``q3`` have those in `OF_ONE_AXIS`.
    """
    shared = set(parameter_fields(AxisSettings)) - OF_ONE_AXIS
    common = read(AxisSettings, prefix='axes', only=shared)
    return tuple(
        read(AxisSettings, prefix=name, only=OF_ONE_AXIS, **defaults,
             **{field: getattr(common, field) for field in shared})
        for name, defaults in _axis_defaults(stroke).items())


def check_axes(axes: tuple[AxisSettings, ...]) -> None:
    """
    Check what no axis can check alone.

    Raises a ParameterError if there are not three, or two have one node id or one serial
    number.
    """
    if len(axes) != len(AXIS_NAMES):
        raise ParameterError(f'{len(axes)} axes are configured, not {len(AXIS_NAMES)}')
    for name in ('node_id', 'serial_number'):
        values = [getattr(axis, name) for axis in axes if getattr(axis, name)]
        if len(set(values)) < len(values):
            raise ParameterError(f'two axes have the same {name}: {values}')
