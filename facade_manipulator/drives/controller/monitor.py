"""
What was received from one drive, how old it is, and what is wrong with it.

The receiver hands in frames; once a cycle the monitor says whether the drive is still
there. Times are on the monotonic clock [s]. What was never received is None.
"""

from __future__ import annotations

from collections.abc import Iterable
import math

from facade_manipulator.drives.canopen import (
    decode_emergency,
    describe,
    fault,
    Frame,
    is_error_reset,
    NmtState,
    Pdo,
    pdo,
    PDO_MAP,
    Reaction,
)
from facade_manipulator.drives.cia402 import (
    AxisCommand,
    AxisSettings,
    BUS_REMEDY,
    Cause,
    CONFIGURE_REMEDY,
    Feedback,
    Measured,
    Mode,
    Status,
    Triple,
)
from facade_manipulator.drives.controller.bus_load import transmission_type
from facade_manipulator.drives.controller.encoder import Encoder
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import AxisSnapshot
from facade_manipulator.errors import DriveStateError

SYNC_TOLERANCE = 0.001
EVERY_SYNC = 1
REST_SPEED = 0.002  # m/s, below which a carriage is at rest
STATUSWORD, MODE, POSITION = pdo.TPDO1.indices
VELOCITY, FOLLOWING_ERROR = pdo.TPDO2.indices
ERROR_CODE, TORQUE, INPUTS = pdo.TPDO3.indices
MEASURED_OBJECTS = (POSITION, VELOCITY, TORQUE, FOLLOWING_ERROR)  # in the order of Measured


