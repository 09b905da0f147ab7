"""The node's side of the control loop, and the loop's `main`, each beside one sent by hand."""

from __future__ import annotations

from dataclasses import replace
import logging
import signal
import socket
import subprocess
import sys
from types import SimpleNamespace

from hypothesis import given
from hypothesis import strategies as st
from loop_bench import loop_setup
import pytest

from facade_manipulator.canopen.bus import BusStatistics, Condition
from facade_manipulator.control_loop import __main__ as main
from facade_manipulator.control_loop import process as process_module
from facade_manipulator.control_loop.channel import Channel, ChannelClosedError
from facade_manipulator.control_loop.control_loop import StreamStatus
from facade_manipulator.control_loop.process import (
    CLOSE_TIMEOUT,
    LoopClient,
    MAX_UNANSWERED,
    MAX_UNANSWERED_WITHOUT_BUS,
)
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.cycle import CycleStatistics
from facade_manipulator.drives.snapshot import AxisSnapshot, ControllerSnapshot, ControllerState
from facade_manipulator.errors import DriveError, ManipulatorError, ParameterError
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.resources import import_path

AXES = (AxisSnapshot('q1', 1, 0x0027, velocity=-0.2, homed=True),
        AxisSnapshot('q2', 2, homed=True))
NEWEST = ControllerSnapshot(
    ControllerState.INACTIVE, 0.0, AXES, causes=(Cause('first', 'clear the faults'),),
    notes=('a note',), bus_load=0.1, bus=BusStatistics(7, condition=Condition.PASSIVE),
    cycle=CycleStatistics(3, worst=0.01))
STATUS = StreamStatus('following', margins=(0.01, 0.02))


def state(number=0, kind=ControllerState.INACTIVE):
    """Return what a loop says of a cycle."""
    return NEWEST._replace(state=kind, stamp=float(number)), STATUS


FIRST = state()


class Peer:
    """The loop's end of the channel, and what stands for its process."""

    def __init__(self, first=('ready', *FIRST), status=0, **details):
        self.first, self.status, self.kills = first, status, 0
        self.rejections, self.waited = [], []
        self.node = LoopClient(
            loop_setup(), lambda *one: self.rejections.append(one), self.launch, **details)
        assert self.take()[0] == 'setup'

    def launch(self, end):
        self.channel = Channel(end.dup())
        if self.first:
            self.channel.send(*self.first)
        else:
            self.channel._socket.shutdown(socket.SHUT_WR)
        return self

    def wait(self, timeout):
        self.waited.append(timeout)
        if self.status is None:
            raise subprocess.TimeoutExpired('loop', timeout)
        return self.status

    def kill(self):
        self.kills += 1

    def take(self):
        try:
            message = self.channel.receive(0.0)
        except ChannelClosedError:
            return None
        return message and (message.kind, *message.content)

    def taken(self):
        return list(iter(self.take, None))


@given(st.lists(st.integers(0, 7), max_size=12), st.integers(1, 4))
def test_states_are_taken_once_and_the_newest_kept(batches, every):
    peer, sent, taken = Peer(), 0, []
    for count in batches:
        for _ in range(count):
            sent += 1
            peer.channel.send('state', *state(sent))
        taken += [one.stamp for one in peer.node.take_states(every)]
        found = peer.node.snapshot()
        assert (found, peer.node.stream_status()) == (NEWEST._replace(stamp=float(sent)), STATUS)
        assert [type(part) for part in (*found.axes, found.cycle, found.bus.condition)] == [
            AxisSnapshot, AxisSnapshot, CycleStatistics, Condition]
    assert taken == [float(number) for number in range(every, sent + 1, every)]


