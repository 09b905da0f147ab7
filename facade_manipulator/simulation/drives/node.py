"""
The CANopen node of a simulated drive: frames and time in, frames out; no thread, no clock.

References
----------
CiA 301: NMT slave, SDO server, PDO, SYNC consumer, emergency and heartbeat producer and consumer.

"""

from __future__ import annotations

from collections.abc import Callable
import math

from canopen.lss import LssMaster

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.canopen.emergency import Emergency, encode_emergency
from facade_manipulator.drives.canopen.nmt import NMT_TRANSITIONS, NmtCommand, NmtState
from facade_manipulator.drives.cia402.profile import Quirks
from facade_manipulator.simulation.drives.axis import SimulatedAxis
from facade_manipulator.simulation.drives.errors import ErrorHistory
from facade_manipulator.simulation.drives.lss import LssSlave, UNCONFIGURED
from facade_manipulator.simulation.drives.objects import (
    COMMUNICATION_OBJECTS,
    ObjectServer,
    ObjectStore,
)
from facade_manipulator.simulation.drives.pdo import ProcessData

HEARTBEAT_LOST = 0x8130
PDO_TOO_SHORT = 0x8210

_MOTION_PERIOD = 0.02  # s: how often a drive that moves wants to be called without a SYNC

Frame = tuple[int, bytes]
Route = Callable[[int, bytes], None]


