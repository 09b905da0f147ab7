"""
What was received from one drive, how old it is, and what is wrong with it.

The receiver hands in frames; once a cycle the monitor says whether the drive is still
there. Times are on the monotonic clock [s]. What was never received is None.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from facade_manipulator.drives.canopen import (
    ConditionFrame,
    decode_emergency,
    describe,
    fault,
    is_error_reset,
    MotionFrame,
    NmtState,
    Pdo,
    pdo,
    PDO_MAP,
    Reaction,
    StatusFrame,
)
from facade_manipulator.drives.cia402 import (
    AxisCommand,
    AxisSettings,
    BUS_REMEDY,
    Cause,
    CONFIGURE_REMEDY,
    Feedback,
    METHODS_AT_PRESENT_POSITION,
    Mode,
    Status,
)
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import AxisSnapshot

SYNC_TOLERANCE = 0.001
HOME_TOLERANCE = 2  # counts, where the drive takes the present position as home
HOME_NOISE = 0.001  # m, where it looks for a switch or a stop
REST_SPEED = 0.002  # m/s, below which a carriage is at rest
JUMP_NOISE = 0.001  # m
JUMP_MARGIN = 2.0  # of the acceleration that a carriage is allowed
JUMP_JITTER = 0.5  # of the way since the last answer, for a SYNC that came early or late
STATUSWORD, MODE, POSITION = pdo.TPDO1.indices
VELOCITY, FOLLOWING_ERROR = pdo.TPDO2.indices
ERROR_CODE, TORQUE, INPUTS = pdo.TPDO3.indices
_NOTHING_RECEIVED = StatusFrame(0, 0, 0)
_NO_MOTION, _NO_CONDITION = MotionFrame(None, None), ConditionFrame(None, None, None)


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
    silent_tpdos : set of str
        Which TPDOs have not come yet since supervision has begun.

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
            (one.cob_id(axis.node_id), one) for one in pdos if not one.is_transmitted)
        self._answers = frozenset(one.name for one in self.tpdos if one.carries(pdo.STATUS))
        self._unanswered = set(self._answers)
        self._values: dict[int, int] = {}
        self._sends_velocity = any(VELOCITY in one.indices for one in self.tpdos)
        self.status: StatusFrame | None = None
        self.motion: MotionFrame | None = None
        self.condition: ConditionFrame | None = None
        self.nmt_state: int | None = None
        self.heartbeat_time: float | None = None
        self.boot_ups = 0
        self.has_restarted = False  # since it was configured: it would not know what RPDOs mean
        self.error_code = 0
        self.serial_number: int | None = None
        self.homed = False
        self.is_fresh = False
        self.missed = 0
        self.missed_in_a_row = 0
        self._settings = settings
        self._period = settings.period
        self._home_counts = axis.to_counts(axis.home_position)
        self._home_tolerance = _home_tolerance(axis, settings.period)
        self._is_trusted = True
        # in the drive's own units, so that a cycle converts nothing
        counts_per_metre = abs(axis.counts_per_metre)
        self._rest_speed = counts_per_metre * axis.velocity_units_per_count * REST_SPEED
        self._least_jump = counts_per_metre * _jump_bound(axis, settings.period)
        self._supervised_since: float | None = None
        self._status_time = 0.0
        self._speed = 0.0  # counts/s, since the answer before the last
        self._last_counts = 0  # when the bus was lost
        self._farthest: float | None = None  # m, from there

    @property
    def title(self) -> str:
        """Name and node, as an operator finds the drive."""
        return f'{self.name} (node {self.axis.node_id})'

    @property
    def position(self) -> float | None:
        """Actual position [m]."""
        return self.axis.to_metres(self.status.position_counts) if self.status else None

    @property
    def tracking_error(self) -> float:
        """Following error beyond the lag that the drive is known to have [m]; 0 if unknown."""
        motion, axis = self.motion, self.axis
        if motion is None or motion.following_error_counts is None:
            return 0.0
        lag = self._settings.drive_lag * axis.speed_to_metres(motion.velocity or 0)
        return axis.to_metres(motion.following_error_counts) - lag

    def snapshot(self, target: float | None, now: float) -> AxisSnapshot:
        """Return what was received, with the target [m] that is commanded meanwhile."""
        axis, status = self.axis, self.status
        motion, condition = self.motion or _NO_MOTION, self.condition or _NO_CONDITION
        return AxisSnapshot(
            self.name, axis.node_id, status and status.statusword,
            status and axis.to_metres(status.position_counts),
            _converted(axis.speed_to_metres, motion.velocity),
            _converted(axis.to_force, condition.torque),
            _converted(axis.to_metres, motion.following_error_counts),
            condition.digital_inputs, self.homed, self.error_code,
            self.heartbeat_time and now - self.heartbeat_time, self.missed, self.serial_number,
            target, self._is_silent(now))

    def _is_silent(self, now: float) -> bool:
        """Return whether heartbeats or answers are missing from a drive that has sent some."""
        return self.heartbeat_time is not None and (
            now - self.heartbeat_time > self._settings.heartbeat_timeout
            or self.missed_in_a_row >= self._settings.max_missed_cycles)

    def lose(self) -> None:
        """Note where the carriage is, because the bus is lost: the drive may restart meanwhile."""
        if self.status is not None and self._farthest is None:
            speed, axis = abs(self.axis.to_metres(self._speed)), self.axis
            stopping = self._settings.heartbeat_timeout + self._settings.period
            way = speed * stopping + speed ** 2 / (2.0 * axis.stop_deceleration) + JUMP_NOISE
            self._last_counts, self._farthest = self.status.position_counts, way
        self.nmt_state = None

    def recover(self, boots_operational: bool) -> None:
        """
        Forget what was received before the bus was gone; keep the home position if it is proven.

        A drive that has restarted meanwhile counts from another zero, and its objects do not show
        it where it stores them. It is no longer operational though, since nobody has started it,
        unless it boots so; and it is seldom where it was.
        """
        if self.nmt_state != NmtState.OPERATIONAL or boots_operational:
            self.distrust()
        self.status = self.motion = self.condition = None
        self._values.clear()
        self.nmt_state = self.heartbeat_time = None
        self.is_fresh = False

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

    def begin_supervision(self, now: float) -> None:
        """From now on silence is a fault."""
        self._supervised_since = now
        self.has_restarted = False
        self.missed_in_a_row = 0
        self.silent_tpdos = {one.name for one in self.tpdos}

    def end_supervision(self) -> None:
        """From now on silence, a boot-up and a fault mean nothing."""
        self._supervised_since = None

    def encode(self, command: AxisCommand, target: int) -> list[tuple[int, bytes]]:
        """Return COB-ID and data of the RPDOs that carry a command and a target [counts]."""
        if self.has_restarted:
            return []
        values = {0x6040: command.controlword, 0x6060: command.mode, 0x607A: target}
        return [(cob_id, rpdo.encode(values)) for cob_id, rpdo in self._rpdos]

    def receive_tpdo(
        self, tpdo: Pdo, data: bytes, time: float, sync_time: float
    ) -> Cause | None:
        """Receive process data; return why all must stop because of them, if they must."""
        values = self._values
        values.update(zip(tpdo.indices, tpdo.unpack(data), strict=True))
        self.silent_tpdos.discard(tpdo.name)
        if tpdo.carries(pdo.MOTION):
            self.motion = MotionFrame(values.get(VELOCITY), values.get(FOLLOWING_ERROR))
        cause = self._receive_condition() if tpdo.carries(pdo.CONDITION) else None
        if tpdo.name not in self._answers:
            return cause
        if time >= sync_time - SYNC_TOLERANCE:
            self._unanswered.discard(tpdo.name)
        self.is_fresh = not self._unanswered
        if len(values.keys() & pdo.STATUS) < len(pdo.STATUS):
            return cause
        before, self.status = self.status, StatusFrame(
            values[STATUSWORD], values[MODE], values[POSITION])
        if POSITION not in tpdo.indices:
            return cause
        return self._receive_position(before, time) or cause

    def _receive_position(self, before: StatusFrame | None, time: float) -> Cause | None:
        """
        Return why all must stop because of a position, if they must.

        The speed of a homed carriage must not seem to have changed faster than it can.

        """
        elapsed, self._status_time = time - self._status_time, time
        if before is None:
            self._speed = 0.0
            return self._compare_with_last()
        elapsed = max(elapsed, self._period)
        counts = self.status.position_counts - before.position_counts
        expected, self._speed = self._speed * elapsed, counts / elapsed
        if not self._sends_velocity:
            self._values[VELOCITY] = round(self._speed * self.axis.velocity_units_per_count)
            self.motion = MotionFrame(self._values[VELOCITY], self._values.get(FOLLOWING_ERROR))
        if not self.homed or abs(counts - expected) <= self._least_jump:
            return None
        jump = abs(self.axis.to_metres(counts - expected))
        bound = _jump_bound(self.axis, elapsed) + JUMP_JITTER * abs(self.axis.to_metres(expected))
        if jump <= bound:
            return None
        self.distrust()
        return self._supervised(
            f'{self.title}: the position has jumped by {jump:.4g} m, bound {bound:.4g} m: it can '
            'no longer be trusted', remedy='check the encoder and its cable', home_again=True,
            cut_power=True)

    def _compare_with_last(self) -> Cause | None:
        """Return why all must stop because of the first position after a lost bus."""
        farthest, self._farthest = self._farthest, None
        if farthest is None or not self.homed:
            return None
        moved = abs(self.axis.to_metres(self.status.position_counts - self._last_counts))
        if moved <= farthest:
            return None
        self.distrust()
        return self._supervised(
            f'{self.title} is {moved:.4g} m from where it was when the bus was lost, bound '
            f'{farthest:.4g} m: its position can no longer be trusted',
            remedy='look whether it was pushed', home_again=True, cut_power=True)

    def _receive_condition(self) -> Cause | None:
        """
        Receive error code, torque and inputs.

        Returns why all must stop if a drive in fault says by 603F alone what it is.

        """
        values = self._values
        self.condition = ConditionFrame(
            values.get(ERROR_CODE), values.get(TORQUE), values.get(INPUTS))
        code = self.condition.error_code or 0
        is_in_fault = self.status is not None and self.status.statusword & Status.FAULT
        if not is_in_fault or is_error_reset(code) or code == self.error_code:
            return None
        return self._receive_error(code)

    def receive_emergency(self, data: bytes) -> Cause | None:
        """Receive an emergency message; return why all must stop, None if an error is gone."""
        code = decode_emergency(data).code
        if is_error_reset(code):
            self.error_code = 0
            return None
        return self._receive_error(code)

    def _receive_error(self, code: int) -> Cause | None:
        self.error_code = code
        meaning = fault(code)
        if meaning.home_again:
            self.distrust()
        return self._supervised(
            f'{self.title}: {describe(code)}', remedy=meaning.remedy,
            home_again=meaning.home_again, cut_power=meaning.reaction is Reaction.DISABLE_ALL)

    def receive_heartbeat(self, data: bytes, time: float) -> Cause | None:
        """Receive a heartbeat or boot-up message; return why all must stop, if they must."""
        state = data[0] & 0x7F
        self.nmt_state = state
        self.heartbeat_time = time
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

        Counts an answer that is missing at the end of the cycle; the next one must be fresh.

        """
        if self.is_fresh:
            self.missed_in_a_row = 0
        else:
            self.missed += 1
            self.missed_in_a_row += 1
        self.is_fresh = False
        self._unanswered = set(self._answers)
        status = self.status or _NOTHING_RECEIVED
        velocity = self.motion.velocity if self.motion else None
        at_rest = velocity is not None and abs(velocity) < self._rest_speed
        home_error = self._home_error(status) if status.mode == Mode.HOMING else 0.0
        return Feedback(
            status.statusword, status.mode, at_rest, self.error_code, home_error,
            self.missed_in_a_row)

    def _home_error(self, status: StatusFrame) -> float:
        """Return how far the carriage is from its home position [m], 0 if it is there."""
        counts = status.position_counts - self._home_counts
        return self.axis.to_metres(counts) if abs(counts) > self._home_tolerance else 0.0

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


