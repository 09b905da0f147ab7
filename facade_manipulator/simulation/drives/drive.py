"""
A simulated CiA 402 drive on CANopen: frames and time in, frames out; no thread, no clock.

It is as strict as a real drive and as unforgiving: it follows its objects to the letter, latches
at the SYNC, watches the heartbeat of its master, and trips.

References
----------
CiA 301 and IEC 61800-7-201 (CiA 402-2).

"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from facade_manipulator.drives.canopen.nmt import NmtState
from facade_manipulator.drives.cia402.profile import DriveProfile, load_profile
from facade_manipulator.drives.cia402.settings import AxisSettings
from facade_manipulator.drives.cia402.states import State, Status
from facade_manipulator.errors import ParameterError
from facade_manipulator.simulation.drives.axis import SAFE_TORQUE_OFF, SimulatedAxis
from facade_manipulator.simulation.drives.motor import SimulatedMotor, SimulationSettings
from facade_manipulator.simulation.drives.node import SimulatedNode
from facade_manipulator.simulation.drives.objects import ObjectStore

POSITION_LOST = 0x7380
_REVISION = 1

# what an error does, by mask and code: most cut the power, these do not
_CONNECTION_ERRORS = ((0xFF00, 0x8100), (0xFF00, 0x8200))
_ERROR_BEHAVIOUR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}  # 1029:01
_RAMP_ERRORS = ((0xFF00, 0x8600), (0xFFF8, 0x8A80))


class SimulatedIdentity(NamedTuple):
    """The identity object 1018."""

    vendor_id: int = 0
    product_code: int = 0
    revision_number: int = 0
    serial_number: int = 0


class SimulatedDrive(SimulatedNode):
    """
    One drive, which is where the axis's home position says.

    An identity that the axis leaves open is made up: the serial number is then the node id.
    Raises a ParameterError if the carriage is not on the rail, or there is no such drive type.
    """

    def __init__(
        self, axis: AxisSettings, settings: SimulationSettings | None = None,
        profile: DriveProfile | None = None,
    ) -> None:
        settings = settings or SimulationSettings()
        profile = profile or load_profile(axis.profile)
        if not settings.lower_stop <= axis.home_position <= settings.upper_stop:
            raise ParameterError(
                f'home_position = {axis.home_position:g} m is not between the simulated hard '
                f'stops {settings.lower_stop:g} m and {settings.upper_stop:g} m')
        axis = self._scale = profile.applied(axis)
        self.motor = SimulatedMotor(settings, self._scale)
        self.motor.place(axis.home_position)
        objects = ObjectStore(profile.eds, axis.node_id, settings.missing_objects)
        objects.writers[0x6040, 0] = self._write_controlword
        objects.readers[0x6041, 0] = self._statusword
        objects.defaults[0x100A, 0] = settings.firmware_version
        objects.readers[0x60FD, 0] = lambda: self.motor.inputs
        if polarity := profile.input_polarity:
            self.motor.inverted = lambda: objects.values[polarity[:2]] >> polarity.shift
        super().__init__(
            objects,
            SimulatedAxis(objects, self.motor, profile, self._scale, self._report_once),
            self._report_once, settings.boot_time, profile.quirks)
        self.set_identity(SimulatedIdentity(
            axis.vendor_id, axis.product_code, _REVISION, axis.serial_number or axis.node_id))

    @property
    def state(self) -> State:
        """State of the power drive system."""
        return self.axis.state

    # --- controlword, statusword, errors

    def _statusword(self) -> int:
        remote = Status.REMOTE * (self.nmt_state is NmtState.OPERATIONAL)
        return self.axis.statusword | remote if self.axis.statusword else 0

    def _write_controlword(self, controlword: int) -> None:
        resets = self.axis.is_reset_edge(controlword)
        self.axis.control(controlword)
        if resets:
            self._reset_errors()

    def _reset_errors(self) -> None:
        had_errors = self.errors.code != 0
        if self.errors.reset():
            self.axis.leave_fault()
        if had_errors:
            self._announce()

    def _report_once(self, code: int) -> None:
        if code not in self.errors:
            self.inject_fault(code, persistent=code == SAFE_TORQUE_OFF)

    # --- fault injection

    def inject_fault(self, code: int, persistent: bool = False) -> None:
        """
        Let an error happen, with the emergency message and the reaction that belong to it.

        81xx and 82xx do what 6007 says, 86xx and 8A8x make the ramp of 605E, all others
        cut the power. A persistent one rejects a fault reset until `remove_cause`.
        """
        self.errors.add(code, persistent)
        is_connection = _is_among(code, _CONNECTION_ERRORS)
        if is_connection:
            self.axis.lose_connection()
        else:
            self.axis.fail(keeps_power=_is_among(code, _RAMP_ERRORS))
        self._announce()
        if is_connection and self.nmt_state is NmtState.OPERATIONAL:
            behaviour = self.objects.values.get((0x1029, 1), -1)
            self._enter_nmt(_ERROR_BEHAVIOUR.get(behaviour, self.nmt_state))

    def remove_cause(self) -> None:
        """Let persistent errors be ones that a fault reset clears; close safe torque off."""
        self.axis.torque_off = False
        self.errors.remove_causes()

    def open_safe_torque_off(self) -> None:
        """Cut the power by the safety chain until `remove_cause`."""
        self.axis.torque_off = True
        self.inject_fault(SAFE_TORQUE_OFF, persistent=True)

    def lose_position(self, slip: float = 0.0) -> None:
        """Let the encoder fail: error 7380 and counts that are wrong by `slip` in m."""
        self.motor.offset += self._scale.to_counts(slip)
        self.axis.forget_home()
        self.inject_fault(POSITION_LOST)

    def set_identity(self, identity: SimulatedIdentity) -> None:
        """Become another drive, as if somebody had swapped it; it boots."""
        for subindex, value in enumerate(identity, start=1):
            self.objects.defaults[0x1018, subindex] = value
        self.reboot()


def _is_among(code: int, entries: tuple[tuple[int, int], ...]) -> bool:
    return any(code & mask == value for mask, value in entries)


def simulated_drives(
    axes: Sequence[AxisSettings], settings: SimulationSettings | None = None
) -> list[SimulatedDrive]:
    """Make one drive for each axis, as `SimulatedDrive` does."""
    return [SimulatedDrive(axis, settings) for axis in axes]
