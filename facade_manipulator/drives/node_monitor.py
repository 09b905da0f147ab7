"""NMT state of one drive: commanded by this master, and reported in heartbeats."""

from __future__ import annotations

from canopen.nmt import NMT_STATES

from facade_manipulator.canopen import nmt
from facade_manipulator.canopen.bus import Frame
from facade_manipulator.drives.encoder import Encoder
from facade_manipulator.drives.snapshot import Cause, Remedy


class NodeMonitor:
    """
    Monitor of the NMT state of one drive.

    A drive that has restarted has lost its position; the encoder position is then marked as lost.
    """

    def __init__(self, name: str, title: str, encoder: Encoder) -> None:
        self.state: str | None = None  #: of the last heartbeat, as the library names it
        #: time of the last heartbeat [s]
        self.heartbeat_time: float | None = None
        #: number of boot-up messages since the last reset, or since the start of the cycle
        self.boot_ups = 0
        #: whether the drive may have power and has ceased to receive commands by process data
        self.is_unreachable = False
        self.commanded = 'OPERATIONAL'  #: NMT state that this master has commanded
        self._expected = {self.commanded}  # this state, and states that may precede it
        self._name = name
        self._title = title
        self._encoder = encoder

    def expect(self, state: str) -> None:
        """Record the NMT state that this master commands."""
        if state != self.commanded:
            self._expected = {self.commanded, state}
        self.commanded = state

    def count_boot_ups(self) -> None:
        """Reset the number of boot-up messages."""
        self.boot_ups = 0

    def receive_heartbeat(self, frame: Frame, may_have_power: bool) -> Cause | None:
        """Receive a heartbeat or boot-up message; return the cause of a stop, if any."""
        number = nmt.state_number(frame.data)
        self.state = NMT_STATES.get(number)
        # a heartbeat seems old if the clock is set during its transmission
        self.heartbeat_time = max(frame.time, self.heartbeat_time or frame.time)
        if self.state == self.commanded:
            self._expected = {self.commanded}

        is_pre_operational = self.state == 'PRE-OPERATIONAL'
        is_uncommanded = is_pre_operational and self.state not in self._expected
        self.is_unreachable = is_uncommanded and may_have_power
        if is_uncommanded:
            self._encoder.distrust()  # the drive may have restarted
        if self.state == 'INITIALISING':
            self.boot_ups += 1
            self._encoder.distrust()
            return Cause(
                f'{self._title} has restarted by itself and has lost its position',
                Remedy.CONFIGURE,
                self._name,
                configure_again=True,
            )
        if self.state == 'OPERATIONAL':
            return None
        return Cause(
            f'{self._title} is no longer operational (NMT state {number})',
            'check the bus',
            self._name,
        )
