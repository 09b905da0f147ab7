"""Output to one drive: its command, its target, and the RPDOs that contain them."""

from __future__ import annotations

from facade_manipulator.canopen import indices
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.states import AxisCommand, Controlword, Mode


class Output:
    """
    Command and target of one drive.

    Once per cycle, the group sets the command and the supervision of targets sets the target. Then
    the exchange sends the frames.
    """

    def __init__(self, node_id: int, profile: DriveProfile) -> None:
        self.command = AxisCommand(
            Controlword.DISABLE_VOLTAGE, Mode.CYCLIC_SYNCHRONOUS_POSITION
        )
        self.target = 0  #: [counts]
        self._rpdos = [
            (one.cob_id(node_id), one.codec.pack, one.indices) for one in profile.rpdos
        ]
        self._cyclic_bit_4 = profile.quirks.cyclic_bit_4
        # bit 4 of the last controlword, if the drive needs its change
        self._toggled_bit = 0

    def take(self, command: AxisCommand) -> None:
        """Set the command for this cycle."""
        self.command = command

    def aim_at(self, counts: int) -> None:
        """Set the target for this cycle [counts]."""
        self.target = counts

    @property
    def holds_target(self) -> bool:
        """Return whether the drive has power and holds its target."""
        return _holds_target(self.command)

    def frames(self, command: AxisCommand) -> list[tuple[int, bytes]]:
        """Return COB-ID and data of the RPDOs with a command and the present target."""
        values = {
            indices.CONTROLWORD: command.controlword | self._bit_4(command),
            indices.MODE_OF_OPERATION: command.mode,
            indices.TARGET_POSITION: self.target,
        }
        frames = []
        for cob_id, pack, mapped in self._rpdos:
            content = [values[index] for index in mapped]
            frames.append((cob_id, pack(*content)))
        return frames

    def _bit_4(self, command: AxisCommand) -> int:
        """Return controlword bit 4; some drives need this bit to accept each target."""
        if self._cyclic_bit_4 == 'clear' or not _holds_target(command):
            return 0
        if self._cyclic_bit_4 == 'toggled':
            self._toggled_bit ^= Controlword.NEW_TARGET
            return self._toggled_bit
        return Controlword.NEW_TARGET


def _holds_target(command: AxisCommand) -> bool:
    """Return whether a drive with this command has power and holds its target."""
    is_cyclic = command.mode == Mode.CYCLIC_SYNCHRONOUS_POSITION
    is_enabled = command.controlword & 0x0F == Controlword.ENABLE_OPERATION
    return is_cyclic and is_enabled