class AxisMonitor:
    """
    Newest values of one drive and the supervision of its answers.

    Parameters
    ----------
    name : str
        What the operator calls the axis.
    axis : AxisSettings
        With the velocity unit of the drive's profile.
    settings : ControllerSettings
    pdos : tuple of Pdo
        The drive's process data.

    Attributes
    ----------
    encoder : Encoder
        What the position is worth.
    measured : Measured
        What the drive measured, as of the newest cycle.
    tracking_error : float
        Following error then beyond the lag that the drive is known to have [m]; 0 if unknown.
    silent_tpdos : set of str
        Which TPDOs have not come yet since supervision has begun.
    answered : float
        When the last SYNC was sent that the drive has answered in full.

    """

    def __init__(
        self, name: str, axis: AxisSettings, settings: ControllerSettings,
        pdos: tuple[Pdo, ...] = PDO_MAP,
    ) -> None:
        self.name = name
        self.axis = axis
        self.tpdos = tuple(one for one in pdos if one.is_transmitted)
        self.silent_tpdos: set[str] = set()
        self._rpdos = tuple(
            (one.cob_id(axis.node_id), one.codec.pack, one.indices)
            for one in pdos if not one.is_transmitted)
        # all that come with each SYNC: following errors of different cycles compare badly
        self._answers = frozenset(
            one.name for one in self.tpdos
            if transmission_type(one, settings.rate) == EVERY_SYNC)
        self._unanswered: set[str] = set()  # of these, to the newest SYNC
        self._sync_time = -math.inf  # of that SYNC
        self._values: dict[int, int] = {}  # by index, in the drive's own units
        self._sends_velocity = any(VELOCITY in one.indices for one in self.tpdos)
        self.answered = -math.inf
        self.encoder = Encoder(axis, settings.period)
        self.measured = Measured()
        self.tracking_error = 0.0
        self.nmt_state: int | None = None
        self.heartbeat_time: float | None = None
        self.boot_ups = 0
        self.has_restarted = False  # since it was configured: it would not know what RPDOs mean
        self.error_code = 0
        self.serial_number: int | None = None
        self._answered_before = self.answered
        self.missed = 0
        self.missed_in_a_row = 0
        self._settings = settings
        self._supervised_since: float | None = None

    @property
    def title(self) -> str:
        """Name and node, as an operator finds the drive."""
        return f'{self.name} (node {self.axis.node_id})'

    def snapshot(self, target: float | None, now: float) -> AxisSnapshot:
        """Return what was received, with the target [m] that is commanded meanwhile."""
        age = self.heartbeat_time and now - self.heartbeat_time
        is_silent = age is not None and (
            age > self._settings.heartbeat_timeout
            or self.missed_in_a_row >= self._settings.max_missed_cycles)
        return AxisSnapshot(
            self.name, self.axis.node_id, self._values.get(STATUSWORD), *self.measured,
            self._values.get(INPUTS), self.encoder.homed, self.error_code, age, self.missed,
            self.serial_number, target, is_silent)

    def lose(self) -> None:
        """Note where the carriage is, because the bus is lost: the drive may restart meanwhile."""
        self.encoder.lose(self._settings.heartbeat_timeout, self.measured.velocity or 0.0)
        self.nmt_state = None

    def recover(self, boots_operational: bool) -> None:
        """
        Forget what was received before the bus was gone; keep the home position if it is proven.

        A drive that has restarted meanwhile counts from another zero, and its objects do not show
        it where it stores them. It is no longer operational though, since nobody has started it,
        unless it boots so; and it is seldom where it was.
        """
        if self.nmt_state != NmtState.OPERATIONAL or boots_operational:
            self.encoder.distrust()
        self.encoder.forget()
        self._values.clear()
        self.nmt_state = self.heartbeat_time = None

    def begin_supervision(self, now: float) -> None:
        """From now on silence is a fault."""
        self._supervised_since = now
        self.has_restarted = False
        self.missed_in_a_row = 0
        self._answered_before = self.answered
        self.silent_tpdos = {one.name for one in self.tpdos}

    def end_supervision(self) -> None:
        """From now on silence, a boot-up and a fault mean nothing."""
        self._supervised_since = None

    def encode(self, command: AxisCommand, target: int) -> list[tuple[int, bytes]]:
        """Return COB-ID and data of the RPDOs that carry a command and a target [counts]."""
        if self.has_restarted:
            return []
        values = {0x6040: command.controlword, 0x6060: command.mode, 0x607A: target}
        return [(cob_id, pack(*[values[index] for index in indices]))
                for cob_id, pack, indices in self._rpdos]

    def receive_tpdo(
        self, tpdo: Pdo, data: bytes, time: float, sync_time: float
    ) -> Cause | None:
        """Receive process data; return why all must stop because of them, if they must."""
        self._values.update(zip(tpdo.indices, tpdo.codec.unpack(data), strict=True))
        self.silent_tpdos.discard(tpdo.name)
        if time >= sync_time - SYNC_TOLERANCE:
            if sync_time != self._sync_time:
                self._sync_time, self._unanswered = sync_time, set(self._answers)
            self._unanswered.discard(tpdo.name)
            if not self._unanswered:
                self.answered = sync_time
        cause = self._receive_error_code() if ERROR_CODE in tpdo.indices else None
        return self._receive_position(time) or cause if POSITION in tpdo.indices else cause

    def _receive_position(self, time: float) -> Cause | None:
        """Return why all must stop because of a position, if they must."""
        encoder = self.encoder
        is_first = encoder.counts is None
        lost = encoder.receive(self._values[POSITION], time)
        if not (self._sends_velocity or is_first):
            self._values[VELOCITY] = round(encoder.speed * self.axis.velocity_units_per_count)
        return lost and self._supervised(
            f'{self.title}{lost.message}', remedy=lost.remedy, home_again=True, cut_power=True)

    def _receive_error_code(self) -> Cause | None:
        """Return why all must stop if a drive in fault says by 603F alone what it is."""
        code = self._values[ERROR_CODE]
        is_in_fault = self._values.get(STATUSWORD, 0) & Status.FAULT
        if not is_in_fault or is_error_reset(code) or code == self.error_code:
            return None
        return self._receive_error(code)

    def receive_emergency(self, frame: Frame) -> Cause | None:
        """Receive an emergency message; return why all must stop, None if an error is gone."""
        code = decode_emergency(frame.data).code
        if is_error_reset(code):
            self.error_code = 0
            return None
        return self._receive_error(code)

    def _receive_error(self, code: int) -> Cause | None:
        self.error_code = code
        meaning = fault(code)
        if meaning.home_again:
            self.encoder.distrust()
        return self._supervised(
            f'{self.title}: {describe(code)}', remedy=meaning.remedy,
            home_again=meaning.home_again, cut_power=meaning.reaction is Reaction.DISABLE_ALL)

    def receive_heartbeat(self, frame: Frame) -> Cause | None:
        """Receive a heartbeat or boot-up message; return why all must stop, if they must."""
        self.nmt_state = state = frame.data[0] & 0x7F
        self.heartbeat_time = frame.time
        if state == NmtState.INITIALISING:
            return self._boot()
        if state != NmtState.OPERATIONAL:
            return self._supervised(
                f'{self.title} is no longer operational (NMT state {state})',
                remedy='check the bus')
        return None

    def end_cycle(self) -> Feedback:
        """
        Return what the group's state machine needs; a drive that has sent nothing is in no state.

        Counts an answer that is missing at the end of the cycle; one that came after the end of
        the cycle before is late, not missing.

        """
        if self.answered != self._answered_before:
            self._answered_before, self.missed_in_a_row = self.answered, 0
        else:
            self.missed += 1
            self.missed_in_a_row += 1
        values = self._values
        self.measured = measured = Measured(*[
            None if raw is None else raw * unit
            for raw, unit in zip(
                map(values.get, MEASURED_OBJECTS), self.axis.si_per_unit, strict=True)])
        lag = self._settings.drive_lag * (measured.velocity or 0.0)
        error = measured.following_error
        self.tracking_error = 0.0 if error is None else error - lag
        mode = values.get(MODE, 0)
        return Feedback(
            values.get(STATUSWORD, 0), mode,
            measured.velocity is not None and abs(measured.velocity) < REST_SPEED,
            self.error_code, self.encoder.home_error() if mode == Mode.HOMING else 0.0,
            self.missed_in_a_row)

    def silence(self, now: float) -> Cause | None:
        """Return why all must stop because of what was not received, None if all was."""
        if self._supervised_since is None:
            return None
        bound = self._settings.max_missed_cycles
        if self.missed_in_a_row >= bound:
            return self._supervised(
                f'{self.title} did not answer {self.missed_in_a_row} cycles in a row, '
                f'bound {bound}', remedy=CONFIGURE_REMEDY, configure_again=True, is_silence=True)
        age = now - max(self.heartbeat_time or 0.0, self._supervised_since)
        if age > self._settings.heartbeat_timeout:
            return self._supervised(
                f'{self.title} sent no heartbeat for {1e3 * age:.0f} ms, '
                f'bound {1e3 * self._settings.heartbeat_timeout:.0f} ms',
                remedy=CONFIGURE_REMEDY, configure_again=True, is_silence=True)
        return None

    def _boot(self) -> Cause | None:
        self.boot_ups += 1
        self.encoder.distrust()
        self.has_restarted = self._supervised_since is not None
        return self._supervised(
            f'{self.title} has restarted by itself and has lost its position',
            remedy=CONFIGURE_REMEDY, configure_again=True, is_restart=True)

    def _supervised(self, message: str, **details) -> Cause | None:
        if self._supervised_since is None:
            return None
        return Cause(message, axis=self.name, **details)


