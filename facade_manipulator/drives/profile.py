"""
Drive types as data: process data, objects that are written, homing methods, units, quirks.

A further CiA 402 drive is one more file in ``config/drives``, not code.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.emergency import Fault
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.units import VELOCITY_UNITS
from facade_manipulator.errors import ParameterError
from facade_manipulator.resources import config_path

# what a profile may ask to be written; `configuration.quantities` has each per axis
QUANTITIES = frozenset({
    'master_heartbeat', 'heartbeat_time', 'sync_period', 'interpolation_period',
    'quick_stop_deceleration', 'following_error_window', 'following_error_time', 'min_position',
    'max_position', 'max_velocity', 'max_motor_speed', 'max_acceleration', 'homing_method',
    'home_position', 'home_offset', 'homing_switch_speed', 'homing_zero_speed',
    'homing_acceleration', 'homing_current_threshold',
})
# of older profiles; they made no difference to the driver
FORMER_QUIRKS = {'pdo_only_on_sync', 'zero_statusword_until_controlword'}
MOST_BYTES = 8  # of a CAN frame
MODE_BITS = 0x70  # of the controlword, to which each mode of operation gives its own meaning
_CODES = {8: 'B', 16: 'H', 32: 'I'}


class InputPolarity(NamedTuple):
    """The object that inverts digital inputs: its bit n + shift inverts bit n of 60FDh."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    shift: int = 0


class ProfileObject(NamedTuple):
    """An object to write: `value` is a number or a key of `QUANTITIES`."""

    index: int  # type: ignore[assignment]  # hides tuple.index
    subindex: int
    value: int | str
    required: bool

    def __repr__(self) -> str:
        need = 'required' if self.required else 'optional'
        return f'{self.index:04X}h:{self.subindex:02X} = {self.value}, {need}'


@dataclass(frozen=True)
class Quirks:
    """How a drive departs from CiA 402; the state machine copes with all of them."""

    boots_operational: bool = False
    never_follows: bool = False
    hides_mode: bool = False  #: 6061h shows the mode only in operation enabled
    csp_bits: int = 0  #: bits of the controlword that cyclic synchronous position needs


@dataclass(frozen=True)
class DriveProfile:
    """A drive type."""

    name: str  #: name of the profile's file without its ending
    description: str  #: what an operator reads
    eds: Path  #: its electronic data sheet
    #: key of `facade_manipulator.drives.units.VELOCITY_UNITS`
    velocity_unit: str
    motor_speed_unit: str  #: likewise, of 6080h, which differs between makers
    acceleration_unit: str  #: likewise, per second, of 6083h to 6085h, 609Ah and 60C5h
    homing_methods: tuple[int, ...]  #: homing methods that it supports
    quirks: Quirks  #: departures from the standard
    objects: tuple[ProfileObject, ...]  #: what is written at configure, in this order
    #: whose drives these are (1018h:1); None for no particular maker's
    vendor_id: int | None = None
    product_code: int | None = None  #: likewise, 1018h:2
    pdos: tuple[Pdo, ...] = pdo.PDO_MAP  #: the process data in use
    #: index and subindex of what belongs to a place on the bus: node id, bit rate
    of_place: tuple[tuple[int, int], ...] = ()
    #: position counts per revolution of the motor; 0 where the axis's encoder says it
    counts_per_revolution: int = 0
    input_polarity: InputPolarity | None = None  #: None where only the maker's tool has it
    #: index of the object that says what a lost master does to the drive; 0 in it: nothing
    lost_master_reaction: int = 0x6007
    #: error codes (603Fh, emergency messages) to which the maker gives a meaning of its own
    errors: Mapping[int, Fault] = field(default_factory=dict)

    def location(self, quantity: str) -> tuple[int, int] | None:
        """Return index and subindex of the object that takes a quantity, None if none does."""
        for item in self.objects:
            if item.value == quantity:
                return item.index, item.subindex
        return None

    @property
    def heartbeat_consumer(self) -> tuple[int, int]:
        """Index and subindex of the object by which it watches the master's heartbeat."""
        return self.location('master_heartbeat') or (0x1016, 1)

    def applied(self, axis: AxisSettings) -> AxisSettings:
        """Return an axis with what its drive type knows of units, encoder and identity."""
        return replace(
            axis, velocity_unit=self.velocity_unit, acceleration_unit=self.acceleration_unit,
            profile_counts=self.counts_per_revolution,
            vendor_id=axis.vendor_id or self.vendor_id or 0,
            product_code=axis.product_code or self.product_code or 0)

    @property
    def stops_without_master(self) -> bool:
        """Return whether it makes each drive of this type stop when its master falls silent."""
        written = [item for item in self.objects if item.required and item.value]
        return (any(item.value == 'master_heartbeat' for item in written)
                and any(item.index == self.lost_master_reaction for item in written))


