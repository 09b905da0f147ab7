"""
A simulated CiA 402 drive on CANopen: frames and time in, frames out; no thread, no clock.

It is as strict as a real drive and as unforgiving: it follows its objects to the letter, latches
at the SYNC, watches the heartbeat of its master, and trips.

References
----------
CiA 301 and IEC 61800-7-201 (CiA 402-2).

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any, NamedTuple

from facade_manipulator.drives import pdo
from facade_manipulator.drives.cia402 import State, Status
from facade_manipulator.drives.emergency import Emergency, encode_emergency
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.simulated_axis import SAFE_TORQUE_OFF, SimulatedAxis
from facade_manipulator.drives.simulated_faults import Frame, FrameFilter, FrameLoss
from facade_manipulator.drives.simulated_motor import SimulatedMotor, SimulationSettings
from facade_manipulator.drives.simulated_network import (
    ErrorHistory,
    HeartbeatConsumer,
    HeartbeatProducer,
    NMT_TRANSITIONS,
    NmtCommand,
    NmtState,
)
from facade_manipulator.drives.simulated_objects import (
    COMMUNICATION_OBJECTS,
    ObjectServer,
    ObjectStore,
)
from facade_manipulator.drives.simulated_pdo import ProcessData
from facade_manipulator.drives.units import AxisScale
from facade_manipulator.errors import ParameterError

HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT = 0x8210
POSITION_LOST = 0x7380

_MOTION_PERIOD = 0.02  # s: how often a drive that moves wants to be called without a SYNC

# what an error does, by mask and code: most cut the power, these do not
_CONNECTION_ERRORS = ((0xFF00, 0x8100), (0xFF00, 0x8200))
_RAMP_ERRORS = ((0xFF00, 0x8600), (0xFFF8, 0x8A80))


class Identity(NamedTuple):
    """The identity object 1018."""

    vendor_id: int = 0
    product_code: int = 0
    revision_number: int = 0
    serial_number: int = 0


class SimulatedDrive:
    """
    One drive.

    Parameters
    ----------
    node_id : int
        Its CANopen node, 1 to 127.
    profile : DriveProfile
        Drive type: object dictionary, homing methods, quirks, velocity unit.
    scale : AxisScale
        Motor, gear and screw that it drives; the velocity unit is the profile's.
    identity : Identity
        What 1018 says.
    settings : SimulationSettings
        Rail, load, servo.

    Raises
    ------
    ParameterError
        The node id is not one.

    Attributes
    ----------
    motor : SimulatedMotor
        The mechanics: ``carriage_position`` in m is where the carriage really is;
        ``external_force`` and ``lag`` may be set.
    axis : SimulatedAxis
        State machine and motion.
    objects : ObjectStore
        The object dictionary.
    nmt_state : NmtState
        State of the node.
    is_silent, is_deaf : bool
        Fault injection: it sends nothing; it hears nothing.

    """

    def __init__(
        self, node_id: int, profile: DriveProfile, scale: AxisScale | None = None,
        identity: Identity | None = None, settings: SimulationSettings | None = None,
    ) -> None:
        if not 1 <= node_id <= 127:
            raise ParameterError(f'node id = {node_id} is not from 1 to 127')
        self.node_id = node_id
        self._settings = settings or SimulationSettings()
        self._identity = identity or Identity()
        self._scale = replace(scale or AxisScale(), velocity_unit=profile.velocity_unit)
        self._quirks = profile.quirks
        self._outbox: list[Frame] = []
        self._now = 0.0
        self.is_silent = self.is_deaf = False
        self._sending, self._receiving = FrameFilter(), FrameFilter()
        self._build(profile)
        self.reboot()

    def _build(self, profile: DriveProfile) -> None:
        settings = self._settings
        self.objects = ObjectStore(profile.eds, self.node_id, settings.missing_objects)
        self.motor = SimulatedMotor(settings, self._scale)
        self.errors = ErrorHistory(self.objects)
        self.axis = SimulatedAxis(
            self.objects, self.motor, profile, self._scale, self._report_motion)
        self._control = self.objects.writers[0x6040, 0]
        self.objects.writers.update({
            (0x1005, 0): self._forget_routes,
            (0x1016, 1): self._watch_master,
            (0x1017, 0): self._restart_heartbeat,
            (0x6040, 0): self._take_controlword,
        })
        self.objects.readers[0x6041, 0] = self._statusword
        self._sdo = ObjectServer(self.node_id, self.objects, self)
        self._pdo = ProcessData(
            self.objects, self.send_message, self._report_short_frame,
            event_driven=not profile.quirks.pdo_only_on_sync)
        self._producer = HeartbeatProducer(self.objects)
        self._consumer = HeartbeatConsumer(self.objects)

    # --- frames and time

    def receive(self, cob_id: int, data: bytes, now: float) -> list[Frame]:
        """
        Take a frame.

        Parameters
        ----------
        cob_id : int
            Its eleven-bit identifier.
        data : bytes
            Its data bytes.
        now : float
            Time in s, of a clock that does not go back.

        Returns
        -------
        frames : list of (int, bytes)
            What the drive sends.

        """
        if cob_id not in self._routes and self._receiving.deadline > now:
            return []
        self._now = max(now, self._now)
        arrived = [] if self.is_deaf else self._receiving.carry([(cob_id, data)], now)
        for frame in arrived:
            self._dispatch(*frame)
        return self.advance(now)

    def advance(self, now: float) -> list[Frame]:
        """Let time pass; return what the drive sends: boot-up, heartbeat, emergencies, TPDOs."""
        self._now = now = max(now, self._now)
        self._arrive_late(now)
        if now >= self._boot_at:
            self._boot()
        self.axis.advance(now)
        if self._consumer.is_overdue(now):
            self.inject_fault(HEARTBEAT_LOST)
        if self._producer.is_due(now):
            self.send_message(pdo.heartbeat_cob_id(self.node_id), bytes([self.nmt_state]))
        if self.nmt_state is NmtState.OPERATIONAL:
            self._pdo.poll(now)
        return self._flush(now)

    @property
    def deadline(self) -> float:
        """When `advance` must be called at the latest, if no frame comes before."""
        moving = self._now + _MOTION_PERIOD if self.axis.is_moving else math.inf
        return min(self._boot_at, self._producer.deadline, self._consumer.deadline, moving,
                   self._pdo.deadline, self._sending.deadline, self._receiving.deadline)

    def _arrive_late(self, now: float) -> None:
        if self._receiving.deadline <= now:
            for frame in self._receiving.carry([], now):
                self._dispatch(*frame)

    def _flush(self, now: float) -> list[Frame]:
        frames, self._outbox = self._outbox, []
        return [] if self.is_silent else self._sending.carry(frames, now)

    def send_message(self, cob_id: int, data: bytes) -> None:
        """Put a frame into the outbox."""
        self._outbox.append((cob_id, bytes(data)))

    def _dispatch(self, cob_id: int, data: bytes) -> None:
        route = self._routes.get(cob_id)
        if route is not None and self._boot_at == math.inf:
            self.axis.advance(self._now)
            route(cob_id, data)

    @property
    def _routes(self) -> dict[int, Callable[[int, bytes], None]]:
        if self._known_routes is None:
            self._known_routes = self._make_routes()
        return self._known_routes

    def _make_routes(self) -> dict[int, Callable[[int, bytes], None]]:
        routes: dict[int, Callable[[int, bytes], None]] = {}
        if self.nmt_state is NmtState.OPERATIONAL:
            routes.update(dict.fromkeys(self._pdo.cob_ids, self._on_rpdo))
            routes[self.objects.values[0x1005, 0] & 0x7FF] = self._on_sync
        if self.nmt_state is not NmtState.STOPPED:
            routes[pdo.sdo_request_cob_id(self.node_id)] = self._on_sdo
        if self._consumer.cob_id is not None:
            routes[self._consumer.cob_id] = self._on_heartbeat
        routes[pdo.NMT_COB_ID] = self._on_nmt
        return routes

    def _forget_routes(self, value: Any = None) -> None:
        self._known_routes = None

    def _on_sync(self, cob_id: int, data: bytes) -> None:
        if not data:
            self._pdo.answer_sync(self._now)
            self._pdo.latch()
            self.axis.latch()

    def _on_rpdo(self, cob_id: int, data: bytes) -> None:
        if self._pdo.receive(cob_id, data):
            self.axis.latch()

    def _on_sdo(self, cob_id: int, data: bytes) -> None:
        self._sdo.request(data)
        self._forget_routes()  # it may have written a COB-ID

    def _on_heartbeat(self, cob_id: int, data: bytes) -> None:
        if len(data) == 1 and self._consumer.hear(self._now):
            self.errors.discard(HEARTBEAT_LOST)
            self._announce()

    # --- network management

    def _on_nmt(self, cob_id: int, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.node_id):
            return
        if data[0] == NmtCommand.RESET_NODE:
            self.reboot()
        elif data[0] == NmtCommand.RESET_COMMUNICATION:
            self._reset_communication()
        elif data[0] in NMT_TRANSITIONS:
            self._enter_nmt(NMT_TRANSITIONS[NmtCommand(data[0])])

    def _enter_nmt(self, state: NmtState) -> None:
        if state is NmtState.STOPPED:
            self._lose_connection()
        if state is not self.nmt_state:
            self._pdo.forget()
        self.nmt_state = state
        self._forget_routes()

    def _reset_communication(self) -> None:
        self._lose_connection()
        self.objects.reset(COMMUNICATION_OBJECTS)
        self._restart()

    def reboot(self) -> None:
        """Switch the power off and on: fault injection, and the NMT command reset node."""
        self.objects.reset()
        self.errors.forget()
        self.axis.reset()
        self.objects.values[0x6076, 0] = round(self._scale.rated_torque * 1e6)
        self._restart()

    def _restart(self) -> None:
        for subindex, value in enumerate(self._identity, start=1):
            self.objects.values[0x1018, subindex] = value
        self._boot_at = self._now + self._settings.boot_time
        self._producer.deadline = math.inf
        self._consumer.forget()
        self._pdo.forget()
        self.nmt_state = NmtState.INITIALISING
        self._forget_routes()

    def _boot(self) -> None:
        self._boot_at = math.inf
        self.send_message(pdo.heartbeat_cob_id(self.node_id), bytes([NmtState.INITIALISING]))
        own_start = self._quirks.boots_operational
        self._enter_nmt(NmtState.OPERATIONAL if own_start else NmtState.PRE_OPERATIONAL)
        self._producer.restart(self._now)
        self.axis.boot()
        if self.axis.torque_off:
            self.open_safe_torque_off()

    def _watch_master(self, value: int) -> None:
        self._consumer.forget()
        self._forget_routes()

    def _restart_heartbeat(self, period: int) -> None:
        self._producer.deadline = self._now + period * 1e-3 if period else math.inf

    # --- controlword, statusword, errors

    def _statusword(self) -> int:
        remote = Status.REMOTE * (self.nmt_state is NmtState.OPERATIONAL)
        return self.axis.statusword | remote if self.axis.statusword else 0

    def _take_controlword(self, controlword: int) -> None:
        resets = self.axis.is_reset_edge(controlword)
        self._control(controlword)
        if resets:
            self._reset_errors()

    def _reset_errors(self) -> None:
        had_errors = self.errors.code != 0
        if self.errors.reset():
            self.axis.leave_fault()
        if had_errors:
            self._announce()

    def _announce(self) -> None:
        """Send the error that is present now, or that none is."""
        if self.nmt_state in (NmtState.OPERATIONAL, NmtState.PRE_OPERATIONAL):
            entry = self.objects.values[0x1014, 0]
            if not entry & pdo.DISABLED:
                message = Emergency(self.errors.code, self.errors.register)
                self.send_message(entry & 0x7FF, encode_emergency(message))

    def _lose_connection(self) -> None:
        if self.axis.lose_connection():
            self.axis.fail(keeps_power=True)

    def _report_motion(self, code: int) -> None:
        if code not in self.errors:
            self.inject_fault(code)

    def _report_short_frame(self) -> None:
        if PDO_TOO_SHORT not in self.errors:
            self.inject_fault(PDO_TOO_SHORT)

    # --- fault injection

    def inject_fault(self, code: int, persistent: bool = False) -> None:
        """
        Let an error happen, with the emergency message and the reaction that belong to it.

        Parameters
        ----------
        code : int
            Error code of CiA 301 or 402. 81xx and 82xx do what 6007 says, 86xx and 8A8x make
            the ramp of 605E, all others cut the power.
        persistent : bool
            Whether a fault reset is refused until `remove_cause`.

        """
        self.errors.add(code, persistent)
        if _is_among(code, _CONNECTION_ERRORS):
            self._lose_connection()
        else:
            self.axis.fail(keeps_power=_is_among(code, _RAMP_ERRORS))
        self._announce()

    def remove_cause(self) -> None:
        """Let persistent errors be ones that a fault reset clears; close safe torque off."""
        self.axis.torque_off = False
        self.errors.mend()

    def open_safe_torque_off(self) -> None:
        """Cut the power by the safety chain until `remove_cause`."""
        self.axis.torque_off = True
        self.inject_fault(SAFE_TORQUE_OFF, persistent=True)

    def lose_position(self, slip: float = 0.0) -> None:
        """Let the encoder fail: error 7380 and counts that are wrong by `slip` in m."""
        self.axis.reference.offset += self._scale.to_counts(slip)
        self.axis.forget_home()
        self.inject_fault(POSITION_LOST)

    def set_identity(self, identity: Identity) -> None:
        """Become another drive, as if somebody had swapped it; it boots."""
        self._identity = identity
        self.reboot()

    def set_frame_loss(
        self, sending: FrameLoss | None = None, receiving: FrameLoss | None = None
    ) -> None:
        """Let frames get lost, late or doubled; None makes a direction perfect again."""
        self._sending.set(sending or FrameLoss())
        self._receiving.set(receiving or FrameLoss())

    @property
    def state(self) -> State:
        """State of the power drive system."""
        return self.axis.state


def _is_among(code: int, entries: tuple[tuple[int, int], ...]) -> bool:
    return any(code & mask == value for mask, value in entries)
