"""
The CAN cycle: SYNC, three RPDO, what three drives answer; CPU of the master's threads.

The drives are threads of the same process, because python-can's virtual bus ends there; the
kernel counts the CPU of each thread, so they are not in the figures. The environment's BENCH_CAN
names another bus, such as `socketcan:vcan0`, BENCH_CAN_RATE another rate.

In user-mode Linux a call of the system costs 6 to 10 us, reading a clock included, and a tick of
10 ms counts the processor time: figures from there are about calls, and a rate in step with the
tick measures nothing.
"""

from __future__ import annotations

from collections import deque
import logging
import os
import threading
import time

import can

BUS = os.environ.get('BENCH_CAN', 'virtual:bench')
RATE = int(os.environ.get('BENCH_CAN_RATE', '500'))  # Hz
KERNEL_SYNC = BUS.startswith('socketcan')
MEASURED = {'quick': 0.8, 'full': 2.0}  # s
NODES = (1, 2, 3)
COMMAND, MODE, STATUSWORD = 0x0F, 8, 0x1237
SYNC, OPERATIONAL, HEARTBEAT_PERIOD = 0x80, 5, 0.05  # s
PATIENCE = 20.0


def cpu_of(thread: threading.Thread) -> float:
    """Return the processor time of one thread [s]."""
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


class Answers(threading.Thread):
    """
    Three drives that are as good as their targets, at next to no cost; beside every contender.

    They answer SYNC with TPDO1 each time, with TPDO2 and TPDO3 as often as drives do at a rate,
    and send heartbeats.
    """

    def __init__(self, bus: can.BusABC, rate: int = RATE) -> None:
        from facade_manipulator.drives.canopen import pdo
        from facade_manipulator.drives.controller.bus_load import transmission_type

        super().__init__(daemon=True)
        self._bus = bus
        self._status = pdo.TPDO1.codec.pack(STATUSWORD, MODE, 0)
        self._targets = {pdo.RPDO1.cob_id(n): pdo.TPDO1.cob_id(n) for n in NODES}
        self._frames = {
            pdo.heartbeat_cob_id(n): (round(HEARTBEAT_PERIOD * rate), bytes([OPERATIONAL]))
            for n in NODES}
        self._frames |= {
            one.cob_id(n): (transmission_type(one, rate), bytes(one.codec.size))
            for one in (pdo.TPDO2, pdo.TPDO3) for n in NODES}
        self.start()

    def run(self) -> None:
        count = 0
        while True:
            message = self._bus.recv(1.0)
            if message is None:
                continue
            cob_id = message.arbitration_id
            if cob_id == SYNC:
                count += 1
                self._answer(count)
            elif cob_id in self._targets:  # only the first one tells where the carriage is
                self._frames[self._targets[cob_id]] = (
                    1, self._status[:3] + bytes(message.data[3:]))

    def _answer(self, count: int) -> None:
        for cob_id, (every, data) in self._frames.items():
            if count % every == 0:
                self._bus.send(can.Message(
                    arbitration_id=cob_id, data=data, is_extended_id=False))


def bus() -> can.BusABC:
    interface, _, channel = BUS.partition(':')
    return can.Bus(interface=interface, channel=channel)


def keep_pace(cycle, period: float = 1.0 / RATE):
    """Call a cycle at its rate; as a thread."""
    def run():
        due = time.monotonic()
        while True:
            cycle()
            due += period
            time.sleep(max(0.0, due - time.monotonic()))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def per_cycle(threads, cycles=None, more=lambda: 0.0):
    """Return a function that measures the CPU of threads, and more, per cycle [s]."""
    def used():
        return sum(map(cpu_of, threads)) + more()

    def measure(speed: str) -> float:
        before, start = used(), cycles() if cycles else 0
        begin = time.monotonic()
        time.sleep(MEASURED[speed])
        elapsed = time.monotonic() - begin
        count = cycles() - start if cycles else elapsed * RATE
        return (used() - before) / count

    return measure


def canopen_cycle():
    """Serve the cycle as canopen's manual does: PDO objects, callbacks, transmit."""
    import canopen

    from facade_manipulator import config_path

    Answers(bus())
    network = canopen.Network(bus=bus())
    network.connect()
    pairs, seen = [], deque(maxlen=len(NODES))
    for number in NODES:
        node = network.add_node(number, str(config_path('drives/cia402.eds')))
        command, answers = map_pdos(node, number)
        pairs.append((command, answers))
        for answer in answers:
            answer.add_callback(lambda pdo: seen.append([item.raw for item in pdo.map]))

    def cycle():
        if not KERNEL_SYNC:
            network.sync.transmit()
        for command, _ in pairs:
            controlword, mode, target = command.map
            controlword.raw, mode.raw, target.raw = COMMAND, MODE, 1000
            command.transmit()

    if KERNEL_SYNC:
        network.sync.start(1.0 / RATE)
    thread = keep_pace(cycle)
    wait_for(seen)
    listening = [one for one in threading.enumerate() if 'notifier' in one.name.lower()]
    assert listening
    return per_cycle([thread, *listening]), None, []


def wait_for(seen: deque) -> None:
    """Wait until every drive has answered."""
    deadline = time.monotonic() + PATIENCE
    while len(seen) < len(NODES):
        if time.monotonic() > deadline:
            raise TimeoutError(f'{len(seen)} answers')
        time.sleep(0.05)


