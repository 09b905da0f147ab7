"""Node's side of the control loop, with a loop whose messages the test sends."""

from contextlib import suppress
import socket
import subprocess
import time
from unittest.mock import call, Mock

from control_loop.loop_bench import loop_setup
import pytest

from facade_manipulator.control_loop import process as process_module
from facade_manipulator.control_loop.channel import Channel, ChannelClosedError, StreamStatus
from facade_manipulator.control_loop.process import CLOSE_TIMEOUT, LoopClient
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    Cause,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.errors import DriveError, ManipulatorError, ParameterError
from facade_manipulator.motion.setpoints import Setpoint

STATUS = StreamStatus('following', 1)
STILL = (0.0,) * 3


def state(number=0, kind=ControllerState.INACTIVE):
    """Return the state that a loop sends in a cycle."""
    axes = AxisSnapshot('q1', 1, 0x0027, velocity=-0.2, homed=True), AxisSnapshot('q2', 2)
    return ControllerSnapshot(kind, float(number), axes, (Cause('first', 'wait'),)), STATUS


STILL_RUNS = {'wait.side_effect': subprocess.TimeoutExpired('loop', 1.0)}
READY = 'state', *state()


class Peer:
    """Loop's end of the channel, and a replacement of its process."""

    def __init__(self, first=READY, **wait):
        self.first, self.process = first, Mock(**{'wait.return_value': 0} | wait)
        self.node = LoopClient(loop_setup(), Mock(), self.launch)
        assert self.taken()[0][0] == 'setup'

    def launch(self, end):
        self.channel = Channel(end.dup())
        if self.first:
            self.channel.send(*self.first)
        else:
            self.channel._socket.shutdown(socket.SHUT_WR)
        return self.process

    def taken(self):
        """Return the messages of the node since the previous call."""
        taken = []
        with suppress(ChannelClosedError):
            while message := self.channel.receive(0.0):
                taken.append((message[0], *message[1]))
        return taken


def test_states_are_taken_once_and_the_newest_kept():
    peer = Peer()
    for numbers in (range(1, 3), range(3, 3), range(3, 8)):
        for number in numbers:
            peer.channel.send('state', *state(number))
        assert [one.stamp for one in peer.node.take_states()] == [*numbers]
    assert (peer.node.snapshot(), peer.node.stream_status()) == state(7)


@pytest.mark.parametrize('kind, bound', [  # 3 s and 30 s of feeds
    (ControllerState.ACTIVE, 60), (ControllerState.UNCONFIGURED, 600),
    (ControllerState.BUS_LOST, 600)])
def test_silent_loop_is_ended_after_many_feeds(kind, bound):
    peer = Peer(('state', *state(1, kind)))
    job = peer.node.request('halt')
    for number in range(2 * bound):
        if number == bound:
            peer.channel.send('state', *state(1, kind))
        peer.node.feed()
        peer.taken()
    assert not peer.process.kill.called and not peer.node.is_lost
    peer.node.feed()
    peer.node.feed()
    peer.process.kill.assert_called_once_with()
    assert peer.process.wait.called  # so that no zombie stays
    assert peer.node.is_lost and job.done()
    lost = peer.node.snapshot()
    assert lost.state is ControllerState.LOST and lost.unhomed == ('q1', 'q2')
    assert f'fed {bound + 1} times, bound {bound}, and was ended; the drives stop' in lost.cause
    assert 'then configure' in lost.next_step


@pytest.mark.parametrize('wait, shown', [
    ({'wait.return_value': -9}, '-9'), (STILL_RUNS, 'unknown')])
def test_ended_loop_is_lost_and_rejects_requests(wait, shown):
    peer = Peer(**wait)
    before = peer.node.request('halt')
    peer.channel.close()
    assert not peer.node.is_lost
    peer.node.feed()
    assert peer.node.is_lost
    assert f'has ended by itself, exit status {shown}; the drives stop' in (
        peer.node.snapshot().cause)
    for job in (before, peer.node.request('activate')):
        with pytest.raises(DriveError, match='ended by itself'):
            job.result(0.0)


def test_forbidden_power_reaches_the_next_loop():
    peer = Peer()
    for cause in ('stop', 'stop', '', 'again'):
        peer.node.forbid_power(cause)
    assert peer.taken() == [('forbid', 'stop'), ('forbid', ''), ('forbid', 'again')]
    peer.node.start()
    assert [one[0] for one in peer.taken()] == ['setup', 'forbid']


def test_full_channel_drops_setpoints_but_not_stops():
    peer, sent = Peer(), 0
    while peer.node._channel.send('setpoint', float(sent), STILL, STILL):
        sent += 1
    peer.node.stop('enough')
    peer.node.forbid_power('no more')
    peer.node.change(limits=loop_setup().limits)
    peer.node.request('halt')
    peer.node.apply_forces([1.0, 2.0, 3.0])
    taken = peer.taken()
    peer.node.send_setpoint(Setpoint(-1.0, STILL, STILL))
    *urgent, newest = peer.taken()
    assert [one[1] for one in (*taken, newest)] == [*range(sent), -1.0]
    assert [one[0] for one in urgent] == ['stop', 'forbid', 'limits', 'request']


@pytest.mark.parametrize('first, error, message', [
    (('failed', 'q1 = q2'), ParameterError, 'q1 = q2'),
    (('other', *state()), ManipulatorError, 'did not start'),
    ((), ManipulatorError, 'did not start')])
def test_loop_that_does_not_start_is_ended(first, error, message):
    kill = Mock()
    with pytest.raises(error, match=message):
        Peer(first, kill=kill)
    kill.assert_called_once_with()


def assert_closed(peer):
    snapshot = peer.node.snapshot()
    assert (snapshot.state, snapshot.causes, snapshot.next_step) == (
        ControllerState.CLOSED, (), '') and not peer.node.is_lost


def test_close_returns_the_last_answer_of_the_loop():
    peer = Peer()
    peer.channel.send('reply', 0, True, 'power: confirmed off')
    assert peer.node.close() == peer.node.close() == 'power: confirmed off'
    assert [message[0] for message in peer.taken()] == ['request', 'feed', 'close']
    (timeout,), = peer.process.wait.call_args_list[0][:1]
    assert not peer.process.kill.called and timeout == pytest.approx(CLOSE_TIMEOUT, abs=1.0)
    assert_closed(peer)


def test_close_feeds_the_loop_and_times_out(monkeypatch):
    monkeypatch.setattr(process_module, 'CLOSE_TIMEOUT', 0.2)
    peer, begin = Peer(**STILL_RUNS), time.monotonic()
    with pytest.raises(DriveError, match='has not confirmed that the power'):
        peer.node.close()
    assert time.monotonic() - begin >= 0.2 + loop_setup().extra_time
    first, *feeds, last = [message[0] for message in peer.taken()]
    assert (first, {*feeds}, last) == ('request', {'feed'}, 'close') and len(feeds) > 3
    assert peer.process.wait.call_args_list[0] == call(0.0)
    peer.process.kill.assert_called_once_with()
    assert_closed(peer)
