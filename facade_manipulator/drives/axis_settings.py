"""Settings of the three axes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
import math

from facade_manipulator.canopen import cob_ids
from facade_manipulator.drives.units import SiPerUnit, VELOCITY_UNITS
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.parameters import parameter, parameter_fields, settings


@settings
class AxisSettings:
    """
    Settings of one axis: drive, mechanics and limits.

    The defaults suit the published prototype (motor of 54.5 mN·m, gear 4.3:1) on a screw of 20 mm
    lead, where 0.5 m/s are 6450 revolutions of the motor per minute. Counts per metre are
    4·ppr·gear/lead, the carriage force is τ = 2π η T·gear/lead.

    """

    pulses_per_revolution: int = parameter(
        'Encoder lines per revolution of the motor; a line gives four counts',
        default=500,
        minimum=1,
        maximum=2**28,
    )
    gear_ratio: float = parameter(
        'Revolutions of the motor per revolution of the screw',
        default=4.3,
        minimum=1e-3,
        maximum=1000.0,
    )
    lead: float = parameter(
        'Displacement of the carriage per revolution of the screw',
        default=0.02,
        unit='m',
        minimum=1e-4,
        maximum=1.0,
    )
    direction: int = parameter(
        '1: positive counts move the carriage to positive q; -1: to negative q',
        default=1,
        minimum=-1,
        maximum=1,
    )
    rated_torque: float = parameter(
        'Rated torque of the motor',
        default=0.0545,
        unit='N m',
        minimum=1e-6,
        maximum=1000.0,
    )
    efficiency: float = parameter(
        'Efficiency of gear and screw together', default=0.8, minimum=0.01, maximum=1.0
    )
    node_id: int = parameter(
        'CANopen node id of the drive',
        default=1,
        minimum=1,
        maximum=cob_ids.MASTER_NODE_ID - 1,
    )
    profile: str = parameter(
        'Drive type: name of a file in config/drives', default='simulated'
    )
    serial_number: int = parameter(
        'Required serial number of the drive (1018h:4); 0 accepts any drive, also of swapped axes',
        default=0,
        minimum=0,
        maximum=2**32 - 1,
    )
    max_speed: float = parameter(
        'Speed limit of the drive', default=0.6, unit='m/s', minimum=0.001, maximum=5.0
    )
    max_acceleration: float = parameter(
        'Acceleration limit of the drive',
        default=6.0,
        unit='m/s^2',
        minimum=0.01,
        maximum=100.0,
    )
    stop_deceleration: float = parameter(
        'Deceleration of a quick stop',
        default=6.0,
        unit='m/s^2',
        minimum=0.01,
        maximum=100.0,
    )
    following_error_window: float = parameter(
        'Following error at which the drive stops, and difference between two axes at which all '
        'stop: at most three quarters of the distance that carriage_gap leaves to a collision',
        default=0.015,
        unit='m',
        minimum=1e-5,
        maximum=0.5,
    )
    home_position: float = parameter(
        'Carriage position at the home position of the drive',
        default=0.0,
        unit='m',
        minimum=-10.0,
        maximum=10.0,
    )
    homing_method: int = parameter(
        'Homing method of CiA 402; 37 defines the present position as home',
        default=37,
        minimum=-128,
        maximum=127,
    )
    homing_rank: int = parameter(
        'Axes of one rank home together, lower ranks first',
        default=1,
        minimum=1,
        maximum=3,
    )
    homing_speed: float = parameter(
        'Speed towards the switch or hard stop',
        default=0.05,
        unit='m/s',
        minimum=1e-4,
        maximum=1.0,
    )
    homing_current: float = parameter(
        'Motor current at which homing detects a hard stop',
        default=1.0,
        unit='A',
        minimum=0.01,
        maximum=100.0,
    )

    # by the profile of the drive
    vendor_id: int = 0  # 1018h:1; 0 accepts any
    product_code: int = 0  # 1018h:2; 0 accepts any
    velocity_unit: str = 'counts_per_second'  # key of VELOCITY_UNITS
    acceleration_unit: str = ''  # key of VELOCITY_UNITS, per second; '': velocity_unit

    # fixed: the mechanism defines the stroke; only tests change the other settings
    limit_margin: float = 0.005  # m, from the stroke to the drive's own position limits
    lower_limit: float = -0.5  # m
    upper_limit: float = 0.5  # m
    following_error_time: float = (
        0.01  # s, for which the following error may leave its window
    )
    homing_acceleration: float = 0.5  # m/s^2
    homing_zero_share: float = 0.2  # of homing_speed, away from the switch or hard stop
    homing_strokes: float = 3.0  # maximum travel to home, at homing_speed

    def __post_init__(self) -> None:
        if self.direction == 0:
            raise ParameterError('direction = 0 is neither 1 nor -1; next: set 1 or -1')
        if not self.lower_limit <= self.home_position <= self.upper_limit:
            raise ParameterError(
                f'home_position = {self.home_position:g} m is outside the stroke '
                f'{self.lower_limit:g} m to {self.upper_limit:g} m; next: set a position inside'
            )

    @property
    def stop_time(self) -> float:
        """Return the maximum duration of a quick stop [s]."""
        return self.max_speed / self.stop_deceleration

    @cached_property
    def counts_per_metre(self) -> float:
        """Return the signed number of counts per metre of carriage motion [1/m]."""
        return self.direction * self.counts_per_revolution * self.gear_ratio / self.lead

    @property
    def counts_per_revolution(self) -> int:
        """Return the number of counts per motor revolution."""
        return 4 * self.pulses_per_revolution

    @cached_property
    def velocity_units_per_count(self) -> float:
        """Return the positive number of drive velocity units per count/s."""
        unit = VELOCITY_UNITS[self.velocity_unit]
        counts = {
            'count': 1.0,
            'revolution': self.counts_per_revolution,
            'metre': abs(self.counts_per_metre),
        }
        return unit.factor / counts[unit.counted]

    @cached_property
    def si_per_unit(self) -> SiPerUnit:
        """
        Return the SI value of one drive unit for each measured quantity.

        All four values have the sign of `direction`.
        """
        metres = 1.0 / self.counts_per_metre
        turns_per_metre = self.direction * self.gear_ratio / self.lead
        # N for the rated torque, of which 6077h counts thousandths
        rated_force = (
            2.0 * math.pi * self.efficiency * turns_per_metre * self.rated_torque
        )
        return SiPerUnit(
            position=metres,
            velocity=metres / self.velocity_units_per_count,
            force=rated_force / 1000.0,
            following_error=metres,
        )

    def to_counts(self, position: float) -> int:
        """Convert a position [m] to counts; `configure` rejects a value of more than 32 bits."""
        return round(position * self.counts_per_metre)

    def to_metres(self, counts: float) -> float:
        """Convert counts to a position [m]."""
        return counts / self.counts_per_metre


# the home pose of the prototype is q = (-0.1, 0.1, 0) m; along the rail the order is q1, q3, q2
DEFAULT_AXES = tuple(
    AxisSettings(node_id=node_id, home_position=home)
    for node_id, home in enumerate((-0.1, 0.1, 0.0), 1)
)


OF_ONE_AXIS = frozenset(
    {  # settings that may differ between the axes
        'node_id',
        'serial_number',
        'lead',
        'direction',
        'home_position',
        'homing_method',
        'homing_rank',
    }
)


def read_axes(
    read: Callable[..., AxisSettings], stroke: tuple[float, ...]
) -> tuple[AxisSettings, ...]:
    """
    Return the settings of the three axes; all carriages have the same stroke [m].

    `read` is the method of a `ParameterSource`. The group ``axes`` contains the settings that all
    axes share, the groups ``q1`` to ``q3`` contain those in `OF_ONE_AXIS`.
    """
    shared = set(parameter_fields(AxisSettings)) - OF_ONE_AXIS
    common = read(AxisSettings, prefix='axes', only=shared)
    return tuple(
        read(
            AxisSettings,
            prefix=name,
            only=OF_ONE_AXIS,
            node_id=default.node_id,
            home_position=default.home_position,
            lower_limit=stroke[0],
            upper_limit=stroke[1],
            **{field: getattr(common, field) for field in shared},
        )
        for name, default in zip(AXIS_NAMES, DEFAULT_AXES, strict=True)
    )


def check_axes(axes: tuple[AxisSettings, ...]) -> None:
    """Raise a ParameterError if two axes share a node id or a serial number other than 0."""
    for name in ('node_id', 'serial_number'):
        values = [getattr(axis, name) for axis in axes if getattr(axis, name)]
        if len(set(values)) < len(values):
            raise ParameterError(
                f'two axes have the same {name}: {values}; next: correct one of the axes'
            )