def load_profile(name: str, directory: str | Path | None = None) -> DriveProfile:
    """
    Read a profile: a file of a directory without ``.yaml``, or a path of its own with it.

    The default directory, where the EDS is, too, is the package's ``config/drives``. Raises a
    ParameterError, naming file and entry, if there is no such file, or it is not a profile.
    """
    path = profile_path(name, directory)
    try:
        return _profile(name, path, path.read_text(encoding='utf-8'))
    except FileNotFoundError:
        raise ParameterError(f'there is no drive profile {name}: {path} does not exist') from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(f'the drive profile {path} cannot be read: {error}') from None
    except (ValueError, TypeError, KeyError) as error:
        reason = f'{error.args[0]} is missing' if isinstance(error, KeyError) else error
        raise ParameterError(f'the drive profile {path} is not valid: {reason}') from None


def profile_files(name: str) -> tuple[Path, Path]:
    """Return the files of a profile: its own and its EDS; raises a ParameterError."""
    return profile_path(name), load_profile(name).eds


def profile_checksums(names: Iterable[str]) -> str:
    """Return the files of profiles, each with its checksum or why there is none."""
    try:
        files = dict.fromkeys(path for name in names for path in profile_files(name))
        return ', '.join(
            f'{path.name} {sha256(path.read_bytes()).hexdigest()[:8]}' for path in files)
    except (OSError, ParameterError) as error:
        return str(error)


def profile_path(name: str, directory: str | Path | None = None) -> Path:
    """Return where `load_profile` reads a profile."""
    if name.endswith('.yaml'):
        return Path(name)
    try:
        folder = config_path('drives') if directory is None else Path(directory)
    except FileNotFoundError as error:
        raise ParameterError(f'there is no drive profile {name}: {error}') from None
    return folder / f'{name}.yaml'


@lru_cache(maxsize=8)  # each of the three axes asks twice, and YAML takes 30 ms
def _profile(name: str, path: Path, text: str) -> DriveProfile:
    data: Any = yaml.safe_load(text)
    _check_keys('the profile', data, {item.name for item in fields(DriveProfile)} - {'name'})
    return DriveProfile(
        name=name,
        description=str(data['description']),
        eds=_eds(path.parent / str(data['eds'])),
        velocity_unit=_velocity_unit(data, 'velocity_unit', data['velocity_unit']),
        motor_speed_unit=_velocity_unit(data, 'motor_speed_unit', data['velocity_unit']),
        acceleration_unit=_velocity_unit(data, 'acceleration_unit', data['velocity_unit']),
        homing_methods=tuple(_integer('a homing method', m, -128, 127)
                             for m in data['homing_methods']),
        quirks=_quirks(data.get('quirks', {})),
        objects=tuple(_object(item) for item in data['objects']),
        vendor_id=_optional(data, 'vendor_id', None),
        product_code=_optional(data, 'product_code', None),
        counts_per_revolution=_optional(data, 'counts_per_revolution', 0),
        input_polarity=_input_polarity(data['input_polarity'])
        if 'input_polarity' in data else None,
        lost_master_reaction=_optional(data, 'lost_master_reaction', 0x6007),
        pdos=_pdos(data['pdos']) if 'pdos' in data else pdo.PDO_MAP,
        of_place=_locations(data.get('of_place', ())),
        errors=_errors(data.get('errors', {})),
    )


def _locations(data: Any) -> tuple[tuple[int, int], ...]:
    return tuple((_integer('index', index, 0x1000, 0xFFFF), _integer('subindex', subindex, 0, 254))
                 for index, subindex in data)


def fitting_profile(vendor_id: int | None, product_code: int | None) -> str:
    """Return the name of the package's profile that fits a drive best: by product, by maker."""
    known = [load_profile(path.stem) for path in sorted(config_path('drives').glob('*.yaml'))]
    for product in (product_code, None):
        for one in known:
            if vendor_id is not None and (one.vendor_id, one.product_code) == (vendor_id, product):
                return one.name
    return 'generic_cia402'


def _check_keys(where: str, data: Any, known: set[str]) -> None:
    if not isinstance(data, dict):
        raise TypeError(f'{where} is {data!r}, not a table')
    for key in data:
        if key not in known:
            raise ValueError(f'{where} has the unknown entry {key}')


