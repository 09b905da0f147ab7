"""
Drive profiles: process data, written objects, homing methods, units and quirks.

Another CiA 402 drive needs a file in ``config/drives`` and no code.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from facade_manipulator.canopen import cob_ids, indices, pdo
from facade_manipulator.canopen.emcy import Fault, row_of
from facade_manipulator.canopen.nmt import SupervisedHeartbeat
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.units import VELOCITY_UNITS
from facade_manipulator.errors import file_sentence, NEXT, ParameterError
from facade_manipulator.package_files import config_path
from facade_manipulator.parameters import read_value

_BOOLEAN = (False, True)


class InputPolarity(NamedTuple):
    """Object that inverts digital inputs: bit n + shift inverts bit n of 60FDh."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    shift: int = 0


class ProfileObject(NamedTuple):
    """Object to write; `value` is a number or the name of one of `QUANTITIES`."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    value: int | str
    required: bool


class Quirks(NamedTuple):
    """Deviations of a drive from CiA 402."""

    never_follows: bool = False  #: bit 12 is never set in cyclic synchronous position
    hides_mode: bool = False  #: 6061h shows the mode only in operation enabled
    #: homing ends with bit 12 only; bit 10 is never set, or only for a moment
    homes_without_bit_10: bool = False
    #: controlword bit 4 in cyclic synchronous position: one of `CYCLIC_BIT_4`
    cyclic_bit_4: str = 'clear'
    starts_itself: bool = False  #: NMT operational without a command after the boot-up
    boot_time: int = 0  #: longest time from reset to the boot-up message [s]


CYCLIC_BIT_4 = ('clear', 'held', 'toggled')
LONGEST_BOOT_TIME = 60  # s
_SWITCHES = [name for name, value in Quirks()._asdict().items() if value is False]

# The values that an entry may have, all of one type; the other entries may have any value.
_ALLOWED: dict[str, Sequence[Any]] = {
    'index': indices.OBJECTS,
    'subindex': range(255),
    'shift': range(32),
    'homing_methods': range(-128, 128),  # 6098h is a signed byte
    'vendor_id': range(2**32),
    'product_code': range(2**32),
    'lost_master_reaction': indices.OBJECTS,
    'cyclic_bit_4': CYCLIC_BIT_4,
    'boot_time': range(LONGEST_BOOT_TIME + 1),
    **dict.fromkeys(('required', 'loses_position', 'is_warning', *_SWITCHES), _BOOLEAN),
    **dict.fromkeys(
        ('velocity_unit', 'motor_speed_unit', 'acceleration_unit'), (*VELOCITY_UNITS,)
    ),
}


@dataclass(frozen=True)
class DriveProfile:
    """Drive type as described by its profile."""

    name: str  #: name of the profile's file without its ending
    eds: Path  #: its electronic data sheet
    velocity_unit: str  #: key of `VELOCITY_UNITS`
    motor_speed_unit: str  #: of 6080h, which differs between makers
    acceleration_unit: str  #: per second, of 6083h to 6085h, 609Ah and 60C5h
    homing_methods: tuple[int, ...]  #: homing methods that it supports
    #: objects that configure writes, in this order; their values are computed for each axis
    objects: tuple[ProfileObject, ...]
    quirks: Quirks = Quirks()
    vendor_id: int | None = None  #: maker of these drives (1018h:1); None for any
    product_code: int | None = None  #: product code (1018h:2); None for any
    pdos: tuple[Pdo, ...] = pdo.PDO_MAP  #: the process data in use
    #: index and subindex of the objects of a place on the bus: node id, bit rate
    of_place: tuple[tuple[int, int], ...] = ()
    input_polarity: InputPolarity | None = (
        None  #: None if only the maker's tool shows it
    )
    #: index of the reaction of the drive to a lost master; the value 0 disables it
    lost_master_reaction: int = indices.ABORT_CONNECTION_OPTION
    #: the maker's own meanings of error codes (603Fh, emergency messages), by `row_of`
    errors: Mapping[str, Fault] = field(default_factory=dict)

    @property
    def tpdos(self) -> tuple[Pdo, ...]:
        """Return the PDOs that the drive sends."""
        return tuple(one for one in self.pdos if one.is_transmitted)

    @property
    def rpdos(self) -> tuple[Pdo, ...]:
        """Return the PDOs that the drive receives."""
        return tuple(one for one in self.pdos if not one.is_transmitted)

    def location(self, quantity: str) -> tuple[int, int] | None:
        """Return index and subindex of the object with a quantity, None without such an object."""
        return next((item[:2] for item in self.objects if item.value == quantity), None)

    @property
    def heartbeat_consumer(self) -> tuple[int, int]:
        """Return index and subindex of the object that monitors the master's heartbeat."""
        return self.location('master_heartbeat') or (
            indices.CONSUMER_HEARTBEAT_TIME,
            1,
        )

    def applied(self, axis: AxisSettings) -> AxisSettings:
        """Return the settings of an axis with units, encoder and identity of its drive added."""
        return replace(
            axis,
            velocity_unit=self.velocity_unit,
            acceleration_unit=self.acceleration_unit,
            vendor_id=axis.vendor_id or self.vendor_id or 0,
            product_code=axis.product_code or self.product_code or 0,
        )


