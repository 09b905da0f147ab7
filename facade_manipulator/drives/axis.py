"""
Axis: one carriage with its drive.

The `Axis` of a drive contains all that this driver knows of the drive, and all that it sends to
the drive. The parts of an `Axis` are:

    received    feedback (process data), encoder (position), answers (to SYNC), node (NMT state),
                silence (missing frames), errors
    sent        output (command and target), sdo (objects)
    both        homing

The exchange passes the frames of a drive to its axis. Each frame, except an answer through SDO,
may be the cause of a stop. Times are on the monotonic clock [s].
"""

from __future__ import annotations

from collections.abc import Sequence

from facade_manipulator.canopen import indices
from facade_manipulator.canopen.bus import CanBus, Frame
from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.pdo import Pdo
from facade_manipulator.drives.answers import Answers
from facade_manipulator.drives.axis_settings import AxisSettings, check_axes
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.drive_errors import DriveErrors
from facade_manipulator.drives.encoder import Encoder
from facade_manipulator.drives.feedback import Feedback, MEASURED_OBJECTS
from facade_manipulator.drives.homing import Homing
from facade_manipulator.drives.node_monitor import NodeMonitor
from facade_manipulator.drives.output import Output
from facade_manipulator.drives.profile import DriveProfile, load_profile
from facade_manipulator.drives.sdo_access import SdoAccess
from facade_manipulator.drives.silence import Silence
from facade_manipulator.drives.snapshot import AxisSnapshot, Cause
from facade_manipulator.drives.states import (
    decode_state,
    Power,
    Status,
    UNPOWERED_STATES,
)
from facade_manipulator.errors import DriveStateError
from facade_manipulator.kinematics.geometry import AXIS_NAMES, PerCarriage


