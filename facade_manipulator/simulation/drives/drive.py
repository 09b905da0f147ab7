"""
A simulated CiA 402 drive on CANopen: frames and time in, frames out; no thread, no clock.

It is as strict as a real drive and as unforgiving: it follows its objects to the letter, latches
at the SYNC, watches the heartbeat of its master, and trips. SDO server, NMT states, boot-up
message, heartbeat and emergency messages are the library's (`objects`); this module decides which
frame reaches which of them, and when.

References
----------
CiA 301 and IEC 61800-7-201 (CiA 402-2).

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import NamedTuple

from canopen.lss import LssMaster

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.nmt import NmtCommand, NmtState
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import DriveProfile, load_profile
from facade_manipulator.drives.states import State, Status
from facade_manipulator.simulation.drives.axis import SAFE_TORQUE_OFF, SimulatedAxis
from facade_manipulator.simulation.drives.lss import LssSlave, UNCONFIGURED
from facade_manipulator.simulation.drives.motor import SimulatedMotor, SimulationSettings
from facade_manipulator.simulation.drives.objects import COMMUNICATION_OBJECTS, Frame, Objects
from facade_manipulator.simulation.drives.pdo import ProcessData

HEARTBEAT_LOST, PDO_TOO_SHORT, POSITION_LOST = 0x8130, 0x8210, 0x7380

_MOTION_PERIOD = 0.02  # s: how often a drive that moves wants to be called without a SYNC
_BOOT_TIME = 0.05  # s
_REVISION = 1

_CONNECTION_ERRORS = (0x81, 0x82)  # the first digits of a code; 6007 has the reaction
_ERROR_REGISTER = {  # by the first digit of a code; any other sets the generic bit only
    0x2: 0x03, 0x3: 0x05, 0x4: 0x09, 0x7: 0x21, 0x8: 0x21, 0xF: 0x81}
_CONNECTION_REGISTER, _GENERIC_REGISTER = 0x11, 0x01


class SimulatedIdentity(NamedTuple):
    """The identity object 1018."""

    vendor_id: int = 0
    product_code: int = 0
    revision_number: int = 0
    serial_number: int = 0


class SimulatedDrive:
    """
    One drive at the home position of its axis; its supply is on from the start.

    Without a serial number in the axis settings, the serial number is the node id.
    Raises a ParameterError if the carriage is not on the rail, or there is no such drive type.
    """

    def __init__(
        self, axis: AxisSettings, settings: SimulationSettings | None = None,
        profile: DriveProfile | None = None,
    ) -> None:
        settings = settings or SimulationSettings()
        profile = profile or load_profile(axis.profile)
        scale = self._scale = profile.applied(axis)
        self.motor = SimulatedMotor(settings, scale)
        self.motor.place(axis.home_position)
        objects = self.objects = Objects(profile.eds, axis.node_id, settings.missing_objects)
        self.axis = SimulatedAxis(
            objects, self.motor, profile, scale, self._report_once, self._reset_errors)
        self.lss = LssSlave(
            axis.node_id, lambda: tuple(objects.values[0x1018, n] for n in range(1, 5)))
        self._pdo = ProcessData(objects, lambda: self._report_once(PDO_TOO_SHORT))
        self.now = 0.0  #: until when it has lived [s]
        self.node_id = axis.node_id  #: with UNCONFIGURED it is silent until LSS gives another
        self._master_due = math.inf
        self.is_silent = False  #: fault: it sends nothing
        self.is_deaf = False  #: fault: it takes no RPDO, and SDO as before
        self.errors: list[int] = []  #: codes that are present, the newest last
        objects.readers |= {
            (0x1001, 0): lambda: self._error_register, (0x603F, 0): lambda: self._error,
            (0x6041, 0): self._statusword, (0x60FD, 0): lambda: self.motor.inputs}
        objects.writers[0x1016, 1] = self._forget_master
        if polarity := profile.input_polarity:
            self.motor.inverted = lambda: objects.values[polarity[:2]] >> polarity.shift
        self.set_identity(SimulatedIdentity(
            scale.vendor_id, scale.product_code, _REVISION, axis.serial_number or axis.node_id))

    @property
    def state(self) -> State:
        """State of the power drive system."""
        return self.axis.state

    @property
    def nmt_state(self) -> NmtState:
        """State of the node."""
        return NmtState[self.objects.nmt.state.replace('-', '_')]

    def _statusword(self) -> int:
        return self.axis.statusword | Status.REMOTE * (self.nmt_state is NmtState.OPERATIONAL)

    # --- frames and time

    def receive(self, cob_id: int, data: bytes, now: float) -> list[Frame]:
        """Receive a frame at a time [s], which never decreases; return the answers."""
        route = self._route(cob_id, len(data))
        if route is None:
            return []
        self.now = self.objects.outbox.now = max(now, self.now)
        if self._boot_at == math.inf:
            self.axis.advance(self.now)
            route(cob_id, data)
        return self.advance(now)

    def advance(self, now: float) -> list[Frame]:
        """Let time pass; return what the drive sends: boot-up, heartbeat, emergencies, TPDOs."""
        self.now = self.objects.outbox.now = now = max(now, self.now)
        if now >= self._boot_at:
            self._boot()
        self.axis.advance(now)
        if now >= self._master_due:
            self._master_due = math.inf
            self._report_once(HEARTBEAT_LOST)
        frames = self.objects.outbox.take()
        return [] if self.is_silent or self._boot_at < math.inf else frames

    @property
    def deadline(self) -> float:
        """When `advance` must be called at the latest, if no frame comes before."""
        moving = self.now + _MOTION_PERIOD if self.axis.is_moving else math.inf
        return min(self._boot_at, self.objects.outbox.due, self._master_due, moving)

    def _route(self, cob_id: int, length: int) -> Callable[[int, bytes], None] | None:
        """Return the function that receives a frame by NMT state and objects, None without one."""
        state = self.nmt_state
        if cob_id == LssMaster.LSS_TX_COBID:
            return self._on_lss
        if self.node_id == UNCONFIGURED:
            return None
        if cob_id == pdo.NMT_COB_ID:
            return self._on_nmt if length == 2 else None
        if cob_id == self._master_cob_id:
            return self._on_heartbeat if length == 1 else None
        if state is NmtState.OPERATIONAL and cob_id == self.objects.values[0x1005, 0] & 0x7FF:
            return self._on_sync if not length else None
        if state is NmtState.OPERATIONAL and self._pdo.receives(cob_id):
            return None if self.is_deaf else self._pdo.receive
        is_request = cob_id == self.objects.sdo.rx_cobid and length == 8
        return self._on_sdo if is_request and state is not NmtState.STOPPED else None

    def _on_sync(self, cob_id: int, data: bytes) -> None:
        self._pdo.answer_sync()
        self._pdo.latch()
        self.axis.latch()

    def _on_sdo(self, cob_id: int, data: bytes) -> None:
        self.objects.sdo.on_request(cob_id, bytearray(data), self.now)

    def _on_heartbeat(self, cob_id: int, data: bytes) -> None:
        self._master_due = self.now + (self.objects.values[0x1016, 1] & 0xFFFF) * 1e-3
        if HEARTBEAT_LOST in self.errors:
            self.errors.remove(HEARTBEAT_LOST)
            self._announce()

    def _on_lss(self, cob_id: int, data: bytes) -> None:
        answer = self.lss.receive(data, self.node_id)
        if answer is not None:
            self.objects.outbox.send_message(LssMaster.LSS_RX_COBID, answer)
        if (self.node_id == UNCONFIGURED and not self.lss.is_selected
                and self.lss.pending != UNCONFIGURED):
            self._restart()

    # --- network management

    def reboot(self) -> None:
        """
        Switch the power off and on, as the NMT command reset node does.

        Objects, errors and axis lose what was written to them; it boots.

        """
        self.lss.power_up()
        self.objects.reset()
        self.errors.clear()
        self.axis.reset()
        self._restart()

    def _on_nmt(self, cob_id: int, data: bytes) -> None:
        if data[1] not in (0, self.node_id):
            return
        if data[0] == NmtCommand.RESET_NODE:
            self.reboot()
        elif data[0] == NmtCommand.RESET_COMMUNICATION:
            self.axis.lose_connection()
            self.objects.reset(COMMUNICATION_OBJECTS)
            self._restart()
        elif data[0] in list(NmtCommand):
            before = self.nmt_state
            self.objects.nmt.on_command(cob_id, data, self.now)
            if self.nmt_state is NmtState.STOPPED:
                self.axis.lose_connection()
            if self.nmt_state is not before:
                self._pdo.forget()

    def _restart(self) -> None:
        self._boot_at = self.now + _BOOT_TIME
        self.node_id = self.lss.pending
        if self.node_id not in (self.objects.id, UNCONFIGURED):
            self.objects.renumber(self.node_id)
            self.objects.reset(COMMUNICATION_OBJECTS)
        self.objects.nmt.stop_heartbeat()
        self.objects.nmt.on_command(0, bytes([NmtCommand.RESET_NODE, 0]), self.now)
        self._forget_master()
        self._pdo.forget()

    def _boot(self) -> None:
        self._boot_at = math.inf
        if self.node_id != UNCONFIGURED:
            self.objects.nmt.state = 'INITIALISING'  # sends the boot-up message
            self.objects.nmt.state = 'PRE-OPERATIONAL'  # starts the heartbeat
            if self.axis.torque_off:
                self._report_once(SAFE_TORQUE_OFF)

    @property
    def _master_cob_id(self) -> int | None:
        """COB-ID of the heartbeat that 1016:01 lets it watch, None if none."""
        entry = self.objects.values[0x1016, 1]
        node, time_out = entry >> 16 & 0xFF, entry & 0xFFFF
        return pdo.heartbeat_cob_id(node) if time_out and 0 < node < 0x80 else None

    def _forget_master(self, value: int = 0) -> None:
        """Watch no heartbeat until one has come."""
        self._master_due = math.inf

    # --- errors

    @property
    def _error(self) -> int:
        return self.errors[-1] if self.errors else 0

    @property
    def _error_register(self) -> int:
        register = 0
        for code in self.errors:
            register |= (_CONNECTION_REGISTER if code >> 8 in _CONNECTION_ERRORS
                         else _ERROR_REGISTER.get(code >> 12, _GENERIC_REGISTER))
        return register

    def _announce(self) -> None:
        """Send an emergency message: the newest error that is present, or that none is."""
        if self.nmt_state is not NmtState.STOPPED:
            self.objects.emcy.send(self._error, self._error_register)

    def _report_once(self, code: int) -> None:
        if code not in self.errors:
            self.inject_fault(code)

    def _reset_errors(self) -> bool:
        """Do a fault reset; return whether no error is left."""
        if self.errors:
            self.errors = [SAFE_TORQUE_OFF] * self.axis.torque_off
            self._announce()
        return not self.errors

    # --- fault injection; further faults have names in `faults`

    def inject_fault(self, code: int) -> None:
        """
        Let an error happen, with the emergency message and the reaction that belong to it.

        81xx and 82xx cause the reaction of 6007, 86xx and 8A8x the ramp of 605E, all others
        cut the power.
        """
        self.errors = [*(each for each in self.errors if each != code), code]
        values = self.objects.values
        past = code, *(values[0x1003, number] for number in range(1, 8))
        values.update(((0x1003, number), each) for number, each in enumerate(past, start=1))
        values[0x1003, 0] = min(values[0x1003, 0] + 1, 8)
        if code >> 8 in _CONNECTION_ERRORS:
            self.axis.lose_connection()
        else:  # the position controller's errors and limits make the ramp of 605E
            self.axis.fail(keeps_power=code >> 8 == 0x86 or code & 0xFFF8 == 0x8A80)
        self._announce()

    def remove_cause(self) -> None:
        """Close safe torque off; a fault reset then clears its error."""
        self.axis.torque_off = False

    def open_safe_torque_off(self) -> None:
        """Cut the power by the safety chain until `remove_cause`."""
        self.axis.torque_off = True
        self.inject_fault(SAFE_TORQUE_OFF)

    def lose_position(self, slip: float = 0.0) -> None:
        """Let the encoder fail: error 7380 and counts that are wrong by `slip` in m."""
        self.motor.offset += self._scale.to_counts(slip)
        self.axis.homing.attained = False
        self.inject_fault(POSITION_LOST)

    def set_identity(self, identity: SimulatedIdentity) -> None:
        """Become another drive, as if it was swapped; it boots."""
        for subindex, value in enumerate(identity, start=1):
            self.objects.defaults[0x1018, subindex] = value
        self.reboot()

    def stop_heartbeat(self) -> None:
        """Send no heartbeat, and everything else as before."""
        self.objects.values[0x1017, 0] = 0
        self.objects.nmt.start_heartbeat(0)


def simulated_drives(
    axes: Sequence[AxisSettings], settings: SimulationSettings | None = None
) -> list[SimulatedDrive]:
    """Make one drive for each axis, as `SimulatedDrive` does."""
    return [SimulatedDrive(axis, settings) for axis in axes]