def test_replies_and_rejections_reach_the_caller():
    peer = Peer()
    jobs = [peer.node.request(name) for name in ('configure', 'home')]
    asked = peer.taken()
    assert [(kind, name) for kind, _, name in asked] == [
        ('request', 'configure'), ('request', 'home')]
    (_, first, _), (_, second, _) = asked
    peer.channel.send('reply', second, False, 'q2 is silent')
    peer.channel.send('rejected', 'stale', 'too old')
    peer.channel.send('nonsense')
    peer.node.read()
    assert not jobs[0].done() and peer.rejections == [('stale', 'too old')]
    with pytest.raises(DriveError, match='q2 is silent'):
        jobs[1].result(0.0)
    peer.channel.send('reply', first, True, 'configured')
    peer.node.read()
    assert jobs[0].result(0.0) == 'configured'


@pytest.mark.parametrize('kind, bound', [
    (ControllerState.INACTIVE, MAX_UNANSWERED), (ControllerState.ACTIVE, MAX_UNANSWERED),
    (ControllerState.UNCONFIGURED, MAX_UNANSWERED_WITHOUT_BUS),
    (ControllerState.BUS_LOST, MAX_UNANSWERED_WITHOUT_BUS)])
def test_silent_loop_is_ended_after_many_feeds(kind, bound):
    assert (MAX_UNANSWERED, MAX_UNANSWERED_WITHOUT_BUS) == (150, 1500)  # 3 s and 30 s of feeds
    peer = Peer(('ready', *state(1, kind)))
    job = peer.node.request('halt')
    for answer in (state(1, kind), None):  # the second time nothing comes any more
        for _ in range(bound):
            peer.node.feed()
            peer.taken()
        assert not peer.kills and not peer.node.is_lost
        if answer:
            peer.channel.send('state', *answer)
    peer.node.feed()
    assert peer.kills == 1 and peer.node.is_lost and job.done()
    lost = peer.node.snapshot()
    assert lost.state is ControllerState.LOST and lost.unhomed == ('q1', 'q2')
    assert f'fed {bound + 1} times, bound {bound}, and was ended; the drives stop' in lost.cause
    assert 'then configure' in lost.next_step
    peer.node.feed()
    assert peer.kills == 1


@pytest.mark.parametrize('status, said', [(-9, '-9'), (None, 'unknown')])
def test_ended_loop_is_lost_and_answers_nothing(status, said):
    peer = Peer(status=status)
    before = peer.node.request('halt')
    peer.channel.close()
    assert not peer.node.is_lost
    peer.node.feed()
    assert peer.node.is_lost
    cause = peer.node.snapshot().cause
    assert f'has ended by itself, exit status {said}; the drives stop' in cause
    for job in (before, peer.node.request('activate')):
        with pytest.raises(DriveError, match='ended by itself'):
            job.result(0.0)
    peer.node.start()
    assert peer.node.snapshot().state is ControllerState.INACTIVE and not peer.node.is_lost


def test_forbidden_power_reaches_the_next_loop():
    peer = Peer()
    for cause in ('stop', 'stop', '', 'again'):
        peer.node.forbid_power(cause)
    assert peer.taken() == [('forbid', 'stop'), ('forbid', ''), ('forbid', 'again')]
    peer.node.start()
    assert [one[0] for one in peer.taken()] == ['setup', 'forbid']


def test_full_channel_drops_setpoints_but_not_stops():
    peer, sent = Peer(), 0
    while peer.node._channel.send('setpoint', float(sent), (0.0,) * 3, (0.0,) * 3):
        sent += 1
    peer.node.stop('enough')
    peer.node.forbid_power('no more')
    peer.node.change(limits=loop_setup().limits)
    peer.node.request('halt')
    peer.node.disturb(1, 'inject_fault', 0x8611)
    peer.node.apply_forces([1.0, 2.0, 3.0])
    taken = peer.taken()
    peer.node.send_setpoint(Setpoint(-1.0, (0.0,) * 3, (0.0,) * 3))
    *urgent, newest = peer.taken()
    assert [one[1] for one in (*taken, newest)] == [*range(sent), -1.0]
    assert [one[0] for one in urgent] == ['stop', 'forbid', 'limits', 'request', 'disturb']