class SimulatedNode:
    """
    What makes a drive a CANopen node; it gets power when it is made.

    The axis behind it gets SYNC, time, boot-up and lost connections from it; `report` takes
    the code of an error that it finds in its communication.
    """

    nmt_state: NmtState
    _master_due: float

    def __init__(
        self, objects: ObjectStore, axis: SimulatedAxis, report: Callable[[int], None],
        boot_time: float, quirks: Quirks,
    ) -> None:
        self.node_id = node_id = objects.node_id  #: UNCONFIGURED: it is silent until LSS gives one
        self.lss = LssSlave(
            node_id, lambda: tuple(objects.values[0x1018, n] for n in range(1, 5)))
        self.objects, self.axis, self._report = objects, axis, report
        self.errors = ErrorHistory(objects)
        self._boot_time = boot_time
        self._boots_operational = quirks.boots_operational
        self._outbox: list[Frame] = []
        self.now = 0.0  #: until when it has lived [s]
        self.is_silent = False  #: fault injection: it sends nothing
        self.is_deaf = False  #: fault injection: it takes no RPDO, and SDO as before
        self._sdo = ObjectServer(node_id, objects, self)
        self._pdo = ProcessData(
            objects, self.send_message, lambda: report(PDO_TOO_SHORT))
        objects.writers.update({
            (0x1016, 1): self._forget_master,
            (0x1017, 0): self._restart_heartbeat,
        })
        self.reboot()

    # --- frames and time

    def receive(self, cob_id: int, data: bytes, now: float) -> list[Frame]:
        """Take a frame at a time [s], which never goes back; return what the drive sends."""
        route = self._route(cob_id)
        if route is None:
            return []
        self.now = max(now, self.now)
        if self._boot_at == math.inf:
            self.axis.advance(self.now)
            route(cob_id, data)
        return self.advance(now)

    def advance(self, now: float) -> list[Frame]:
        """Let time pass; return what the drive sends: boot-up, heartbeat, emergencies, TPDOs."""
        self.now = now = max(now, self.now)
        if now >= self._boot_at:
            self._boot()
        self.axis.advance(now)
        if now >= self._master_due:
            self._master_due, self._master_is_lost = math.inf, True
            self._report(HEARTBEAT_LOST)
        if now >= self._heartbeat_at:
            self._send_heartbeat(now)
        frames, self._outbox = self._outbox, []
        return [] if self.is_silent or self._boot_at < math.inf else frames

    @property
    def deadline(self) -> float:
        """When `advance` must be called at the latest, if no frame comes before."""
        moving = self.now + _MOTION_PERIOD if self.axis.is_moving else math.inf
        return min(self._boot_at, self._heartbeat_at, self._master_due, moving)

    def send_message(self, cob_id: int, data: bytes) -> None:
        """Put a frame into the outbox."""
        self._outbox.append((cob_id, bytes(data)))

    def _route(self, cob_id: int) -> Route | None:
        """Return what takes a frame, as NMT state and objects say, None if nothing does."""
        if cob_id == LssMaster.LSS_TX_COBID:
            return self._on_lss
        if self.node_id == UNCONFIGURED:
            return None
        if cob_id == pdo.NMT_COB_ID:
            return self._on_nmt
        if cob_id == self._master_cob_id:
            return self._on_heartbeat
        if self.nmt_state is NmtState.OPERATIONAL:
            if cob_id == self.objects.values[0x1005, 0] & 0x7FF:
                return self._on_sync
            if self._pdo.receives(cob_id):
                return self._on_rpdo
        is_request = cob_id == self._sdo.rx_cobid and self.nmt_state is not NmtState.STOPPED
        return self._on_sdo if is_request else None

    def _on_sync(self, cob_id: int, data: bytes) -> None:
        if not data:
            self._pdo.answer_sync()
            self._pdo.latch()
            self.axis.latch()

    def _on_rpdo(self, cob_id: int, data: bytes) -> None:
        if not self.is_deaf and self._pdo.receive(cob_id, data):
            self.axis.latch()

    def _on_sdo(self, cob_id: int, data: bytes) -> None:
        self._sdo.request(data)

    def _on_heartbeat(self, cob_id: int, data: bytes) -> None:
        if len(data) != 1:
            return
        self._master_due = self.now + (self.objects.values[0x1016, 1] & 0xFFFF) * 1e-3
        if self._master_is_lost:
            self._master_is_lost = False
            self.errors.discard(HEARTBEAT_LOST)
            self._announce()

    def _on_lss(self, cob_id: int, data: bytes) -> None:
        answer = self.lss.receive(data, self.node_id)
        if answer is not None:
            self.send_message(LssMaster.LSS_RX_COBID, answer)
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
        self.errors.forget()
        self.axis.reset()
        self._restart()

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
            self.axis.lose_connection()
        if state is not self.nmt_state:
            self._pdo.forget()
        self.nmt_state = state

    def _reset_communication(self) -> None:
        self.axis.lose_connection()
        self.objects.reset(COMMUNICATION_OBJECTS)
        self._restart()

    def _restart(self) -> None:
        self._boot_at = self.now + self._boot_time
        if self.lss.pending != self.node_id:
            self._take_node_id(self.lss.pending)
        self._heartbeat_at = math.inf
        self._forget_master()
        self._pdo.forget()
        self.nmt_state = NmtState.INITIALISING

    def _take_node_id(self, node_id: int) -> None:
        self.node_id = node_id
        if node_id != UNCONFIGURED:
            self.objects.set_node_id(node_id)
            self.objects.reset(COMMUNICATION_OBJECTS)
            self._sdo.rx_cobid = pdo.sdo_request_cob_id(node_id)
            self._sdo.tx_cobid = pdo.sdo_response_cob_id(node_id)

    def _boot(self) -> None:
        self._boot_at = math.inf
        if self.node_id == UNCONFIGURED:
            return
        self.send_message(pdo.heartbeat_cob_id(self.node_id), bytes([NmtState.INITIALISING]))
        self._enter_nmt(NmtState.OPERATIONAL if self._boots_operational
                        else NmtState.PRE_OPERATIONAL)
        self._restart_heartbeat(self.objects.values[0x1017, 0])
        self.axis.boot()

    @property
    def _master_cob_id(self) -> int | None:
        """COB-ID of the heartbeat that 1016:01 lets it watch, None if none."""
        entry = self.objects.values[0x1016, 1]
        node, time_out = entry >> 16 & 0xFF, entry & 0xFFFF
        return pdo.heartbeat_cob_id(node) if time_out and 0 < node < 0x80 else None

    def _forget_master(self, value: int = 0) -> None:
        """Watch no heartbeat until one has come."""
        self._master_due, self._master_is_lost = math.inf, False

    def _restart_heartbeat(self, period: int) -> None:
        self._heartbeat_at = self.now + period * 1e-3 if period else math.inf

    def _send_heartbeat(self, now: float) -> None:
        self.send_message(pdo.heartbeat_cob_id(self.node_id), bytes([self.nmt_state]))
        late, period = now - self._heartbeat_at, self.objects.values[0x1017, 0]
        self._restart_heartbeat(period)
        if late < period * 1e-3:
            self._heartbeat_at -= late  # keeps the rate although each poll comes a little late

    def stop_heartbeat(self) -> None:
        """Send no heartbeat any more, and everything else as before."""
        self.objects.values[0x1017, 0] = 0
        self._restart_heartbeat(0)

    # --- errors

    def _announce(self) -> None:
        """Send an emergency message: the error that is present now, or that none is."""
        if self.nmt_state in (NmtState.OPERATIONAL, NmtState.PRE_OPERATIONAL):
            entry = self.objects.values[0x1014, 0]
            if not entry & pdo.DISABLED:
                message = Emergency(self.errors.code, self.errors.register)
                self.send_message(entry & 0x7FF, encode_emergency(message))