def quantities(
    axis: AxisSettings,
    settings: ControllerSettings,
    motor_speed_unit: str | None = None,
) -> dict[str, int]:
    """
    Return the values that a profile may write, by name and in drive units.

    The settings of the axis contain the units of the profile. The unit of 6080h defaults to the
    velocity unit.
    """
    motor = replace(axis, velocity_unit=motor_speed_unit or axis.velocity_unit)
    ramp = replace(axis, velocity_unit=axis.acceleration_unit or axis.velocity_unit)
    lower_end = axis.to_counts(axis.lower_limit - axis.limit_margin)
    upper_end = axis.to_counts(axis.upper_limit + axis.limit_margin)
    supervised = SupervisedHeartbeat(
        cob_ids.MASTER_NODE_ID, round(1e3 * settings.heartbeat_timeout)
    )
    return {
        'quick_stop_deceleration': _in_drive_units(ramp, 'stop_deceleration'),
        'max_velocity': _in_drive_units(axis, 'max_speed'),
        'max_acceleration': _in_drive_units(ramp, 'max_acceleration'),
        # The zero speed, a share of homing_speed, comes first: its error names the homing_speed
        # that is sufficient for both speeds.
        'homing_zero_speed': _in_drive_units(
            axis, 'homing_speed', axis.homing_zero_share
        ),
        'homing_switch_speed': _in_drive_units(axis, 'homing_speed'),
        'homing_acceleration': _in_drive_units(ramp, 'homing_acceleration'),
        'max_motor_speed': _in_drive_units(motor, 'max_speed'),
        'master_heartbeat': supervised.encode(),
        'heartbeat_time': round(1e3 * settings.heartbeat_period),
        'following_error_window': abs(axis.to_counts(axis.following_error_window)),
        'following_error_time': round(1e3 * axis.following_error_time),
        'min_position': min(lower_end, upper_end),
        'max_position': max(lower_end, upper_end),
        'interpolation_period': round(1e3 * settings.period),
        'sync_period': round(1e6 * settings.period),
        'homing_method': axis.homing_method,
        'home_position': axis.to_counts(axis.home_position),
        'home_offset': axis.to_counts(-axis.home_position),
        'homing_current_threshold': round(1e3 * axis.homing_current),
    }


def _in_drive_units(axis: AxisSettings, name: str, share: float = 1.0) -> int:
    """
    Return a share of an axis's speed or acceleration, in drive units.

    `name` is an attribute of the settings [m/s or m/s²]. For an acceleration, the velocity unit of
    `axis` is the drive's acceleration unit times a second. Raises a ParameterError below one unit,
    because a smaller value may be rounded to 0, and drives may interpret 0 as no limit.
    """
    magnitude = getattr(axis, name)
    unit = abs(axis.si_per_unit.velocity) / share
    if magnitude < unit:
        rounded_up = 1.01 * unit  # above the unit also after rounding to three digits
        raise ParameterError(
            f'axes.{name} = {magnitude:g} rejected: a value below {unit:.3g} is less than one '
            'unit of the drive, and may become 0, which means no limit; '
            f'next: set at least {rounded_up:.3g}'
        )
    return round(magnitude / unit)


QUANTITIES = tuple(quantities(AxisSettings(), ControllerSettings()))  # their names
_ALLOWED['value'] = QUANTITIES


def load_profile(name: str) -> DriveProfile:
    """
    Return the profile with a name in ``config/drives`` (without extension), or at a path.

    The EDS is in the same folder. Raises a ParameterError with file and entry if the file is
    missing or invalid.
    """
    try:
        path = (
            Path(name) if name.endswith('.yaml') else config_path(f'drives/{name}.yaml')
        )
        return _parse(name, path, path.read_text(encoding='utf-8'))
    except FileNotFoundError as error:
        raise ParameterError(
            f'there is no drive profile {name}: {file_sentence(error)}'
        ) from None
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
    ) as error:
        reason = str(error)
        if isinstance(error, KeyError):
            reason = f'{error.args[0]} is missing'
        if isinstance(error, OSError):
            reason = file_sentence(error)
        if NEXT not in reason:
            reason = f'{reason}; next: correct the file'
        raise ParameterError(
            f'the drive profile {name} is not valid: {reason}'
        ) from None


