"""One thread owns the wire, no SYNC falls between the commands of two drives, none comes late."""

from __future__ import annotations

from collections import deque
import threading

from drive_rig import at_rest, SETTINGS, Source
from frames import decode_rpdo1
import pytest

from facade_manipulator.drives.canopen import pdo
from facade_manipulator.drives.canopen.bus import Frame
from facade_manipulator.drives.cia402 import Cause, Group
from facade_manipulator.drives.cia402.settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.cia402.states import Controlword
from facade_manipulator.drives.controller import exchange as module
from facade_manipulator.drives.controller.exchange import CyclicExchange
from facade_manipulator.drives.controller.monitor import AxisMonitor
from facade_manipulator.drives.controller.targets import MechanismChecks, Targets

PERIOD = SETTINGS.period
RPDOS = tuple(pdo.RPDO1.cob_id(node) for node in (1, 2, 3))


def test_commands_come_from_the_control_thread_alone_whoever_stops(rig):
    at_rest(rig)
    senders, send = set(), rig.buses[-1].send

    def note(message, timeout=None):
        if message.arbitration_id in RPDOS:
            senders.add(threading.current_thread().name)
        send(message, timeout)

    rig.buses[-1].send = note
    stoppers = [threading.Thread(target=rig.controller.stop, args=('enough',)) for _ in range(20)]
    for thread in stoppers:
        thread.start()
    for thread in stoppers:
        thread.join()
    rig.until_stopped()
    assert senders == {'drive control'}


class Wire:
    """A bus on which the kernel sends SYNC, with a clock that a test turns."""

    has_kernel_sync = True

    def __init__(self) -> None:
        self.now = 100.0
        self.frames: deque[Frame] = deque()
        self.sent: list[tuple[float, int, bytes]] = []

    def listen_to(self, cob_ids) -> None:
        """Take everything."""

    def start_sync(self, period) -> None:
        """Leave SYNC to the test."""

    def send(self, cob_id, data=b'') -> None:
        if cob_id in RPDOS:
            self.sent.append((self.now, cob_id, data))

    def receive(self, timeout):
        return self.frames.popleft() if self.frames else None

    def monotonic(self) -> float:
        return self.now

    time = monotonic


@pytest.fixture
def wire(monkeypatch):
    made = Wire()
    monkeypatch.setattr(module, 'time', made)
    return made


def started_on(wire):
    """Start an exchange; return it and what hands it frames."""
    monitors = tuple(
        AxisMonitor(name, axis, SETTINGS) for name, axis in zip(
            AXIS_NAMES, DEFAULT_AXES, strict=True))
    exchange = CyclicExchange(
        wire, monitors, SETTINGS, Targets(DEFAULT_AXES, SETTINGS, MechanismChecks(Source())))
    exchange.start(Group(AXIS_NAMES, SETTINGS, wire.now), wire.now)

    def turn(*frames):
        wire.frames += [Frame(cob_id, data, wire.now, wire.now) for cob_id, data in frames]
        for _ in range(max(1, len(frames))):
            exchange.pump()
    return exchange, turn


@pytest.mark.parametrize('share', [0.05, 0.3, 0.79, 0.85, 0.95, 0.99])
@pytest.mark.parametrize('kind', ['emergency', 'request'])
def test_a_stop_shortly_before_a_sync_waits_for_it(wire, share, kind):
    """Else one drive might latch it now and its neighbour a period later, at full speed."""
    exchange, turn = started_on(wire)
    turn((pdo.SYNC_COB_ID, b''))
    sync = wire.now
    wire.now += 0.02 * PERIOD
    for node in (1, 2, 3):
        turn((pdo.TPDO1.cob_id(node), bytes(7)))
    wire.sent.clear()
    wire.now = sync + share * PERIOD
    if kind == 'emergency':
        turn((0x081, b'\x10\x23' + bytes(6)))
    else:
        exchange.stops.append(Cause('enough'))
        turn()
    wire.now = sync + PERIOD
    turn((pdo.SYNC_COB_ID, b''))
    turn()
    stops = [moment - sync for moment, _, data in wire.sent
             if decode_rpdo1(data).controlword == Controlword.QUICK_STOP]
    assert len(stops) >= 3
    assert len({*stops[:3]}) == 1
    assert stops[0] <= 0.8 * PERIOD or stops[0] >= PERIOD


def answers_of(*nodes) -> list[tuple[int, bytes]]:
    return [(one.cob_id(node), bytes(one.codec.size))
            for node in nodes for one in (pdo.TPDO1, pdo.TPDO2)]


@pytest.mark.parametrize('late', [1, 3])
def test_drives_that_answer_after_the_step_and_again_in_time_delay_no_sync(wire, late):
    """Where the others are silent, waiting for them would let silence be found later."""
    wire.has_kernel_sync = False
    exchange, turn = started_on(wire)
    clock, answers = exchange.clock, answers_of(*range(1, 1 + late))
    turn()
    wire.now = clock.next_event
    turn()
    assert clock.statistics.incomplete == 1
    turn(*answers)
    wire.now = clock.next_event
    turn()
    assert clock.is_open
    wire.now += 0.1 * PERIOD
    turn(*answers[:2])
    assert clock.next_event <= clock.sync_time + 1.01 * PERIOD
    assert clock.statistics.cycles == 1
    turn(*answers[2:])
    assert clock.statistics.cycles == 1 + (late == 3)


@pytest.mark.parametrize('has_kernel_sync', [False, True])
def test_answers_after_the_step_leave_no_position_older_than_the_others(wire, has_kernel_sync):
    """Else one late cycle would leave two drives a period behind until one misses an answer."""
    wire.has_kernel_sync = has_kernel_sync
    exchange, turn = started_on(wire)
    clock = exchange.clock

    def next_sync():
        wire.now = max(clock.next_event, clock.sync_time + PERIOD)
        turn(*[(pdo.SYNC_COB_ID, b'')] * has_kernel_sync)
        assert clock.is_open

    next_sync()
    wire.now = clock.next_event
    turn()
    wire.now += 0.05 * PERIOD
    turn(*answers_of(1, 2, 3))
    for cycles in range(1, 4):
        next_sync()
        wire.now += 0.1 * PERIOD
        turn(*answers_of(1, 2))
        assert clock.statistics.cycles == cycles
        turn(*answers_of(3))
        assert clock.statistics.cycles == cycles + 1


def test_after_a_stall_all_that_came_in_time_is_read_before_the_step(wire):
    wire.has_kernel_sync = False
    exchange, turn = started_on(wire)
    turn()
    sent = wire.now
    frames = [(0x701, b'\x05'), *answers_of(1, 2, 3)]
    wire.frames += [Frame(*one, sent + 0.1 * PERIOD, sent + 0.1 * PERIOD) for one in frames]
    wire.now += 4.0 * PERIOD
    for _ in frames:
        turn()
    assert exchange.clock.statistics.cycles == 1
    assert exchange.clock.statistics.incomplete == 0