def _eds(path: Path) -> Path:
    if not path.is_file():
        raise ValueError(f'its EDS {path} does not exist')
    return path


def _velocity_unit(data: dict[str, Any], name: str, default: Any) -> str:
    unit = data.get(name, default)
    if unit not in VELOCITY_UNITS:
        raise ValueError(f'{name} = {unit} is not one of {", ".join(VELOCITY_UNITS)}')
    return unit


def _optional(data: dict[str, Any], name: str, default: Any) -> Any:
    return _integer(name, data[name], 0, 2**32 - 1) if name in data else default


def _input_polarity(data: Any) -> InputPolarity:
    _check_keys('input_polarity', data, set(InputPolarity._fields))
    return InputPolarity(**{name: _integer(f'{name} of input_polarity', value, 0, 0xFFFF)
                            for name, value in data.items()})


def _pdos(data: Any) -> tuple[Pdo, ...]:
    """Return the PDOs of a table; together they must carry what no drive can do without."""
    _check_keys('pdos', data, {f'{direction}PDO{n}' for direction in 'RT' for n in range(1, 5)})
    pdos = tuple(
        pdo.make_pdo(name, tuple(_mapped(name, item) for item in content))
        for name, content in data.items())
    for one in pdos:
        if one.codec.size > MOST_BYTES:
            raise ValueError(f'{one.name} has {one.codec.size} bytes, bound {MOST_BYTES}')
    for kind, needed in (('RPDO', pdo.COMMANDS), ('TPDO', pdo.STATUS)):
        carried = {index for one in pdos if one.name.startswith(kind) for index in one.indices}
        for index in sorted(needed - carried):
            raise ValueError(f'no {kind} carries object {index:04X}, which every drive needs')
    return pdos


def _mapped(name: str, data: Any) -> pdo.MappedObject:
    """Return an object in a PDO: a known one by its index, any other one with its length."""
    if isinstance(data, dict):
        _check_keys(f'an object of {name}', data, {'index', 'subindex', 'bits'})
        if data['bits'] not in _CODES:
            raise ValueError(f'an object of {name} has {data["bits"]} bits, not 8, 16 or 32')
        return pdo.MappedObject(
            _integer('index', data['index'], 0x1000, 0xFFFF),
            _integer('subindex', data['subindex'], 0, 254), _CODES[data['bits']])
    known = [index for index in pdo.KNOWN_OBJECTS
             if (index in pdo.COMMANDS) == name.startswith('R')]
    if data not in known:
        raise ValueError(
            f'{name} carries {data!r}, which is not one of '
            f'{", ".join(f"0x{index:04X}" for index in known)}: state index, subindex and bits')
    return pdo.KNOWN_OBJECTS[data]


def _quirks(data: Any) -> Quirks:
    names = {item.name for item in fields(Quirks)}
    _check_keys('quirks', data, names | FORMER_QUIRKS)
    bits = _integer('quirk csp_bits', data.get('csp_bits', 0), 0, MODE_BITS)
    if bits & ~MODE_BITS:
        raise ValueError(f'quirk csp_bits = 0x{bits:X} has other bits than 4 to 6')
    return Quirks(csp_bits=bits, **{
        name: _boolean(f'quirk {name}', data[name])
        for name in names & data.keys() - {'csp_bits'}})


def _errors(data: Any) -> dict[int, Fault]:
    for code, meaning in dict(data).items():
        _integer('an error code', code, 0x100, 0xFFFF)  # 00xxh: no error
        _check_keys(f'error {code:04X}', meaning, set(Fault._fields))
        for name in ('loses_position', 'is_warning') & meaning.keys():
            _boolean(f'{name} of error {code:04X}', meaning[name])
    return {code: Fault(**meaning) for code, meaning in data.items()}


def _object(data: Any) -> ProfileObject:
    _check_keys('an object', data, set(ProfileObject._fields))
    index = _integer('index', data['index'], 0x1000, 0xFFFF)
    value = data['value']
    if isinstance(value, str) and value not in QUANTITIES:
        raise ValueError(f'object {index:04X} takes {value}, which is no quantity of an axis')
    if not isinstance(value, str):
        _integer(f'the value of object {index:04X}', value, -2**31, 2**32 - 1)
    return ProfileObject(
        index, _integer('subindex', data['subindex'], 0, 254), value,
        _boolean('required', data['required']))


def _integer(name: str, value: Any, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ValueError(f'{name} = {value!r} is not a whole number from {low} to {high}')
    return value


def _boolean(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f'{name} = {value!r} is neither true nor false')
    return value
