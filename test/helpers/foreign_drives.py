"""
CiA 402 drives of independent make: the stack is durand's, the state machine this file's own.

Nothing of the package is in them, so that two readings of CiA 301 meet: SDO, expedited and in
segments, NMT, heartbeats, EMCY, PDO mapping and SYNC. They lack following error, error code,
torque and digital inputs; their carriages are at the target at once.
"""

from __future__ import annotations

import sched
import threading
import time

import can
from durand import CANBusNetwork, MinimalNode, set_scheduler, Variable
from durand.datatypes import DatatypeEnum as Type
from durand.object_dictionary import Record
from durand.scheduler import SyncScheduler

NAME = b'a drive of another make, with a name that needs many segments'
PDOS = {'RPDO1': [0x6040, 0x6060, 0x607A], 'TPDO1': [0x6041, 0x6061, 0x6064],
        'TPDO2': [0x606C]}
MASTER = 0x77F
LOOK_PERIOD = 0.02  # s
LOST_HEARTBEAT, FOLLOWING_ERROR = 0x8130, 0x8611
OFF, READY, ON, ENABLED, STOPPED, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08
TARGET_REACHED, FOLLOWS = 1 << 10, 1 << 12
OBJECTS = {  # that the master writes
    0x6007: Type.INTEGER16, 0x605A: Type.INTEGER16, 0x605E: Type.INTEGER16,
    0x6065: Type.UNSIGNED32, 0x6066: Type.UNSIGNED16, 0x6085: Type.UNSIGNED32,
    0x607C: Type.INTEGER32, 0x607F: Type.UNSIGNED32, 0x6080: Type.UNSIGNED32,
    0x6098: Type.INTEGER8, 0x609A: Type.UNSIGNED32, 0x60C5: Type.UNSIGNED32,
    0x6040: Type.UNSIGNED16, 0x6060: Type.INTEGER8, 0x607A: Type.INTEGER32,
    0x2100: Type.OCTET_STRING}
ENTRIES = {0x1016: (Type.UNSIGNED32,), 0x607D: (Type.INTEGER32, Type.INTEGER32),
           0x6099: (Type.UNSIGNED32, Type.UNSIGNED32), 0x60C2: (Type.UNSIGNED8, Type.INTEGER8)}
MEASURED = {0x6041: Type.UNSIGNED16, 0x6061: Type.INTEGER8, 0x6064: Type.INTEGER32,
            0x606C: Type.INTEGER32}


class ForeignDrive:
    """One drive on a bus of its own socket."""

    def __init__(self, bus: can.BusABC, node_id: int, position: int) -> None:
        self._bus = bus
        self.network = CANBusNetwork(bus)
        self.node = MinimalNode(self.network, node_id)
        self.objects = self.node.object_dictionary
        self.state, self._homing, self._before = OFF, 0, 0
        self._heard = self._synced = time.monotonic()
        for index, kind in OBJECTS.items():
            self.objects[index] = Variable(kind, 'rw')
        for index, kind in MEASURED.items():
            self.objects[index] = Variable(kind, 'ro')
        for index, kinds in ENTRIES.items():
            self.objects[index] = Record()
            for subindex, kind in enumerate(kinds, 1):
                self.objects[index][subindex] = Variable(kind, 'rw')
        for index, subindex, value in (
                (0x1000, 0, 402), (0x1008, 0, NAME), (0x1018, 1, 77), (0x6064, 0, position)):
            self.objects.write(index, subindex, value)
        self.objects.download_callbacks[0x6040, 0].add(self._control)
        self.node.sync.callbacks.add(self._on_sync)
        self.node.nmt.state_callbacks.add(lambda _: self._show())
        self.network.add_subscription(MASTER, self._on_master)
        self._show()

    def fail(self, code: int) -> None:
        """Report a fault, without power."""
        self.state = FAULT
        self.node.emcy.set(code, 1)
        self._show()

    def watch(self) -> None:
        """Look whether the master is alive."""
        bound = (self.objects.read(0x1016, 1) & 0xFFFF) / 1000.0
        if bound and self.state != FAULT and time.monotonic() - self._heard > bound:
            self.fail(LOST_HEARTBEAT)

    def close(self) -> None:
        """Leave the bus."""
        self.network.stop()
        self._bus.shutdown()

    def _on_master(self, *_: object) -> None:
        self._heard = time.monotonic()

    def _control(self, word: int) -> None:
        """Go where a controlword leads, by the table of CiA 402."""
        rising, self._before = word & ~self._before, word
        if self.state == FAULT:
            if rising & 0x80:
                self.state = OFF
                self.node.emcy.set(0, 0)
        elif not word & 0x02:
            self.state = OFF
        elif not word & 0x04:
            self.state = STOPPED if self.state in (ENABLED, STOPPED) else OFF
        elif self.state != STOPPED:
            self._go_up(word & 0x0F)
        homes = self.state == ENABLED and self.objects.read(0x6061, 0) == 6
        self._homing = max(self._homing, 1) if homes and word & 0x10 else 0
        self._show()

    def _go_up(self, word: int) -> None:
        order = {0x06: READY, 0x07: ON, 0x0F: ENABLED}
        states = [OFF, READY, ON, ENABLED]
        wanted, present = states.index(order.get(word, OFF)), states.index(self.state)
        self.state = states[min(wanted, present + 1)]

    def _on_sync(self) -> None:
        now = time.monotonic()
        elapsed, self._synced = now - self._synced, now
        read, position = self.objects.read, self.objects.read(0x6064, 0)
        target = position
        self.objects.write(0x6061, 0, read(0x6060, 0))
        if self.state == ENABLED and read(0x6061, 0) == 8:
            target = read(0x607A, 0)
        if self._homing:
            self._homing += 1
            self.objects.write(0x6064, 0, read(0x607C, 0))
        else:
            self.objects.write(0x6064, 0, target)
            self.objects.write(0x606C, 0, round((target - position) / max(elapsed, 1e-3)))
        self._show()

    def _show(self) -> None:
        word = self.state | 0x10 | 0x200
        if self.state == OFF:
            word &= ~0x10
        if self.objects.read(0x6061, 0) == 8 and self.state == ENABLED:
            word |= FOLLOWS
        if self._homing > 3:
            word |= TARGET_REACHED | FOLLOWS
        self.objects.write(0x6041, 0, word)


class ForeignDrives:
    """Three drives, and the thread of their timers."""

    def __init__(self, make_bus, positions: tuple[int, ...]) -> None:
        self._scheduler = SyncScheduler()
        # its own looks at the machine's clock where the time is simulated
        self._scheduler._sched = sched.scheduler(time.monotonic, time.sleep)
        set_scheduler(self._scheduler)
        self.drives = [
            ForeignDrive(make_bus(), number, position)
            for number, position in enumerate(positions, 1)]
        self._look()
        self._thread = threading.Thread(target=self._scheduler.run, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        for drive in self.drives:
            drive.watch()
        self._scheduler.add(LOOK_PERIOD, self._look)

    def stop(self) -> None:
        """End the timers, leave the bus."""
        self._look = lambda: None
        for drive in self.drives:
            drive.objects.write(0x1017, 0, 0)
        self._scheduler.stop()
        self._thread.join(5.0)
        for drive in self.drives:
            drive.close()