class AxisMonitors(tuple[AxisMonitor, ...]):
    """What was received from the drives of one machine."""

    @property
    def unhomed(self) -> list[str]:
        """Names of the axes that must be homed."""
        return [one.name for one in self if not one.encoder.homed]

    @property
    def silent_tpdos(self) -> list[str]:
        """Process data that have not come yet since the cycle was started."""
        return [f'{name} of {one.title}' for one in self for name in sorted(one.silent_tpdos)]

    def positions(self) -> Triple:
        """
        Return where the carriages are [m].

        Raises
        ------
        DriveStateError
            A drive has not sent its position yet.

        """
        positions = tuple([one.measured.position for one in self])
        if None in positions:
            raise DriveStateError('not every drive has sent its position yet: try again')
        return positions

    def snapshots(
        self, targets: Triple | tuple[None, ...], now: float
    ) -> tuple[AxisSnapshot, ...]:
        """Return what was received, with the targets [m] that are commanded meanwhile."""
        return tuple([one.snapshot(target, now)
                      for one, target in zip(self, targets, strict=True)])

    def end_cycle(self) -> tuple[Feedback, ...]:
        """Return what each drive last sent, as `AxisMonitor.end_cycle` does."""
        return tuple([one.end_cycle() for one in self])

    def encode(
        self, commands: Iterable[AxisCommand], targets: Iterable[int]
    ) -> list[tuple[int, bytes]]:
        """Return COB-ID and data of all RPDOs that carry commands and targets [counts]."""
        return [frame for one, command, target in zip(self, commands, targets, strict=True)
                for frame in one.encode(command, target)]

    def silences(self, read_until: float) -> list[Cause]:
        """
        Return why to stop because drives are silent: one cause for the bus when all are.

        `read_until` is the time [s] up to which all received frames have been read: what still
        waits to be read may be the very answer that seems to be missing.
        """
        causes = [cause for one in self if (cause := one.silence(read_until)) is not None]
        if len(causes) == len(self):
            return [Cause(f'no drive answers any more: {causes[0].message}', BUS_REMEDY)]
        return causes