@pytest.mark.parametrize('first, error, message', [
    (('failed', 'q1 = q2'), ParameterError, 'q1 = q2'),
    (('other', *state()), ManipulatorError, 'did not start'),
    ((), ManipulatorError, 'did not start'),
])
def test_loop_that_does_not_start_is_ended(first, error, message, monkeypatch):
    killed = []
    monkeypatch.setattr(Peer, 'kill', lambda peer: killed.append(peer.channel))
    with pytest.raises(error, match=message):
        Peer(first)
    assert len(killed) == 1


def assert_closed(peer):
    snapshot = peer.node.snapshot()
    assert (snapshot.state, snapshot.causes, snapshot.next_step) == (
        ControllerState.CLOSED, (), '') and not peer.node.is_lost


def test_close_returns_the_last_answer_of_the_loop():
    peer = Peer()
    peer.channel.send('reply', 0, True, 'power: confirmed off')
    assert peer.node.close() == peer.node.close() == 'power: confirmed off'
    assert [message[0] for message in peer.taken()] == ['request', 'feed', 'close']
    assert peer.kills == 0 and peer.waited[0] == pytest.approx(CLOSE_TIMEOUT, abs=1.0)
    assert_closed(peer)


def test_close_feeds_the_loop_and_times_out(monkeypatch):
    monkeypatch.setattr(process_module, 'MAX_UNANSWERED', 10_000)
    now, pauses = [100.0], []

    def sleep(seconds):
        now[0] += seconds
        pauses.append(peer.taken())

    monkeypatch.setattr(process_module, 'time', SimpleNamespace(monotonic=lambda: now[0],
                                                                sleep=sleep))
    peer = Peer(status=None)
    with pytest.raises(DriveError, match='has not said that the power'):
        peer.node.close()
    bound = CLOSE_TIMEOUT + loop_setup().extra_time
    assert peer.kills == 1 and bound <= now[0] - 100.0 < bound + 0.1
    assert peer.waited[0] == 0.0  # it has had its time
    assert all(taken for taken in pauses)
    assert_closed(peer)


# --- the loop's process

def test_loop_process_inherits_its_end_and_no_signals(monkeypatch):
    monkeypatch.setattr(subprocess, 'Popen', lambda *command, **options: (command, options))
    end = SimpleNamespace(fileno=lambda: 7)
    (command,), options = process_module.start_process(end)
    assert command[:3] == [sys.executable, '-I', '-c'] and options['pass_fds'] == (7,)
    assert command[4:] == ['7', *import_path()]
    assert options['start_new_session'] and options['stdin'] == subprocess.DEVNULL


@pytest.fixture
def signals(monkeypatch):
    """Let `main` leave signals and logs of the tests alone; return what it asks of the former."""
    asked = []
    for name in ('signal', 'alarm'):
        monkeypatch.setattr(signal, name, lambda *details: asked.append(details))
    monkeypatch.setattr(logging, 'getLogger', lambda *_: logging.Logger('of its own'))
    return asked


@pytest.fixture
def ends(signals):
    """Return the node's end, and the number of the loop's, which `main` closes."""
    made = process_module.socket_pair()
    yield Channel(made[0]), made[1].detach()
    made[0].close()


def test_contradictory_setup_is_answered(ends):
    setup = loop_setup()
    ends[0].send('setup', replace(setup, axes=(setup.axes[0], *setup.axes[:2])))
    assert main.main(ends[1]) == 1
    answer = ends[0].receive(0.0)
    assert answer.kind == 'failed' and 'two axes have the same node_id' in answer.content[0]


def test_loop_ignores_terminal_signals_and_sets_an_alarm(ends, signals):
    ends[0].send('setup', loop_setup())
    ends[0].send('close')
    assert main.main(ends[1]) == 0
    ready = ends[0].receive(0.0)
    assert ready.kind == 'ready'
    *handled, (alarm,) = signals
    assert {number for number, how in handled if how is signal.SIG_IGN} == {
        signal.SIGINT, signal.SIGHUP}
    assert handled[-1][0] == signal.SIGTERM
    assert 0.0 <= alarm - main.END_TIMEOUT - loop_setup().extra_time < 1.0