def map_pdos(node, number: int):
    """Map the PDOs of the driver: command; state, motion and condition."""
    def mapped(pdo, base, indices):
        pdo.clear()
        for index in indices:
            pdo.add_variable(index)
        pdo.cob_id, pdo.enabled = base + number, True
        return pdo

    command = mapped(node.rpdo[1], 0x200, (0x6040, 0x6060, 0x607A))
    answers = [mapped(node.tpdo[k], base, indices) for k, base, indices in (
        (1, 0x180, (0x6041, 0x6061, 0x6064)), (2, 0x280, (0x606C, 0x60F4)),
        (3, 0x380, (0x603F, 0x6077, 0x60FD)))]
    for answer in answers:
        answer.subscribe()
    return command, answers


def exchange():
    """The driver's bus and codecs alone, with nothing decided."""
    from facade_manipulator.drives.canopen import pdo
    from facade_manipulator.drives.canopen.bus import can_bus

    Answers(bus())
    ours = can_bus(bus())
    decoders = {base + n: decode for n in NODES for base, decode in (
        (0x180, pdo.TPDO1.codec.unpack), (0x280, pdo.TPDO2.codec.unpack),
        (0x380, pdo.TPDO3.codec.unpack), (0x700, bytes))}
    seen = deque(maxlen=len(NODES))
    ours.listen_to(tuple(decoders))
    if KERNEL_SYNC:
        ours.start_sync(1.0 / RATE)

    def run():
        due = time.monotonic()
        while True:
            if not KERNEL_SYNC:
                ours.send(pdo.SYNC_COB_ID)
            for n in NODES:
                ours.send(pdo.RPDO1.cob_id(n), pdo.RPDO1.codec.pack(COMMAND, MODE, 1000))
            due += 1.0 / RATE
            while (rest := due - time.monotonic()) > 0.0:
                frame = ours.receive(rest)
                if frame is not None:
                    seen.append(decoders[frame.cob_id](frame.data))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    wait_for(seen)
    return per_cycle([thread]), None, []


def driver_cycle():
    """
    The driver's whole cycle, active and following a stream: limits, guard, checks, record.

    What another thread pays for the snapshots that the node publishes counts as well.
    """
    driver = Driver()
    measure = per_cycle(
        [driver.thread], lambda: driver.controller.snapshot().cycle.cycles,
        lambda: driver.reader.spent)

    def while_following(speed: str) -> float:
        cost = measure(speed)
        driver.require_following()
        return cost

    return while_following, None, []


class Driver:
    """A driver that is active, three drives, and who else the node has in its process."""

    def __init__(self) -> None:
        from facade_manipulator.drives.cia402.settings import DEFAULT_AXES
        from facade_manipulator.drives.controller import BusAccess, ControllerSettings
        from facade_manipulator.kinematics import Geometry
        from facade_manipulator.lab.drives.drive import simulated_drives
        from facade_manipulator.lab.drives.simulator import DriveSimulator
        from facade_manipulator.loop import assemble, LoopSetup

        # an object that a drive is asked for while it boots is asked for again
        logging.getLogger('canopen').setLevel(logging.CRITICAL)
        settings = ControllerSettings(
            rate=RATE, boot_timeout=PATIENCE, max_missed_cycles=10,
            heartbeat_timeout=0.5)
        simulator = DriveSimulator(bus, simulated_drives(DEFAULT_AXES))
        simulator.start()
        self.follower, self.controller = assemble(
            LoopSetup(Geometry(), settings, DEFAULT_AXES), BusAccess(bus))
        self.reader = Reader(self.controller)
        for request in ('configure', 'home', 'activate'):
            self.controller.request(request).result(PATIENCE)
        Answers(bus())  # takes over from drives that cost as much as the driver
        simulator.stop()
        threading.Thread(target=stream, args=(self.follower,), daemon=True).start()
        time.sleep(0.3)
        self.thread = next(one for one in threading.enumerate() if one.name == 'drive control')

    def require_following(self) -> None:
        """Raise if the carriages have not moved, for whatever reason."""
        snapshot, activity = self.controller.snapshot(), self.follower.activity.value
        if snapshot.state.value != 'active' or activity == 'holding':
            raise RuntimeError(f'{snapshot.state}, {activity}: {snapshot.cause}')


class Reader(threading.Thread):
    """Ask for a snapshot 100 times a second, as the node does; count the time of it."""

    def __init__(self, controller) -> None:
        super().__init__(daemon=True)
        self.spent = 0.0
        self._controller = controller
        self.start()

    def run(self) -> None:
        while True:
            begin = time.thread_time()
            self._controller.snapshot()
            self.spent += time.thread_time() - begin
            time.sleep(0.01)


def stream(follower) -> None:
    """Setpoints at 100 Hz about the home position."""
    import math

    from facade_manipulator.motion.setpoints import Setpoint

    home, begin = (-0.1, 0.1, 0.0), time.time()
    while True:
        now = time.time()
        phase = 2.0 * (now - begin)
        shift, speed = 0.005 * (1.0 - math.cos(phase)), 0.01 * math.sin(phase)
        follower.add(Setpoint(
            now + 0.06, tuple(q + shift for q in home), (speed,) * 3), now)
        time.sleep(0.01)


MAKERS = {
    'cycle: driver': driver_cycle, 'cycle: bus and codecs': exchange,
    'cycle: canopen': canopen_cycle}