def fitting_profile(vendor_id: int | None, product_code: int | None) -> str:
    """Return the name of the best profile for a drive: by product code, else by vendor id."""
    names = sorted(path.stem for path in config_path('drives').glob('*.yaml'))
    of_product: dict[tuple[int | None, int | None], str] = {}
    for name in names:
        profile = load_profile(name)
        if profile.vendor_id is not None:
            of_product[profile.vendor_id, profile.product_code] = name

    of_maker = of_product.get((vendor_id, None), 'generic_cia402')
    return of_product.get((vendor_id, product_code), of_maker)


@lru_cache(maxsize=8)  # each of the three axes asks twice, and parsing takes 30 ms
def _parse(name: str, path: Path, text: str) -> DriveProfile:
    """Return the profile described by the text of a file; malformed text raises various errors."""
    data = _table(
        'the profile',
        read_value(text),
        [item.name for item in fields(DriveProfile) if item.name != 'name'],
    )
    eds = path.parent / str(data['eds'])
    unit = data['velocity_unit']
    if not eds.is_file():
        raise ValueError(f'its EDS {eds} does not exist')
    entries: dict[str, Any] = {'motor_speed_unit': unit, 'acceleration_unit': unit}
    entries |= data
    entries['name'] = name
    entries['eds'] = eds
    entries['homing_methods'] = tuple(data['homing_methods'])
    entries['objects'] = tuple([_record(ProfileObject, one) for one in data['objects']])
    entries['quirks'] = _record(Quirks, data.get('quirks', {}))

    places = []
    for index, subindex in data.get('of_place', ()):
        places.append((_checked('index', index), _checked('subindex', subindex)))
    entries['of_place'] = tuple(places)

    errors = {}
    for code, meaning in data.get('errors', {}).items():
        errors[row_of(code)] = _record(Fault, meaning)
    entries['errors'] = errors

    if 'pdos' in data:
        entries['pdos'] = _pdos(data['pdos'])
    if 'input_polarity' in data:
        entries['input_polarity'] = _record(InputPolarity, data['input_polarity'])
    return DriveProfile(**entries)


def _record(kind: Any, data: Any) -> Any:
    """Return a named tuple whose fields are the entries of a table."""
    return kind(**_table(kind.__name__, data, kind._fields))


def _table(where: str, data: Any, names: Collection[str]) -> dict[str, Any]:
    """Return the entries of a table; raise an error for an unknown name or an invalid value."""
    if not isinstance(data, dict):
        raise TypeError(f'{where} is {data!r}, not a table')
    for name, value in data.items():
        if name not in names:
            raise ValueError(f'{where} contains the unknown entry {name}')
        for element in value if isinstance(value, list) else (value,):
            _checked(name, element)
    return data


_NUMBER = range(-(2**31), 2**32)


def _checked(name: str, value: Any) -> Any:
    """Return the value of an entry; raise a ValueError for an invalid value."""
    allowed = _ALLOWED.get(name, (value,))
    if name == 'value' and type(value) is int:
        allowed = _NUMBER
    if type(value) is type(allowed[0]) and value in allowed:
        return value

    if isinstance(allowed, range):
        expected = f'from {allowed[0]} to {allowed[-1]}'
    else:
        expected = f'one of {", ".join(map(str, allowed))}'
    raise ValueError(f'{name} = {value!r} is not {expected}')


def _pdos(data: Any) -> tuple[Pdo, ...]:
    """Return the PDOs in a table; raise an error if a necessary object is missing."""
    content = _table('pdos', data, pdo.PDO_NAMES)
    _require_objects(
        'RPDO', content, possible=pdo.COMMAND_OBJECTS, needed=pdo.COMMAND_OBJECTS
    )
    received = pdo.KNOWN_OBJECTS.keys() - pdo.COMMAND_OBJECTS
    _require_objects('TPDO', content, possible=received, needed=pdo.STATUS_OBJECTS)
    pdos = []
    for name, mapped in content.items():
        made = Pdo(name, tuple([pdo.KNOWN_OBJECTS[index] for index in mapped]))
        size = made.codec.size
        if size > pdo.MAX_SIZE:
            raise ValueError(
                f'{name} has {size} bytes, above the limit of {pdo.MAX_SIZE} bytes in a frame'
            )
        pdos.append(made)
    return tuple(pdos)


def _require_objects(
    kind: str,
    content: Mapping[str, Sequence[int]],
    possible: Set[int],
    needed: Set[int],
) -> None:
    """
    Require that the PDOs of one kind map all needed objects, and only permitted objects.

    The kind is ``'RPDO'`` or ``'TPDO'``; `content` has the indices by the name of the PDO. Raises
    a ValueError.
    """
    carried: set[int] = set()
    for name, mapped in content.items():
        if name.startswith(kind):
            carried.update(mapped)

    unknown = carried - possible
    if unknown:
        indices = ', '.join([f'{index:04X}h' for index in sorted(unknown)])
        raise ValueError(f'{kind} maps {indices}, which no {kind} can map')
    for index in sorted(needed - carried):
        raise ValueError(f'no {kind} maps object {index:04X}h, which every drive needs')
