"""
The cyclic exchange: one thread owns the wire, and what it says comes when it is due.

No SYNC falls between the commands of two drives, and none comes late.
"""

from __future__ import annotations

from collections import deque
from types import SimpleNamespace

from drive_faults import at_rest
from drive_rig import SETTINGS, Source
from frames import decode_rpdo1
import pytest

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.bus import BusCongestedError, Frame
from facade_manipulator.canopen.nmt import NmtCommand
from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.exchange import CyclicExchange, MAX_UNSENT
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.states import Controlword
from facade_manipulator.drives.targets import MechanismChecks, TargetSupervisor

PERIOD = SETTINGS.period
RPDOS = tuple(pdo.RPDO1.cob_id(node) for node in (1, 2, 3))


def test_stop_is_sent_by_the_control_thread_before_the_next_sync(rig):
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
def test_drives_that_are_silent_are_named_and_all_of_them_are_bus_or_computer(
        wire, answering, is_virtual, says, remedy):
    wire.is_virtual = is_virtual
    exchange, turn = started_on(wire)
    for _ in range(SETTINGS.max_missed_cycles + 2):
        cycle(wire, exchange, turn, answering)
    causes = exchange.group.causes
    assert len(causes) == len(says)
    for cause, words in zip(causes, says, strict=True):
        assert cause.message.startswith(words) and cause.remedy == remedy


@pytest.mark.parametrize(('pause', 'says'), [(0.45, ''), (
    0.6, 'the control loop stood still for 600 ms, bound 500 ms')])
def test_who_has_not_run_for_a_while_blames_no_drive(wire, pause, says):
    exchange, turn = started_on(wire)
    wire.now += pause
    turn()
    assert exchange.group.reason == says
    assert not says or exchange.group.cause.remedy == Remedy.COMPUTER


def test_the_masters_heartbeat_comes_once_a_period(wire):
    exchange, turn = started_on(wire)
    exchange.transmits = True
    for _ in range(1000):
        wire.now += 0.001
        turn()
    assert wire.heartbeats == pytest.approx(1.0 / SETTINGS.heartbeat_period, abs=1)
    exchange.transmits = False
    wire.now += 1.0
    turn()
    assert wire.heartbeats == pytest.approx(1.0 / SETTINGS.heartbeat_period, abs=1)


def test_a_queue_that_stays_full_for_two_cycles_is_an_error(wire):
    exchange, turn = started_on(wire)
    exchange.transmits, exchange.group = True, None  # so that nothing but heartbeats is sent
    for is_full in [*[True] * (MAX_UNSENT - 1), False] * 3 + [True] * 7:
        wire.is_full = is_full
        wire.now += SETTINGS.heartbeat_period
        turn()
    wire.now += SETTINGS.heartbeat_period
    with pytest.raises(BusCongestedError):
        turn()


def test_a_drive_that_goes_on_in_spite_of_a_quick_stop_is_taken_out_of_operation_once(wire):
    exchange, turn = started_on(wire)
    taken = []
    for name, node in (('q2', 2), ('q3', 3)):
        exchange.group.not_responding.add(name)
        taken.append((NmtCommand.STOP, node))
        for _ in range(2):
            cycle(wire, exchange, turn, (1, 2, 3))
            assert wire.commands == taken


@pytest.fixture
def stepped(wire, monkeypatch):
    """Return what lets a group in a state step, and says what it was told and what was sent."""
    def step(state, is_ramped=True, share=0.1):
        exchange, turn = started_on(wire)
        exchange._targets = SimpleNamespace(
            at_rest=is_ramped, counts=(0, 0, 0), supervise=lambda *_: None,
            command=lambda group, commands, *_: commands)
        told, group = [], exchange.group
        group.state, group.step = state, lambda *now: (told.append(now[0]), group.commands)[1]
        cycle(wire, exchange, turn, (1, 2, 3), share)
        turn((pdo.SYNC_COB_ID, b''))
        return [one.at_rest for one in told[0]], len(wire.sent)
    return step


@pytest.mark.parametrize(('state', 'is_ramped', 'at_rest'), [
    (ControllerState.RAMPING, True, True), (ControllerState.RAMPING, False, False),
    (ControllerState.STOPPING, False, True)])
def test_carriages_are_not_at_rest_before_the_targets_of_a_ramp_are(
        stepped, state, is_ramped, at_rest):
    assert stepped(state, is_ramped)[0] == [at_rest] * 3


@pytest.mark.parametrize(('state', 'share', 'sent'), [
    (ControllerState.ACTIVE, 0.1, 3), (ControllerState.ACTIVE, 0.9, 0),
    (ControllerState.STOPPING, 0.9, 3)])
def test_only_a_stop_is_worth_sending_late(stepped, state, share, sent):
    assert stepped(state, share=share)[1] == sent
