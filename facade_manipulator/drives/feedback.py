"""
Feedback of one drive: the newest TPDO values, and its condition at the end of a cycle.

A value that was never received is None.
"""

from __future__ import annotations

from operator import mul
from typing import Any

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.encoder import Encoder
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.states import decode_state, State, Status

REST_SPEED = 0.002  # m/s, below which a carriage is at rest
# in the order of SiPerUnit
MEASURED_OBJECTS = (
    indices.ACTUAL_POSITION,
    indices.ACTUAL_VELOCITY,
    indices.ACTUAL_TORQUE,
    indices.ACTUAL_FOLLOWING_ERROR,
)


class ProcessData:
    """
    Newest TPDO values of one drive, by object index.

    Measured quantities are in SI units, with the direction of the axis.
    """

    def __init__(self, axis: AxisSettings, tpdos: tuple[Pdo, ...]) -> None:
        units = dict(zip(MEASURED_OBJECTS, axis.si_per_unit, strict=True))
        self._units: dict[str, list[float]] = {}
        for one in tpdos:
            self._units[one.name] = [units.get(index, 1) for index in one.indices]
        #: whether the drive sends its velocity; otherwise it is computed from positions
        self.sends_velocity = any(
            indices.ACTUAL_VELOCITY in one.indices for one in tpdos
        )
        self._values: dict[int, Any] = {}

    def get(self, index: int, default: Any = None) -> Any:
        """Return the newest value of an object, or the default before the first value."""
        return self._values.get(index, default)

    def receive(self, tpdo: Pdo, data: bytes) -> tuple[Any, ...]:
        """Store the values of a TPDO; return them in drive units."""
        raw = tpdo.codec.unpack_from(data)  # a drive may pad the frame
        values = map(mul, raw, self._units[tpdo.name])
        self._values.update(zip(tpdo.indices, values, strict=True))
        return raw

    def receive_speed(self, speed: float) -> None:
        """Store a speed computed from positions [m/s], for a drive that sends no velocity."""
        if not self.sends_velocity:
            self._values[indices.ACTUAL_VELOCITY] = speed


class Feedback:
    """
    Condition of one drive at the end of the newest cycle.

    The group of axes and the supervision of targets read the condition after `end_cycle`. The
    period is the time between two SYNCs [s].
    """

    def __init__(
        self, axis: AxisSettings, profile: DriveProfile, period: float
    ) -> None:
        #: values that may be newer than the end of the cycle
        self.newest = ProcessData(axis, profile.tpdos)
        self.position: float | None = None  #: of the carriage [m]
        self.counts = 0  #: the same position in units of the drive
        self.statusword = 0  #: 6041h; 0 has no state, as a drive without any frame
        #: mode of operation display 6061h; None while the drive does not show it
        self.mode: int | None = None
        self.at_rest = False  #: whether the carriage is at rest
        self.disobedience = ''  #: why an enabled drive does not obey, ``''`` if it does
        self._quirks = profile.quirks
        # below both speeds a carriage is at rest; one count in a cycle is not a motion
        self._rest_speed = REST_SPEED + abs(axis.si_per_unit.position) / period
        self._rest_velocity = (
            REST_SPEED if self.newest.sends_velocity else self._rest_speed
        )
        self._was_remote = False  # whether bit 9 was 1 while the drive was enabled

    def end_cycle(self, encoder: Encoder, may_rest: bool) -> None:
        """
        Update the condition at the end of a cycle.

        `may_rest` is whether the targets are at rest, because reversing carriages rest for a
        moment.
        """
        newest = self.newest
        self.position = newest.get(indices.ACTUAL_POSITION)
        self.counts = encoder.counts or 0
        self.statusword = newest.get(indices.STATUSWORD, 0)
        is_enabled = decode_state(self.statusword) is State.OPERATION_ENABLED
        self.mode = None
        if is_enabled or not self._quirks.hides_mode:
            self.mode = newest.get(indices.MODE_DISPLAY, 0)

        velocity = newest.get(indices.ACTUAL_VELOCITY)
        self.at_rest = (
            may_rest
            and velocity is not None
            and abs(velocity) < self._rest_velocity
            and abs(encoder.speed) < self._rest_speed
        )
        self.disobedience = self._disobedience() if is_enabled else ''

    def _disobedience(self) -> str:
        """Return the reason why the enabled drive does not obey, ``''`` if it does."""
        follows = self.statusword & Status.DRIVE_FOLLOWS or self._quirks.never_follows
        is_remote = bool(self.statusword & Status.REMOTE)
        was_remote = self._was_remote
        self._was_remote = was_remote or is_remote
        if not follows:
            return 'does not follow its targets (bit 12 is 0)'
        if was_remote and not is_remote:
            return 'no longer accepts controlwords from the bus (bit 9 is 0)'
        return ''