def silences(monitors: Sequence[AxisMonitor], read_until: float) -> list[Cause]:
    """
    Return why to stop because drives are silent: one cause for the bus when all are.

    `read_until` is the time [s] up to which all received frames have been read: what still
    waits to be read may be the very answer that seems to be missing.
    """
    causes = [cause for one in monitors if (cause := one.silence(read_until)) is not None]
    if len(causes) == len(monitors):
        return [Cause(f'no drive answers any more: {causes[0].message}', BUS_REMEDY)]
    return causes


def _converted(convert: Callable[[int], float], value: int | None) -> float | None:
    """Return a value in SI units, None for one that the drive does not send."""
    return None if value is None else convert(value)


def _jump_bound(axis: AxisSettings, elapsed: float) -> float:
    """Return how far from where its speed leads a carriage may be after a time [m]."""
    acceleration = max(axis.max_acceleration, axis.stop_deceleration)
    return JUMP_NOISE + JUMP_MARGIN * acceleration * elapsed ** 2


def _home_tolerance(axis: AxisSettings, period: float) -> float:
    """Return how exactly a carriage that is homed stands at its home position [counts]."""
    if axis.homing_method in METHODS_AT_PRESENT_POSITION:
        return HOME_TOLERANCE
    speed = axis.homing_zero_speed
    braking = speed * period + speed ** 2 / (2.0 * axis.homing_acceleration)
    return abs(axis.to_counts(HOME_NOISE + braking))
