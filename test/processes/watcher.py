"""Independent listener: a separate python-can bus, whose frames the kernel stamps."""

from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
import socket
import time

import can
from frames import decode_tpdo1
from loopback_can import SO_RCVBUFFORCE

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.canopen.pdo import TPDO1
from facade_manipulator.drives.states import decode_state, State

NODES = (1, 2, 3)
PULSE = 0x7F1  # no drive listens to it
PULSE_PERIOD = 0.005  # s


class Watcher:
    """Receiver of the frames of drives and master, without its own frames."""

    def __init__(self, bus: BusSettings) -> None:
        self._bus = can.Bus(
            interface=bus.interface, channel=bus.channel, ignore_config=True
        )
        if bus.interface == 'socketcan':
            with suppress(PermissionError):  # keep more than some 250 frames
                self._bus.socket.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, 8 << 20)
        # few enough for a virtual machine to read in time
        wanted = [
            0x080,
            0x77F,
            PULSE,
        ]
        for node in NODES:
            wanted += [0x080 + node, 0x180 + node, 0x200 + node, 0x580 + node]
        filters = []
        for cob_id in wanted:
            filters.append({'can_id': cob_id, 'can_mask': 0x7FF, 'extended': False})
        self._bus.set_filters(filters)
        self._pulse = can.Bus(
            interface=bus.interface, channel=bus.channel, ignore_config=True
        )
        pulse = can.Message(arbitration_id=PULSE, is_extended_id=False)
        self._pulse.send_periodic(pulse, PULSE_PERIOD)
        self._frames: dict[int, list[can.Message]] = defaultdict(list)

    def read(self) -> None:
        """Store the frames received until now."""
        now = time.time()
        stamp = now
        # raised once after the interface went down
        with suppress(can.CanOperationError):
            while stamp <= now and (message := self._bus.recv(0.0)) is not None:
                stamp = message.timestamp
                if not message.is_remote_frame:
                    self._frames[message.arbitration_id].append(message)

    def of(self, cob_id: int) -> list[can.Message]:
        """Return the frames of one COB-ID so far."""
        self.read()
        return self._frames[cob_id]

    def forget(self) -> None:
        """Drop the frames received so far."""
        self.read()
        self._frames.clear()

    def send(self, cob_id: int, data: bytes) -> None:
        """Send a frame, which this listener does not receive itself."""
        message = can.Message(arbitration_id=cob_id, data=data, is_extended_id=False)
        self._bus.send(message)

    def first(
        self,
        cob_id: int,
        since: float,
        wanted: Callable[[bytes], bool] = lambda data: True,
    ) -> float | None:
        """Return the time of the first frame of a COB-ID after a time [s], None without one."""
        for frame in self.of(cob_id):
            if frame.timestamp >= since and wanted(bytes(frame.data)):
                return frame.timestamp
        return None

    def last(self, cob_id: int, until: float) -> float:
        """Return the time of the last frame of a COB-ID before a time [s]."""
        times = [frame.timestamp for frame in self.of(cob_id)]
        return max(time for time in times if time <= until)

    def pause(self, begin: float, end: float) -> float:
        """Return the duration for which this machine as a whole was paused [s]."""
        pulses = []
        for frame in self.of(PULSE):
            if begin - PULSE_PERIOD <= frame.timestamp <= end + PULSE_PERIOD:
                pulses.append(frame.timestamp)
        steps = [after - before for before, after in pairwise(pulses)]
        return max(steps) - PULSE_PERIOD

    def states(self) -> list[State | None]:
        """Return the states of the drives by their newest TPDO1."""
        return [self._state(node) for node in NODES]

    def _state(self, node: int) -> State | None:
        """Return the state of a drive by its newest TPDO1, None without one."""
        frames = self.of(TPDO1.cob_id(node))
        if not frames:
            return None
        newest = decode_tpdo1(bytes(frames[-1].data))
        return decode_state(newest.statusword)

    def close(self) -> None:
        """Close the bus."""
        self._pulse.shutdown()
        self._bus.shutdown()
