"""
Simulated CiA 402 drive: frames and time in, frames out, without a thread or clock.

The drive is as strict as a real drive: it obeys its objects exactly, latches at the SYNC,
supervises the heartbeat of its master, and trips. The canopen library provides SDO server, NMT
states, boot-up message, heartbeat and emergency messages (`objects`). This module decides which
service receives a frame, and when.

References
----------
CiA 301 and IEC 61800-7-201 (CiA 402-2).

"""

from __future__ import annotations

from collections.abc import Callable
import math

from canopen.nmt import NMT_COMMANDS

from facade_manipulator.canopen import cob_ids, indices, sync
from facade_manipulator.canopen.lss import LssSlave, UNCONFIGURED
from facade_manipulator.canopen.nmt import SupervisedHeartbeat
from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import DriveProfile, load_profile
from facade_manipulator.simulation.drives.motor import (
    SimulatedMotor,
    SimulationSettings,
)
from facade_manipulator.simulation.drives.objects import Frame, Objects
from facade_manipulator.simulation.drives.process_data import ProcessData
from facade_manipulator.simulation.drives.simulated_axis import (
    SAFE_TORQUE_OFF,
    SimulatedAxis,
)


class SimulatedDrive:
    """
    Simulated drive, initially at the home position of its axis with its supply switched on.

    Without a serial number in the axis settings, the serial number is the node id.
    Raises a ParameterError for an unknown drive type.
    """

    # error codes
    HEARTBEAT_LOST = 0x8130
    PDO_TOO_SHORT = 0x8210

    _SUPERVISED_HEARTBEAT = (indices.CONSUMER_HEARTBEAT_TIME, 1)

    _MOTION_PERIOD = 0.02  # s: period of the calls of a moving drive without a SYNC
    _BOOT_TIME = 0.05  # s

    def __init__(
        self,
        axis: AxisSettings,
        settings: SimulationSettings | None = None,
        profile: DriveProfile | None = None,
    ) -> None:
        settings = settings or SimulationSettings()
        profile = profile or load_profile(axis.profile)
        scale = profile.applied(axis)
        motor = SimulatedMotor(settings, scale)
        objects = Objects(profile, scale, settings.missing_objects)
        self.motor = motor
        self.objects = objects
        self.axis = SimulatedAxis(objects, motor, self.inject_fault, self._reset_errors)
        self.lss = LssSlave(axis.node_id, objects.values)
        self._pdo = ProcessData(objects, lambda: self.inject_fault(self.PDO_TOO_SHORT))
        self.now = 0.0  #: time of the simulation [s]
        self._last_sync = 0.0  # that the drive has produced [s]
        #: time at which the heartbeat of the master is lost [s]
        self._master_due = math.inf
        self.is_silent = False  #: fault: the drive sends no frame
        self.is_deaf = False  #: fault: the drive ignores RPDOs, but serves SDO
        self.errors: list[int] = []  #: codes of the present errors, the newest last
        objects.readers |= {
            # only the bit that stands for any error
            (indices.ERROR_REGISTER, 0): lambda: int(bool(self.errors)),
            (indices.ERROR_CODE, 0): lambda: self.errors[-1] if self.errors else 0,
        }
        objects.writers[self._SUPERVISED_HEARTBEAT] = self._forget_master
        if polarity := profile.input_polarity:
            motor.inverted = lambda: (
                objects.values.get(polarity[:2], 0) >> polarity.shift
            )
        # boots, and thereby sets `_boot_at` and `node_id`
        self.set_identity(
            scale.vendor_id, scale.product_code, 1, axis.serial_number or axis.node_id
        )

    # --- frames and time

    def receive(self, cob_id: int, data: bytes, now: float) -> list[Frame]:
        """Receive a frame at a time [s], which must not decrease; return the answers."""
        service = self._service(cob_id, len(data))
        if service is None:
            return []
        self._set_time(now)
        if self._boot_at == math.inf:
            self.axis.advance(self.now)
            service(cob_id, data, self.now)
        return self.advance(now)

    def advance(self, now: float) -> list[Frame]:
        """Advance to a time [s]; return sent frames: boot-up, heartbeat, emergencies, TPDOs."""
        self._set_time(now)
        now = self.now
        if now >= self._boot_at:
            self._boot()
        self.axis.advance(now)
        if now >= self._master_due:
            self._master_due = math.inf
            self.inject_fault(self.HEARTBEAT_LOST)
        if now >= self._next_sync:
            self._send_sync()
        frames = self.objects.outbox.take()
        return [] if self.is_silent or self._boot_at < math.inf else frames

    def _set_time(self, now: float) -> None:
        """Advance the time of the drive [s], which must not decrease."""
        self.now = max(now, self.now)
        self.objects.outbox.now = self.now

    @property
    def deadline(self) -> float:
        """Return the latest time [s] at which `advance` must be called if no frame arrives."""
        moving = self.now + self._MOTION_PERIOD if self.axis.is_moving else math.inf
        return min(
            self._boot_at,
            self.objects.outbox.due,
            self._master_due,
            self._next_sync,
            moving,
        )

    @property
    def _next_sync(self) -> float:
        """Return the time [s] of the next SYNC that this drive sends."""
        values = self.objects.values
        is_producer = values[indices.COB_ID_SYNC, 0] & sync.PRODUCER
        is_silent = self._boot_at < math.inf or self.objects.nmt.state == 'STOPPED'
        if not is_producer or is_silent:
            return math.inf
        period = 1e-6 * values.get((indices.SYNC_PERIOD, 0), 0)
        return self._last_sync + period if period else math.inf

    def _send_sync(self) -> None:
        """Send SYNC as its producer, and obey it as every other drive does."""
        self._last_sync = self.now
        self.objects.outbox.send_message(cob_ids.SYNC, b'')
        if self.objects.nmt.state == 'OPERATIONAL':
            self._on_sync(cob_ids.SYNC, b'', self.now)

    def _service(
        self, cob_id: int, length: int
    ) -> Callable[[int, bytes, float], None] | None:
        """
        Return the function that receives COB-ID, data and time of a frame; None if unknown.

        The receiver depends on the NMT state and the objects.

        """
        if cob_id == cob_ids.LSS_REQUEST:
            return self._on_lss if length == 8 else None
        if self.node_id == UNCONFIGURED:
            return None
        if cob_id == cob_ids.NMT:
            return self._on_nmt if length == 2 else None
        state = self.objects.nmt.state
        values = self.objects.values
        if cob_id >= cob_ids.HEARTBEAT and self._is_supervised(cob_id):
            return self._on_heartbeat if length == 1 else None
        sync_cob_id = values[indices.COB_ID_SYNC, 0] & cob_ids.COB_ID_BITS
        if state == 'OPERATIONAL' and cob_id == sync_cob_id:
            return self._on_sync if not length else None
        if state == 'OPERATIONAL' and cob_id in self._pdo.received:
            return None if self.is_deaf else self._pdo.receive
        is_request = cob_id == self.objects.sdo.rx_cobid and length == 8
        return (
            self.objects.sdo.on_request if is_request and state != 'STOPPED' else None
        )

    def _on_sync(self, cob_id: int, data: bytes, now: float) -> None:
        """Send the TPDOs triggered by a SYNC, and apply the received RPDOs."""
        self._pdo.answer_sync()
        self._pdo.latch()
        self.axis.latch()

    @property
    def _supervised_heartbeat(self) -> SupervisedHeartbeat:
        """Return the monitored heartbeat of the master; a drive without 1016h monitors none."""
        value = self.objects.values.get(self._SUPERVISED_HEARTBEAT, 0)
        return SupervisedHeartbeat.decode(value)

    def _is_supervised(self, cob_id: int) -> bool:
        """Return whether a COB-ID belongs to the monitored heartbeat of the master."""
        master, timeout = self._supervised_heartbeat
        return bool(timeout) and cob_id == cob_ids.HEARTBEAT + master

    def _on_heartbeat(self, cob_id: int, data: bytes, now: float) -> None:
        """Restart the monitoring of the master's heartbeat; end the error of a lost heartbeat."""
        self._master_due = now + 1e-3 * self._supervised_heartbeat.timeout
        if self.HEARTBEAT_LOST in self.errors:
            self.errors.remove(self.HEARTBEAT_LOST)
            self._announce()

    def _on_lss(self, cob_id: int, data: bytes, now: float) -> None:
        """Answer an LSS request; a new node id restarts an unconfigured drive."""
        answer = self.lss.receive(data, self.node_id)
        if answer is not None:
            self.objects.outbox.send_message(cob_ids.LSS_RESPONSE, answer)
        if (
            self.node_id == UNCONFIGURED
            and not self.lss.is_selected
            and self.lss.pending != UNCONFIGURED
        ):
            self._restart(keeps_application=True)

    # --- network management

    def reboot(self) -> None:
        """
        Switch the supply off and on; the NMT command reset node has the same effect.

        Objects, errors and axis are reset, and the drive boots.

        """
        self.lss.power_up()
        self.errors.clear()
        self._restart(keeps_application=False)
        self.axis.reset()

    def _on_nmt(self, cob_id: int, data: bytes, now: float) -> None:
        """Obey a network management command for this node or for all nodes."""
        command, node_id = data
        if node_id not in (0, self.node_id):
            return
        if command == NMT_COMMANDS['RESET']:
            self.reboot()
        elif command == NMT_COMMANDS['RESET COMMUNICATION']:
            self.axis.lose_connection()
            self._restart(keeps_application=True)
        else:
            self.objects.nmt.on_command(cob_id, data, now)
            self._pdo.forget()
            if self.objects.nmt.state == 'STOPPED':
                self.axis.lose_connection()

    def _restart(self, keeps_application: bool) -> None:
        """Restart the communication, optionally also the application; then boot."""
        self._boot_at = self.now + self._BOOT_TIME  # infinity after the boot
        #: with UNCONFIGURED the drive is silent until LSS sets it
        self.node_id = self.lss.pending
        self.objects.restart(self.node_id, keeps_application)
        self._forget_master()
        self._pdo.forget()

    def _boot(self) -> None:
        """Send the boot-up message, start the heartbeat, and report a safe torque off input."""
        self._boot_at = math.inf
        self._last_sync = self.now
        if self.node_id != UNCONFIGURED:
            self.objects.nmt.state = 'INITIALISING'  # sends the boot-up message
            self.objects.nmt.state = 'PRE-OPERATIONAL'  # starts the heartbeat
            if self.objects.profile.quirks.starts_itself:
                self.objects.nmt.state = 'OPERATIONAL'
            if self.axis.torque_off:
                self.inject_fault(SAFE_TORQUE_OFF)

    def _forget_master(self, value: int = 0) -> None:
        """Suspend the heartbeat monitoring until the next heartbeat."""
        self._master_due = math.inf

    # --- errors

    def _announce(self) -> None:
        """Send an emergency message with the newest active error, or code 0 without an error."""
        if self.objects.nmt.state != 'STOPPED':
            code = self.objects.read((indices.ERROR_CODE, 0))
            register = self.objects.read((indices.ERROR_REGISTER, 0))
            self.objects.emcy.send(code, register)

    def _reset_errors(self) -> bool:
        """Reset the errors; return whether no error is active any longer."""
        if self.errors:
            self.errors = [SAFE_TORQUE_OFF] * self.axis.torque_off
            self._announce()
        return not self.errors

    # --- fault injection

    def inject_fault(self, code: int) -> None:
        """
        Cause a new error, with emergency message and reaction.

        Codes 81xx and 82xx cause the reaction of 6007h, 86xx and 8A8x the ramp of 605Eh, and all
        other codes cut the power.
        """
        if code in self.errors:
            return
        self.errors.append(code)
        if code >> 8 in (0x81, 0x82):
            self.axis.lose_connection()
        else:  # the position controller's errors and limits make the ramp of 605E
            self.axis.fail(keeps_power=code >> 8 == 0x86 or code & 0xFFF8 == 0x8A80)
        self._announce()

    def set_identity(
        self, vendor_id: int, product_code: int, revision: int, serial_number: int
    ) -> None:
        """
        Replace the drive with another drive, which boots with its default object values.

        The new drive has the stored node id of the replaced drive, as if set by the same switches.
        The carriage stays at its place, and the encoder counts from 0 there. Injected silence and
        deafness continue.
        """
        self.objects.stored = {}  # these values are in the replaced drive
        numbers = (vendor_id, product_code, revision, serial_number)
        for subindex, number in enumerate(numbers, start=1):
            self.objects.defaults[indices.IDENTITY, subindex] = number
        self.reboot()
