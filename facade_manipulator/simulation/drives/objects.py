"""
Object dictionary, SDO server, NMT slave and EMCY producer of a simulated drive.

The node is the `LocalNode` of canopen, with three differences for a simulated drive:

- an `Outbox` replaces its `Network`: it stores frames and heartbeat, instead of sending the frames
  on a bus and repeating the heartbeat in a thread,
- `values` replaces its `data_store`: it contains numbers instead of bytes, because modes and motor
  read the numbers at each step,
- this module also checks limits and stores parameters (1010h).

References
----------
CiA 301: object dictionary, SDO abort codes, heartbeat protocol.

"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import lru_cache, partial
import math
from pathlib import Path
from typing import Any

from canopen import LocalNode, ObjectDictionary, SdoAbortedError
from canopen.sdo import constants

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.eds import read_dictionary, variables
from facade_manipulator.canopen.pdo import MAPPING_OFFSET
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.errors import ParameterError

Key = tuple[int, int]
Frame = tuple[int, bytes]


# that services, modes and motor read; a drive may lack 1016h
_NEEDED = {
    (indices.COB_ID_SYNC, 0),
    (indices.PRODUCER_HEARTBEAT_TIME, 0),
    *((indices.IDENTITY, subindex) for subindex in (1, 2, 3, 4)),
    (indices.CONTROLWORD, 0),
    (indices.QUICK_STOP_OPTION, 0),
    (indices.MODE_OF_OPERATION, 0),
    (indices.FOLLOWING_ERROR_WINDOW, 0),
    (indices.FOLLOWING_ERROR_TIME, 0),
    (indices.TARGET_POSITION, 0),
    (indices.POSITION_LIMITS, 1),
    (indices.POSITION_LIMITS, 2),
    (indices.MAXIMUM_VELOCITY, 0),
    (indices.MAXIMUM_MOTOR_SPEED, 0),
    (indices.QUICK_STOP_DECELERATION, 0),
    (indices.HOMING_METHOD, 0),
    (indices.HOMING_SPEEDS, 1),
    (indices.HOMING_SPEEDS, 2),
    (indices.HOMING_ACCELERATION, 0),
    (indices.INTERPOLATION_PERIOD, 1),
    (indices.INTERPOLATION_PERIOD, 2),
    (indices.MAXIMUM_ACCELERATION, 0),
}


@lru_cache(maxsize=16)
def _dictionary(eds: Path, node_id: int) -> ObjectDictionary:
    """Return the objects of an EDS; raise a ParameterError if a required object is missing."""
    dictionary = read_dictionary(eds, node_id)
    pdos = [
        *range(indices.RPDO_COMMUNICATION, indices.RPDO_MAPPING),
        *range(indices.TPDO_COMMUNICATION, indices.TPDO_MAPPING),
    ]
    lacking = {index for index, _ in _NEEDED - variables(dictionary).keys()}
    for index in pdos:
        mapping = index + MAPPING_OFFSET
        if index in dictionary and mapping not in dictionary:
            lacking.add(mapping)
    if lacking:
        names = ', '.join(f'{index:04X}h' for index in sorted(lacking))
        raise ParameterError(
            f'{eds} rejected: it lacks {names}, which a simulated drive needs; next: add the '
            'objects to the EDS, or use another profile'
        )
    return dictionary


class Outbox:
    """
    Substitute for the library's `Network`; `frames` stores the frames to send.

    The outbox is also the task of the heartbeat, the only periodic message of a node. `due` is the
    time of the next heartbeat [s].
    """

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.now = 0.0
        self.due = math.inf

    def send_message(self, can_id: int, data: Sequence[int]) -> None:
        """Store a frame until `take` is called."""
        self.frames.append((can_id, bytes(data)))

    def subscribe(self, can_id: int, callback: object) -> None:
        """Ignore a subscription, because the drive selects the receiver of each frame."""

    def send_periodic(self, can_id: int, data: Sequence[int], period: float) -> Outbox:
        """Start the heartbeat with a period [s]."""
        self._beat = (can_id, bytes(data))
        self._period = period
        self.due = self.now + period
        return self

    def update(self, data: Sequence[int]) -> None:
        """Change the data of the heartbeat."""
        self._beat = self._beat[0], bytes(data)

    def stop(self) -> None:
        """Stop the heartbeat."""
        self.due = math.inf

    def take(self) -> list[Frame]:
        """Return and remove the stored frames; add the heartbeat if it is due."""
        if self.now >= self.due:
            self.frames.append(self._beat)
            # keep the rate, although each call is slightly late
            self.due = max(self.due, self.now - self._period) + self._period
        frames = self.frames
        self.frames = []
        return frames


class Objects(LocalNode):
    """
    Objects of one drive by index and subindex, with the CANopen services that use them.

    The EDS of the drive type contains the values after a reset. `missing` contains the indices
    that this drive lacks. A drive restarts its objects before it uses them.
    """

    _STORE = (indices.STORE_PARAMETERS, 1)
    _SAVE = int.from_bytes(b'save', 'little')
    # objects of the EDS that are absent, because the simulated drives neither list errors nor
    # restore
    _ABSENT = (indices.ERROR_FIELD, indices.RESTORE_PARAMETERS)
    # writable objects that are never stored
    _NEVER_STORED = {
        indices.STORE_PARAMETERS,
        indices.CONTROLWORD,
        indices.MODE_OF_OPERATION,
        indices.TARGET_POSITION,
    }
    # of the units of speeds and accelerations in the profile of a drive
    _SPEEDS = (
        indices.ACTUAL_VELOCITY,
        indices.MAXIMUM_VELOCITY,
        indices.HOMING_SPEEDS,
    )
    _MOTOR_SPEEDS = (indices.MAXIMUM_MOTOR_SPEED,)
    _ACCELERATIONS = (
        indices.PROFILE_DECELERATION,
        indices.QUICK_STOP_DECELERATION,
        indices.HOMING_ACCELERATION,
        indices.MAXIMUM_ACCELERATION,
    )

    def __init__(
        self, profile: DriveProfile, axis: AxisSettings, missing: Collection[int]
    ) -> None:
        self.profile = profile
        self.missing = [*self._ABSENT, *missing]
        self.outbox = Outbox()
        self.values: dict[Key, Any] = {}
        #: values after a reset in which this drive differs from its EDS
        self.defaults: dict[Key, Any] = {}
        #: values that 1010h has stored, which precede the defaults
        self.stored: dict[Key, Any] = {}
        self.readers: dict[Key, Callable[[], Any]] = {}  #: return measured values
        self.choices: dict[Key, Collection[int]] = {}  #: permitted values of an object
        #: called before a value is stored; each acts on it or raises an `SdoAbortedError`
        self.writers: dict[Key, Callable[[int], None]] = {self._STORE: self._store}
        #: units of speeds per count/s, and of accelerations per count/s², by index
        self.units: dict[int, float] = {}
        for unit, quantities in (
            (profile.velocity_unit, self._SPEEDS),
            (profile.motor_speed_unit, self._MOTOR_SPEEDS),
            (profile.acceleration_unit, self._ACCELERATIONS),
        ):
            scaled = replace(axis, velocity_unit=unit)
            for index in quantities:
                self.units[index] = scaled.velocity_units_per_count

    def restart(self, node_id: int, keeps_application: bool) -> None:
        """
        Reset to a node that has not booted; identifiers and some defaults depend on its node id.

        All objects, or only the communication objects, get their stored or default values.

        """
        super().__init__(node_id, _dictionary(self.profile.eds, node_id))
        self.variables = variables(self.object_dictionary)
        for key in list(self.variables):
            if key[0] in self.missing:
                del self.variables[key]
        self.outbox.stop()
        self.associate_network(self.outbox)  # type: ignore[arg-type]
        # without them the server raises at a segment without an initiated transfer
        self.sdo._index = 0
        self.sdo._subindex = 0
        self.sdo._buffer = bytearray()
        self.add_read_callback(lambda index, subindex, od: self.read((index, subindex)))
        self.add_write_callback(
            lambda index, subindex, od, data: self.write(
                (index, subindex), od.decode_raw(bytes(data))
            )
        )
        initial = {key: variable.default for key, variable in self.variables.items()}
        initial |= self.defaults | self.stored
        for key, value in initial.items():
            if not keeps_application or key[0] in indices.COMMUNICATION:
                self.values[key] = value

    def _store(self, signature: int) -> None:
        """Store all writable values; the stored values take effect after a reset."""
        if signature != self._SAVE:
            raise SdoAbortedError(constants.ABORT_STORE_APPLICATION)
        self.stored = {}
        for key, variable in self.variables.items():
            is_setting = variable.writable and key[0] not in self._NEVER_STORED
            default = self.defaults.get(key, variable.default)
            if is_setting and self.values[key] != default:
                self.stored[key] = self.values[key]

    def read(self, key: Key) -> Any:
        """Return the current value of an object."""
        return self.readers.get(key, partial(self.values.__getitem__, key))()

    def counts(self, index: int, subindex: int = 0) -> float:
        """Return a speed [counts/s] or acceleration [counts/s²] read from its object."""
        return self.values[index, subindex] / self.units[index]

    def write(self, key: Key, value: Any) -> None:
        """Write a value from a PDO or SDO; raise an SdoAbortedError for an invalid value."""
        variable = self.variables[key]
        if variable.max is not None and value > variable.max:
            raise SdoAbortedError(constants.ABORT_VALUE_TOO_HIGH)
        if variable.min is not None and value < variable.min:
            raise SdoAbortedError(constants.ABORT_VALUE_TOO_LOW)
        if value not in self.choices.get(key, (value,)):
            raise SdoAbortedError(constants.ABORT_INVALID_VALUE)
        if key in self.writers:
            self.writers[key](value)
        if key != self._STORE:
            self.values[key] = value
