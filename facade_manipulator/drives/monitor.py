"""
Supervision of one drive: its newest values, their age, and its faults.

The exchange passes frames to the monitor. Once a cycle the monitor checks that the drive answers
and obeys. `Encoder` judges the positions. Times are on the monotonic clock [s]. A value that was
never received is None.
"""

from __future__ import annotations

from math import inf
from operator import mul
from typing import Any

from canopen.nmt import NMT_STATES

from facade_manipulator.canopen import indices, nmt
from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.emcy import error_code, fault, is_error_reset
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.axis_settings import AxisSettings, Triple
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.encoder import Encoder
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.snapshot import AxisSnapshot, Cause, Remedy
from facade_manipulator.drives.states import (
    AxisCommand,
    Controlword,
    decode_state,
    Mode,
    State,
    Status,
    STATUSWORDS,
    UNPOWERED_STATES,
)
from facade_manipulator.errors import DriveStateError

ENCODER_REMEDY = (
    'check whether the carriage was pushed, check the encoder and its cable'
)
SYNC_TOLERANCE = 0.001  # s, maximum error between the stamps of a SYNC and its answers
REST_SPEED = 0.002  # m/s, below which a carriage is at rest
ENABLED_MASK, ENABLED = STATUSWORDS[State.OPERATION_ENABLED]
# in the order of SiPerUnit
MEASURED_OBJECTS = (
    indices.ACTUAL_POSITION,
    indices.ACTUAL_VELOCITY,
    indices.ACTUAL_TORQUE,
    indices.ACTUAL_FOLLOWING_ERROR,
)


def positions_of(monitors: tuple[AxisMonitor, ...]) -> Triple:
    """Return the positions of the carriages [m]; raise a DriveStateError if one is unknown."""
    q1, q2, q3 = [one.position for one in monitors]
    if q1 is None or q2 is None or q3 is None:
        raise DriveStateError(
            'not every drive has sent its position yet; next: try again'
        )
    return q1, q2, q3


class Answers:
    """
    Answers of one drive to SYNC, and the SYNCs that it has not answered.

    An answer is complete when all TPDOs of a SYNC have arrived: following errors of different
    cycles must not be compared. The rate is in cycles per second.
    """

    def __init__(self, tpdos: tuple[Pdo, ...], rate: int) -> None:
        #: the last SYNC that each TPDO of every SYNC has answered [s]
        self._answered = {
            one.name: -inf for one in tpdos if one.transmission(rate) == 1
        }
        #: `newest`: time of the last SYNC that the drive has answered completely [s]
        self.newest = self._before = -inf
        #: names of the TPDOs that were never received
        self.silent = {one.name for one in tpdos}
        #: number of SYNCs not answered in time, total and in a row
        self.missed = self.missed_in_a_row = 0
        #: age of the newest answer [cycles]
        self.cycles_old = 0

    def excuse(self) -> None:
        """Count the missing answers in a row from 0 again."""
        self.missed_in_a_row = 0

    def receive(self, name: str, time: float, sync_time: float) -> None:
        """Record a TPDO with its time [s] and the time of the last SYNC [s]."""
        self.silent.discard(name)
        if name in self._answered and time >= sync_time - SYNC_TOLERANCE:
            self._answered[name] = sync_time
            if min(self._answered.values()) == sync_time:
                self.newest = sync_time

    def end_cycle(self, sync_time: float) -> None:
        """
        Count an answer that is missing at the end of the cycle of a SYNC.

        An answer after the end of the previous cycle is late, not missing.
        """
        is_missing = self.newest == self._before
        self._before = self.newest
        self.missed += is_missing
        self.missed_in_a_row = self.missed_in_a_row + 1 if is_missing else 0
        self.cycles_old = max(self.missed_in_a_row, int(self.newest != sync_time))


