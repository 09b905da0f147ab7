"""
The cyclic exchange: one thread owns the wire, and what it says comes when it is due.

No SYNC falls between the commands of two drives, and none comes late.
"""

from __future__ import annotations

from collections import deque

from bus_world import SETTINGS
from drive_faults import at_rest
from drive_parts import Source
from frames import decode_rpdo1
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import BusCongestedError, Frame
from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.states import Controlword
from facade_manipulator.drives.targets import MechanismChecks, TargetSupervisor

PERIOD = SETTINGS.period
RPDOS = tuple(pdo.RPDO1.cob_id(node) for node in (1, 2, 3))


def test_stop_is_sent_before_the_next_sync(rig):
    at_rest(rig)
    rig.frames()
    rig.controller.stop('enough')
    assert not rig.frames()
    rig.cycles(2)
    sent = [(frame.cob_id, frame.data) for frame in rig.frames()]
    stops = [cob_id == RPDOS[0] and data[0] == Controlword.QUICK_STOP for cob_id, data in sent]
    assert stops.index(True) < [cob_id for cob_id, _ in sent].index(pdo.SYNC_COB_ID)


class Wire:
    """A bus on which the kernel sends SYNC, with a clock that a test turns."""

    has_kernel_sync, is_virtual = True, False

    def __init__(self) -> None:
        self.now, self.heartbeats, self.is_full = 100.0, 0, False
        self.frames: deque[Frame] = deque()
        self.sent: list[tuple[float, int, bytes]] = []
        self.commands: list[tuple[NmtCommand, int]] = []

    def listen_to(self, cob_ids) -> None:
        """Take everything."""

    def start_sync(self, period) -> None:
        """Leave SYNC to the test."""

    def send(self, cob_id, data=b'') -> None:
        if self.is_full:
            raise BusCongestedError('the send queue is full')
        self.heartbeats += cob_id == pdo.heartbeat_cob_id(pdo.MASTER_NODE_ID)
        if cob_id in RPDOS:
            self.sent.append((self.now, cob_id, data))

    def command(self, command, node_id) -> None:
        self.commands.append((command, node_id))

    def receive(self, timeout):
        return self.frames.popleft() if self.frames else None

    def monotonic(self) -> float:
        return self.now

    time = monotonic


@pytest.fixture
def wire():
    return Wire()


def started_on(wire):
    """Start an exchange; return it and what hands it frames."""
    monitors = tuple(
        AxisMonitor(name, axis, SETTINGS) for name, axis in zip(
            AXIS_NAMES, DEFAULT_AXES, strict=True))
    exchange = CyclicExchange(
        wire, monitors, SETTINGS,
        TargetSupervisor(DEFAULT_AXES, SETTINGS, MechanismChecks(Source())), wire)
    exchange.start(Group(AXIS_NAMES, SETTINGS, wire.now), wire.now)

    def turn(*frames):
        wire.frames += [Frame(cob_id, data, wire.now, wire.now) for cob_id, data in frames]
        for _ in range(max(1, len(frames))):
            exchange.pump()
    return exchange, turn


@pytest.mark.parametrize('share', [0.05, 0.3, 0.79, 0.85, 0.95, 0.99])
@pytest.mark.parametrize('kind', ['emergency', 'request'])
def test_stop_shortly_before_sync_waits_for_it(wire, share, kind):
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
def test_late_answers_delay_no_sync(wire, late):
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
def test_late_answers_leave_no_position_older(wire, has_kernel_sync):
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


# --- what is supervised and said, cycle after cycle

def cycle(wire, exchange, turn, nodes, step=0.1):
    """Let the kernel's SYNC come, some nodes answer, and the step when its share has passed."""
    sync = wire.now = max(exchange.clock.next_event, exchange.clock.sync_time + PERIOD)
    turn((pdo.SYNC_COB_ID, b''), *answers_of(*nodes[:-1]))
    wire.now = sync + step * PERIOD
    turn(*answers_of(*nodes[-1:]))
    wire.now = max(wire.now, exchange.clock.next_event if exchange.clock.is_open else 0.0)
    turn()


@pytest.mark.parametrize(('answering', 'is_virtual', 'says', 'remedy'), [
    ((1, 2, 3), False, (), None), ((1, 3), False, ('q2',), Remedy.CONFIGURE),
    ((2,), False, ('q1', 'q3'), Remedy.CONFIGURE),
    ((), False, ('no drive answers any more: q1 (node 1) did not answer',), Remedy.BUS),
    ((), True, ('no drive answers any more: q1 (node 1) did not answer',), Remedy.COMPUTER)])
def test_silent_drives_are_named_or_blamed_on_bus(
        wire, answering, is_virtual, says, remedy):
    wire.is_virtual = is_virtual
    exchange, turn = started_on(wire)
    for _ in range(SETTINGS.max_missed_cycles + 2):
        cycle(wire, exchange, turn, answering)
    causes = exchange.group.causes
    assert len(causes) == len(says)
    for cause, words in zip(causes, says, strict=True):
        assert cause.message.startswith(words) and cause.remedy == remedy


def test_drive_ignoring_quick_stop_gets_nmt_stop_once(wire):
    exchange, turn = started_on(wire)
    taken = []
    for name, node in (('q2', 2), ('q3', 3)):
        exchange.group.not_responding.add(name)
        taken.append((NmtCommand.STOP, node))
        for _ in range(2):
            cycle(wire, exchange, turn, (1, 2, 3))
            assert wire.commands == taken
