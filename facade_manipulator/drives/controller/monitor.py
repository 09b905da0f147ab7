"""
What was received from one drive, how old it is, and what is wrong with it.

The receiver hands in frames; once a cycle the monitor says whether the drive is still
there. A position is that of the carriage while the drive is homed and it has been steady since.
Times are on the monotonic clock [s]. What was never received is None.
"""

from __future__ import annotations

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
)
from facade_manipulator.drives.cia402 import (
    AxisCommand,
    AxisSettings,
    Cause,
    CONFIGURE_REMEDY,
    Feedback,
    home_error,
    Measured,
    Mode,
    Status,
)
from facade_manipulator.drives.controller.bus_load import transmission_type
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import AxisSnapshot

SYNC_TOLERANCE = 0.001
EVERY_SYNC = 1
REST_SPEED = 0.002  # m/s, below which a carriage is at rest
JUMP_NOISE = 0.001  # m
JUMP_MARGIN = 2.0  # of the acceleration that a carriage is allowed
JUMP_JITTER = 0.5  # of the way since the last answer, for a SYNC that came early or late
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
    counts : int or None
        The newest position, None before the first.
    homed : bool
        Whether it is that of the carriage.
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
        pdos: tuple[Pdo, ...] = pdo.PDO_MAP,
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
        self.counts: int | None = None
        self.homed = False
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
        self._is_trusted = True
        self._speed = 0.0  # mean of the time between the last two positions [counts/s]
        self._time = 0.0  # of the last position
        self._period = self._elapsed = settings.period
        self._last_counts = 0  # when the bus was lost
        self._farthest: float | None = None  # m, from there

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
            self._values.get(INPUTS), self.homed, self.error_code, age, self.missed,
            self.serial_number, target, is_silent)

    # --- whether the position is the carriage's

    def begin_homing(self) -> None:
        """From now on the position is unknown, and what is said of it counts again."""
        self.homed, self._is_trusted = False, True

    def end_homing(self, homed: bool) -> None:
        """Note whether the axis is homed; it is not if its position has been lost meanwhile."""
        self.homed = homed and self._is_trusted
        self._speed = 0.0  # the step to the home position was none of the carriage

    def distrust(self) -> None:
        """Note that the position is lost, until the axis is homed again."""
        self.homed = self._is_trusted = False

    def lose(self) -> None:
        """
        Note where the carriage is, because the bus is lost: the drive may restart meanwhile.

        The drive goes on until it misses the master's heartbeat, then brakes. Positions that came
        close together show no speed; the drive's own velocity does.
        """
        self.nmt_state = None
        if self.counts is not None and self._farthest is None:
            axis = self.axis
            speed = max(abs(self.measured.velocity or 0.0), abs(axis.to_metres(self._speed)))
            silence = self._settings.heartbeat_timeout + self._period
            braking = speed ** 2 / (2.0 * axis.stop_deceleration)
            self._farthest = speed * silence + braking + JUMP_NOISE
            self._last_counts = self.counts

    def recover(self, boots_operational: bool) -> None:
        """
        Forget what was received before the bus was gone; keep the home position if it is proven.

        A drive that has restarted meanwhile counts from another zero, and its objects do not show
        it where it stores them. It is no longer operational though, since nobody has started it,
        unless it boots so; and it is seldom where it was.
        """
        if self.nmt_state != NmtState.OPERATIONAL or boots_operational:
            self.distrust()
        self.counts = None  # the next is compared with where the bus was lost, not with the last
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
        """
        Return why all must stop because of a position, if they must.

        The speed of a homed carriage must not seem to have changed faster than it can, and after
        a silence it must be where it could have come to rest. Else it is no longer trusted.
        """
        before, self.counts = self.counts, self._values[POSITION]
        elapsed, self._time = max(time - self._time, self._period), time
        if before is None:
            self._speed, self._elapsed = 0.0, self._period
            return self._compare_with_last()
        earlier, self._elapsed = self._elapsed, elapsed
        expected, self._speed = self._speed * elapsed, (self.counts - before) / elapsed
        if not self._sends_velocity:
            self._values[VELOCITY] = round(self._speed * self.axis.velocity_units_per_count)
        if not self.homed:
            return None
        acceleration = max(self.axis.max_acceleration, self.axis.stop_deceleration)
        metres = self.axis.si_per_unit.position
        jump = abs(metres * (self.counts - before - expected))
        bound = (  # both speeds are the means of their times
            JUMP_NOISE + JUMP_MARGIN * acceleration * 0.5 * (earlier + elapsed) * elapsed
            + JUMP_JITTER * abs(metres * expected))
        if jump <= bound:
            return None
        return self._lose_position(
            f': the position has jumped by {jump:.4g} m, bound {bound:.4g} m: it can no longer be '
            'trusted', 'check the encoder and its cable')

    def _compare_with_last(self) -> Cause | None:
        farthest, self._farthest = self._farthest, None
        if farthest is None or not self.homed:
            return None
        moved = abs(self.axis.to_metres(self.counts - self._last_counts))
        if moved <= farthest:
            return None
        return self._lose_position(
            f' is {moved:.4g} m from where it was when the bus was lost, bound {farthest:.4g} m: '
            'its position can no longer be trusted', 'look whether it was pushed')

    def _lose_position(self, message: str, remedy: str) -> Cause | None:
        self.distrust()
        return self._supervised(
            f'{self.title}{message}', remedy=remedy, home_again=True, cut_power=True)

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
        if meaning.loses_position:
            self.distrust()
        return self._supervised(
            f'{self.title}: {describe(code)}', remedy=meaning.remedy,
            home_again=meaning.loses_position, cut_power=meaning.loses_position)

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
            self.error_code, home_error(self.axis, self.counts or 0, self._period)
            if mode == Mode.HOMING else 0.0, self.missed_in_a_row)

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
        self.distrust()
        self.has_restarted = self._supervised_since is not None
        return self._supervised(
            f'{self.title} has restarted by itself and has lost its position',
            remedy=CONFIGURE_REMEDY, configure_again=True, is_restart=True)

    def _supervised(self, message: str, **details) -> Cause | None:
        if self._supervised_since is None:
            return None
        return Cause(message, axis=self.name, **details)