class AxisMonitor:
    """
    Newest values of one drive, and the supervision of its answers.

    The operator reads the name of the axis.
    """

    def __init__(
        self,
        name: str,
        axis: AxisSettings,
        settings: ControllerSettings,
        profile: DriveProfile,
    ) -> None:
        self.name = name
        self.title = (
            f'{name} (node {axis.node_id})'  #: name and node id for the operator
        )
        self.axis = axis
        self.profile = profile
        self.tpdos = tuple(one for one in profile.pdos if one.is_transmitted)
        self.encoder = Encoder(axis, settings.period)
        self.answers = Answers(self.tpdos, settings.rate)
        #: at the end of the newest cycle: position [m] and [counts], and 6041h, the statusword
        self.position: float | None = None
        self.counts = self.statusword = 0
        #: mode of operation display 6061h; None while the drive does not show it
        self.mode: int | None = None
        self.at_rest = False  #: whether the carriage is at rest
        self.disobedience = ''  #: why an enabled drive does not obey, ``''`` if it does
        self.nmt_state: str | None = None  # as the library names it
        self.heartbeat_time: float | None = None
        #: number of boot-up messages since the last reset, or since the begin of supervision
        self.boot_ups = 0
        #: whether the drive may have power and has ceased to receive commands by process data
        self.is_unreachable = False
        #: whether the drive was silent, so that it may have restarted unnoticed
        self.is_lost = False
        self._may_miss = (
            False  # whether missing answers are excused until the next answer
        )
        self._commanded = 'OPERATIONAL'  # NMT state that this master has commanded
        self._expected = {self._commanded}  # and states that may precede it
        self.forget_errors()
        self.serial_number: int | None = None
        #: whether the drive, as it was configured, stops when this computer falls silent
        self.stops_without_master = False
        self._rpdos = tuple(
            (one.cob_id(axis.node_id), one.codec.pack, one.indices)
            for one in profile.pdos
            if not one.is_transmitted
        )
        units = dict(zip(MEASURED_OBJECTS, axis.si_per_unit, strict=True))
        self._units = {
            one.name: [units.get(index, 1) for index in one.indices]
            for one in self.tpdos
        }
        # one count in a cycle is not a motion
        self._rest_speed = REST_SPEED + abs(axis.si_per_unit.position) / settings.period
        self._values: dict[int, Any] = {}  # by index, in SI units where it is measured
        self._sends_velocity = any(
            indices.ACTUAL_VELOCITY in one.indices for one in self.tpdos
        )
        self._settings = settings
        self._supervised_since = -inf
        self._was_remote = False
        self._toggled_bit = (
            0  # bit 4 of the last controlword, where the drive needs its change
        )

    def snapshot(self, target: float | None, now: float) -> AxisSnapshot:
        """Return the newest values, with the commanded target [m], at a time [s]."""
        age = self.heartbeat_time and now - self.heartbeat_time
        position, velocity, force, following_error = map(
            self._values.get, MEASURED_OBJECTS
        )
        return AxisSnapshot(
            self.name,
            self.axis.node_id,
            self._values.get(indices.STATUSWORD),
            position,
            velocity,
            force,
            following_error,
            self._values.get(indices.DIGITAL_INPUTS),
            self.encoder.homed,
            self.error_code,
            age,
            self.answers.missed,
            self.serial_number,
            target,
            age is not None and self.silence(now) is not None,
            self.error,
            self.warning,
        )

    def forget_errors(self) -> None:
        """Forget the errors and warnings of the drive."""
        #: the last error code; 0 for none, or after the drive has reset it
        self.error_code = 0
        self.error = ''  #: the same as a message
        #: the warning of the drive and its remedy, ``''`` for none
        self.warning = ''

    def begin_supervision(self, now: float) -> None:
        """Treat silence as a fault after a time [s]."""
        self._supervised_since = now
        self.boot_ups = 0
        self.is_lost = False
        self.answers = Answers(self.tpdos, self._settings.rate)

    def excuse_silence(self, now: float) -> None:
        """
        Excuse silence and missing answers before a time [s].

        The frames were not read, or were dropped from a full queue.
        """
        self._supervised_since = now

    def expect(self, nmt_state: str) -> None:
        """Expect an NMT state that this master commands."""
        if nmt_state != self._commanded:
            self._expected = {self._commanded, nmt_state}
            self._may_miss = True
        self._commanded = nmt_state

    def encode(self, command: AxisCommand, target: int) -> list[tuple[int, bytes]]:
        """Return COB-ID and data of the RPDOs with a command and a target [counts]."""
        if self.boot_ups:  # the PDO mapping is lost
            return []
        values = {
            indices.CONTROLWORD: command.controlword | self._cyclic_bit_4(command),
            indices.MODE_OF_OPERATION: command.mode,
            indices.TARGET_POSITION: target,
        }
        return [
            (cob_id, pack(*[values[index] for index in indices]))
            for cob_id, pack, indices in self._rpdos
        ]

    def _cyclic_bit_4(self, command: AxisCommand) -> int:
        """Return bit 4 of the controlword for a drive that needs it to take each target."""
        is_cyclic = command.mode == Mode.CYCLIC_SYNCHRONOUS_POSITION
        is_enabled = command.controlword & 0x0F == Controlword.ENABLE_OPERATION
        kind = self.profile.quirks.cyclic_bit_4
        if not (is_cyclic and is_enabled) or kind == 'clear':
            return 0
        if kind == 'toggled':
            self._toggled_bit ^= Controlword.NEW_TARGET
            return self._toggled_bit
        return Controlword.NEW_TARGET

    def receive_tpdo(
        self, tpdo: Pdo, data: bytes, time: float, sync_time: float
    ) -> Cause | None:
        """Receive process data; return the cause of a stop, if any."""
        raw = tpdo.codec.unpack_from(data)  # a drive may pad the frame
        self._values.update(
            zip(tpdo.indices, map(mul, raw, self._units[tpdo.name]), strict=True)
        )
        self.answers.receive(tpdo.name, time, sync_time)
        cause, code = None, self._values.get(indices.ERROR_CODE, 0)
        is_in_fault = self._values.get(indices.STATUSWORD, 0) & Status.FAULT
        if (
            indices.ERROR_CODE in tpdo.indices
            and is_in_fault
            and code != self.error_code
            and not is_error_reset(code)
        ):  # a drive may report its error only by 603Fh
            cause = self._receive_error(code)
        if indices.ACTUAL_POSITION not in tpdo.indices:
            return cause
        distrust = self.encoder.receive(
            raw[tpdo.indices.index(indices.ACTUAL_POSITION)], time
        )
        if not self._sends_velocity:
            self._values[indices.ACTUAL_VELOCITY] = self.encoder.speed
        return (
            cause
            if not distrust
            else Cause(
                f'{self.title}: the position {distrust}',
                ENCODER_REMEDY,
                self.name,
                cut_power=True,
            )
        )

    def receive_emergency(self, frame: Frame) -> Cause | None:
        """
        Receive an emergency message; return the cause of a stop, None for a warning or a reset.

        A drive that faults in spite of a code that its maker calls a warning shows the fault in
        its statusword.
        """
        code = error_code(frame.data)
        if is_error_reset(code):
            self.forget_errors()
            return None
        meaning = fault(code, self.profile.errors)
        if meaning.is_warning:
            self.warning = f'it warns: {meaning.message}: {meaning.remedy}'
            return None
        return self._receive_error(code)

    def _receive_error(self, code: int) -> Cause | None:
        meaning = fault(code, self.profile.errors)
        self.error_code = code
        self.error = meaning.message
        if meaning.loses_position:
            self.encoder.distrust()
        return Cause(
            f'{self.title}: {self.error}',
            meaning.remedy,
            self.name,
            cut_power=meaning.loses_position,
        )

    def receive_heartbeat(self, frame: Frame) -> Cause | None:
        """Receive a heartbeat or boot-up message; return the cause of a stop, if any."""
        number = nmt.state_number(frame.data)
        self.nmt_state = NMT_STATES.get(number)
        # a heartbeat seems old if the clock is set while it is on its way
        self.heartbeat_time = max(frame.time, self.heartbeat_time or frame.time)
        if self.nmt_state == self._commanded:
            self._expected = {self._commanded}
        is_pre_operational = self.nmt_state == 'PRE-OPERATIONAL'
        is_uncommanded = is_pre_operational and self.nmt_state not in self._expected
        may_have_power = decode_state(self.statusword) not in UNPOWERED_STATES
        self.is_unreachable = is_uncommanded and may_have_power
        if is_uncommanded:
            self.encoder.distrust()  # the drive may have restarted
        if self.nmt_state == 'INITIALISING':
            self.boot_ups += 1
            self.encoder.distrust()
            return Cause(
                f'{self.title} has restarted by itself and has lost its position',
                Remedy.CONFIGURE,
                self.name,
                configure_again=True,
            )
        return (
            None
            if self.nmt_state == 'OPERATIONAL'
            else Cause(
                f'{self.title} is no longer operational (NMT state {number})',
                'check the bus',
                self.name,
            )
        )

    def end_cycle(self, sync_time: float) -> None:
        """Update the status for the group; a drive without any frame has no state."""
        self.answers.end_cycle(sync_time)
        values, quirks = self._values, self.profile.quirks
        self.position = values.get(indices.ACTUAL_POSITION)
        self.counts = self.encoder.counts or 0
        self.statusword = word = values.get(indices.STATUSWORD, 0)
        is_enabled = word & ENABLED_MASK == ENABLED
        self.mode = (
            values.get(indices.MODE_DISPLAY, 0)
            if is_enabled or not quirks.hides_mode
            else None
        )
        velocity = values.get(
            indices.ACTUAL_VELOCITY
        )  # by the drive, and by its positions
        self.at_rest = (
            velocity is not None
            and abs(velocity) < REST_SPEED
            and abs(self.encoder.speed) < self._rest_speed
        )
        self.disobedience = ''
        if is_enabled and not (word & Status.DRIVE_FOLLOWS or quirks.never_follows):
            self.disobedience = 'does not follow its targets, bit 12 is 0'
        elif is_enabled and self._was_remote and not word & Status.REMOTE:
            self.disobedience = 'no longer takes controlwords from the bus, bit 9 is 0'
        self._was_remote = self._was_remote or bool(is_enabled and word & Status.REMOTE)

    def silence(self, now: float) -> Cause | None:
        """Return the cause of a stop if answers or heartbeats are missing at a time [s]."""
        settings, missed = self._settings, self.answers.missed_in_a_row
        age = self._heartbeat_age(now)
        if missed >= settings.max_missed_cycles:
            failure = (
                f'did not answer {missed} cycles in a row, '
                f'the limit is {settings.max_missed_cycles} (controller.max_missed_cycles)'
            )
        elif age > settings.heartbeat_timeout:
            failure = (
                f'sent no heartbeat for {1e3 * age:.0f} ms, '
                f'above the limit {1e3 * settings.heartbeat_timeout:.0f} ms '
                '(controller.heartbeat_timeout)'
            )
        else:
            return None
        return Cause(
            f'{self.title} {failure}',
            Remedy.CONFIGURE,
            self.name,
            configure_again=True,
            is_vague=True,
        )

    def new_silence(self, now: float) -> Cause | None:
        """
        Return the cause of a stop if the drive is silent at a time [s], None if it is lost.

        A drive in an NMT state other than operational answers no SYNC.
        """
        if not self.answers.missed_in_a_row:
            self._may_miss = False
        may_miss = self._may_miss or self._commanded != 'OPERATIONAL'
        if now < self._supervised_since and not may_miss:
            self.answers.excuse()
        has_heartbeat = self._heartbeat_age(now) <= self._settings.heartbeat_timeout
        if self.is_lost or (may_miss and has_heartbeat):
            return None
        return self.silence(now)

    def lose(self) -> None:
        """Record that the drive was silent: it may have restarted and lost its position."""
        self.is_lost = True
        self.encoder.distrust()

    def _heartbeat_age(self, now: float) -> float:
        return now - max(self.heartbeat_time or 0.0, self._supervised_since)