class Axis:
    """
    One axis. The controller replaces this object when it closes the bus.

    The name of the axis is shown to the operator. `settings` contain the units and the identity of
    the drive's profile. Raises a ParameterError if the profile contradicts the settings.
    """

    ENCODER_REMEDY = (
        'check whether the carriage was pushed, and check the encoder and its cable'
    )

    def __init__(
        self,
        name: str,
        settings: AxisSettings,
        profile: DriveProfile,
        controller: ControllerSettings,
    ) -> None:
        self.name = name
        self.settings = settings
        self.profile = profile
        self.feedback = Feedback(settings, profile, controller.period)
        self.encoder = Encoder(settings, controller.period)
        self.answers = Answers(profile.tpdos, controller.rate)
        self.node = NodeMonitor(name, self.title, self.encoder)
        self.silence = Silence(name, self.title, self.answers, self.node, controller)
        self.errors = DriveErrors(name, self.title, profile.errors, self.encoder)
        self.homing: Homing | None = None  #: present or last homing; None before it
        self.output = Output(settings.node_id, profile)
        self.sdo = SdoAccess(self.title, settings, profile, self.node, controller)

    @property
    def title(self) -> str:
        """Return name and node id for the operator."""
        return f'{self.name} (node {self.settings.node_id})'

    def connect(self, bus: CanBus, clock: Clock, serials: dict[int, str]) -> None:
        """Use the objects of the drive on a bus; `serials` maps serial numbers to axis names."""
        self.sdo.connect(bus, self.name, clock, serials)

    # --- events of the drive

    def expect_boot_up(self) -> None:
        """Prepare for a reset: clear all errors and the number of boot-up messages."""
        self.node.count_boot_ups()
        self.errors.forget()

    def expect(self, nmt_state: str) -> None:
        """Record the NMT state that this master commands; excuse answers until the next."""
        if nmt_state != self.node.commanded:
            self.silence.excuse_answers()
        self.node.expect(nmt_state)

    def begin_supervision(self, now: float) -> None:
        """From a time [s], treat silence and restarts as faults; forget earlier answers."""
        self.silence.begin(now)
        self.node.count_boot_ups()
        self.answers.restart()

    def begin_homing(self, period: float) -> None:
        """Begin homing; `period` is the period of a cycle [s]."""
        needs_bit_10 = not self.profile.quirks.homes_without_bit_10
        self.homing = Homing(self.name, self.settings, period, needs_bit_10)
        self.encoder.begin_homing()

    @property
    def has_found_home(self) -> bool:
        """Return whether the drive has found home in the current or last homing."""
        return self.homing is not None and self.homing.is_homed

    def watch_home(self) -> None:
        """Check a drive that has found home for slip while other axes are homing."""
        if self.has_found_home:
            self.encoder.find_home()

    def end_homing(self) -> None:
        """Record whether the axis is homed, when its position is settled."""
        self.encoder.end_homing(self.has_found_home)

    def cancel_homing(self) -> None:
        """Record that the axis is not homed, and stop checking its position."""
        self.encoder.end_homing(False)

    def lose(self) -> None:
        """Mark the position as lost after a silence, because the drive may have restarted."""
        self.silence.lose()
        self.encoder.distrust()

    # --- frames of the drive

    def receive_tpdo(
        self, tpdo: Pdo, data: bytes, time: float, sync_time: float
    ) -> Cause | None:
        """Receive process data; return the cause of a stop, if any."""
        newest = self.feedback.newest
        raw = newest.receive(tpdo, data)
        self.answers.receive(tpdo.name, time, sync_time)

        cause = None
        is_in_fault = newest.get(indices.STATUSWORD, 0) & Status.FAULT
        if indices.ERROR_CODE in tpdo.indices and is_in_fault:
            # a drive may report its error only by 603Fh
            cause = self.errors.receive_code(newest.get(indices.ERROR_CODE))
        if indices.ACTUAL_POSITION not in tpdo.indices:
            return cause

        counts = raw[tpdo.indices.index(indices.ACTUAL_POSITION)]
        reason = self.encoder.receive(counts, time)
        newest.receive_speed(self.encoder.speed)
        if not reason:
            return cause
        return Cause(
            f'{self.title}: the position {reason}',
            self.ENCODER_REMEDY,
            self.name,
            cut_power=True,
        )

    def receive_emergency(self, frame: Frame) -> Cause | None:
        """Receive an emergency message; return the cause of a stop, if any."""
        return self.errors.receive_emergency(frame)

    def receive_heartbeat(self, frame: Frame) -> Cause | None:
        """Receive a heartbeat or boot-up message; return the cause of a stop, if any."""
        state = decode_state(self.feedback.statusword)
        return self.node.receive_heartbeat(frame, state not in UNPOWERED_STATES)

    # --- the cycle

    def end_cycle(self, sync_time: float, may_rest: bool) -> None:
        """
        Update answers and feedback at the end of the cycle that began with a SYNC.

        `may_rest` is False only while the targets of a ramp to rest still move, because reversing
        carriages rest for a moment.
        """
        self.answers.end_cycle(sync_time)
        self.feedback.end_cycle(self.encoder, may_rest)

    def frames(self) -> list[tuple[int, bytes]]:
        """Return COB-ID and data of each frame for the drive, or no frame after a restart."""
        if self.node.boot_ups:
            return []
        return self.output.frames(self.output.command)

    # --- values for the operator

    def snapshot(self, target: float | None, now: float) -> AxisSnapshot:
        """Return the newest values and the commanded target [m] at a time [s]."""
        newest = self.feedback.newest
        position, velocity, force, following_error = map(newest.get, MEASURED_OBJECTS)
        heartbeat_time = self.node.heartbeat_time
        age = None if heartbeat_time is None else now - heartbeat_time
        return AxisSnapshot(
            self.name,
            self.settings.node_id,
            newest.get(indices.STATUSWORD),
            position,
            velocity,
            force,
            following_error,
            newest.get(indices.DIGITAL_INPUTS),
            self.encoder.homed,
            self.errors.code,
            age,
            self.answers.missed,
            self.sdo.serial_number,
            target,
            age is not None and self.silence.cause(now) is not None,
            self.errors.message,
            self.errors.warning,
        )

    def has_confirmed_off(self, now: float) -> bool:
        """Return whether the drive confirms, at a time [s], that its motor has no power."""
        return self.snapshot(None, now).power is Power.CONFIRMED_OFF


def make_axes(
    settings: tuple[AxisSettings, ...], controller: ControllerSettings
) -> tuple[Axis, ...]:
    """
    Return the axes q1, q2 and q3 with the profiles of their drives.

    Raises a ParameterError if settings contradict each other or a drive profile is missing.
    """
    check_axes(settings)
    axes = []
    for name, one in zip(AXIS_NAMES, settings, strict=True):
        profile = load_profile(one.profile)
        axes.append(Axis(name, profile.applied(one), profile, controller))
    return tuple(axes)


def positions_of(axes: Sequence[Axis]) -> PerCarriage:
    """Return the carriage positions [m]; raise a DriveStateError if a position is unknown."""
    q1, q2, q3 = [axis.feedback.position for axis in axes]
    if q1 is None or q2 is None or q3 is None:
        raise DriveStateError(
            'not every drive has sent its position yet; next: try again'
        )
    return q1, q2, q3
