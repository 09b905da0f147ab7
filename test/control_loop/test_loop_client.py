"""Node's side of the control loop, with a loop whose messages the test sends."""

from contextlib import suppress
from dataclasses import replace
import signal
import socket
import subprocess
import time
from unittest.mock import call, Mock

from control_loop.loop_rig import ask, SETUP, waiting_messages
import pytest

from facade_manipulator.control_loop import loop_client as process_module
from facade_manipulator.control_loop.loop_channel import Channel
from facade_manipulator.control_loop.loop_client import CLOSE_TIMEOUT, LoopClient
from facade_manipulator.drives import snapshot as snapshots
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import DriveError, ManipulatorError, ParameterError
from facade_manipulator.motion.follower import StreamStatus
from facade_manipulator.motion.setpoints import Setpoint

HOMED = snapshots.AxisSnapshot('q1', 1, 0x0027, velocity=-0.2, homed=True)
AXES = (HOMED, snapshots.AxisSnapshot('q2', 2))
STILL = (0.0,) * 3
MORE_THAN_FIT = 5000  # setpoints in a channel
# a process that hangs
RUNS = {'wait.side_effect': subprocess.TimeoutExpired('loop', 1.0)}
# the last so that no zombie stays
KILLED = [
    call.wait(0.0),
    call.kill(),
    call.wait(1.0),
]


def state(number=0, kind=ControllerState.INACTIVE):
    """Return the message that a loop sends in a cycle."""
    causes = (snapshots.Cause('first', 'wait'),)
    snapshot = snapshots.ControllerSnapshot(kind, float(number), AXES, causes)
    return 'state', snapshot, StreamStatus('following', 1)


READY = state()


class Peer:
    """Loop's end of the channel, and a replacement of its process."""

    def __init__(self, first=READY, setup=SETUP, **wait):
        self.first = first
        self.process = Mock(**{'wait.return_value': 0} | wait)
        self.node = LoopClient(setup, Mock(), self.launch)
        assert self.taken()[0][0] == 'setup'

    def launch(self, *ends):
        self.channel = Channel(*(end.dup() for end in ends))
        if self.first:
            kind, *content = self.first
            self.channel.send('started' if kind == 'state' else kind, *content)
        else:
            ends[0].shutdown(socket.SHUT_WR)
        return self.process

    def taken(self):
        """Return the messages of the node since the previous call."""
        taken = []
        with suppress(ConnectionError):
            for kind, content in waiting_messages(self.channel):
                taken.append((kind, *content))
        return taken


def test_states_are_taken_once_and_the_newest_kept():
    peer = Peer()
    for numbers in ((1, 2), (), (3, 4, 5)):
        for number in numbers:
            peer.channel.send(*state(number))
        assert tuple(one.stamp for one in peer.node.take_states()) == numbers
    assert ('state', peer.node.snapshot(), peer.node.stream_status()) == state(5)


@pytest.mark.parametrize(
    'kind, bound',
    [  # 3 s and 30 s of feeds
        (ControllerState.ACTIVE, 60),
        (ControllerState.UNCONFIGURED, 600),
        (ControllerState.BUS_LOST, 600),
    ],
)
def test_silent_loop_is_ended_after_many_feeds(kind, bound):
    peer = Peer(state(1, kind), **RUNS)
    job = ask(peer.node, 'halt')
    for number in range(2 * bound):
        if number == bound:
            peer.channel.send(*state(1, kind))
        peer.node.feed()
        peer.taken()
    assert not peer.process.kill.called
    assert peer.node.snapshot().state is not ControllerState.LOST
    peer.node.feed()
    peer.node.feed()
    assert peer.process.mock_calls == KILLED
    assert job.done()
    lost = peer.node.snapshot()
    assert lost.state is ControllerState.LOST
    assert lost.unhomed == ('q1', 'q2')
    assert (
        f'fed {bound + 1} times, above the limit {bound}, and was ended; the drives stop'
        in lost.cause
    )
    assert 'then configure' in lost.next_step


@pytest.mark.parametrize(
    'heartbeat_timeout, feeds',
    [(0.1, 4), (0.15, 5), (0.5, 12)],  # 50 ms each
)
def test_unanswered_loop_is_shown_silent_until_it_answers(heartbeat_timeout, feeds):
    controller = replace(SETUP.controller, heartbeat_timeout=heartbeat_timeout)
    active = state(1, ControllerState.ACTIVE)
    peer = Peer(active, setup=replace(SETUP, controller=controller))
    for _ in range(2):
        shown = []
        for _ in range(feeds + 1):
            peer.node.feed()
            shown.append(peer.node.snapshot().state)
        before = [ControllerState.ACTIVE] * (feeds - 1)
        assert shown == [*before, *[ControllerState.SILENT] * 2]
        silent = peer.node.snapshot()
        assert silent.power == 'unknown'
        assert silent.joints() is None
        assert silent.cause == (
            'the control loop does not answer: it has sent no state while it was fed '
            f'{feeds} times; the drives stop because its heartbeat is missing'
        )
        assert silent.next_step == 'wait until the control loop answers or is ended'
        peer.channel.send(*active)
        peer.node.read()
        assert ('state', *peer.node._state) == active


@pytest.mark.parametrize(
    'kind',
    [
        ControllerState.UNCONFIGURED,
        ControllerState.BUS_LOST,
        ControllerState.CONFIGURING,
        ControllerState.CLEANING_UP,
    ],
)
def test_loop_that_may_open_an_interface_is_not_silent(kind):
    peer = Peer(state(1, kind))
    for _ in range(60):
        peer.node.feed()
    assert peer.node.snapshot().state is kind


@pytest.mark.parametrize(
    'wait, shown',
    [
        (
            {'wait.return_value': 0},
            '0; the drives that it had configured have confirmed',
        ),
        (
            {'wait.return_value': -9},
            '-9; the drives stop because its heartbeat is missing',
        ),
        (RUNS, 'unknown, killed'),
    ],
)
def test_ended_loop_is_lost_and_rejects_requests(wait, shown):
    peer = Peer(**wait)
    before = ask(peer.node, 'halt')
    peer.channel.close()
    peer.node.feed()
    assert peer.node.snapshot().state is ControllerState.LOST
    assert f'has ended by itself, exit status {shown}' in peer.node.snapshot().cause
    for job in (before, ask(peer.node, 'activate')):
        with pytest.raises(DriveError, match='ended by itself.*; next: read the cause'):
            job.result(0.0)


def test_loop_ended_by_its_alarm_has_hung():
    peer = Peer(**{'wait.return_value': -signal.SIGALRM})
    peer.channel.close()
    peer.node.feed()
    cause = peer.node.snapshot().cause
    assert cause.startswith(
        'the control loop has hung, exit status -14; the drives stop'
    )


def test_forbidden_power_reaches_the_next_loop():
    peer = Peer()
    last = ('again', 'send false', False)
    forbidden = [
        ('stop', 'send false', True),
        ('stop', '', True),
        ('', '', False),
        ('again', 'send false', True),
        last,
    ]
    for one in (forbidden[0], *forbidden):
        peer.node.forbid_power(*one)
    assert peer.taken() == [('forbid', *one) for one in forbidden]
    peer.node.start()
    repeated = [one for one in peer.taken() if one[0] == 'forbid']
    assert repeated[-1] == ('forbid', *last)


def test_changed_limits_reach_the_next_loop():
    peer = Peer()
    changed = replace(SETUP.limits, speed=0.1)
    peer.node.change(changed)
    peer.taken()
    peer.node.start()
    (_, setup), *rest = peer.taken()
    limits = [setup.limits]
    for kind, *content in rest:
        if kind == 'limits':
            limits += content
    assert limits[-1] == changed


def test_full_channel_drops_setpoints_but_not_stops():
    peer = Peer()
    for number in range(MORE_THAN_FIT):
        peer.node.send_setpoint(Setpoint(float(number), STILL, STILL))
    peer.node.stop('enough')
    peer.node.forbid_power('no more')
    peer.node.change(limits=SETUP.limits)
    ask(peer.node, 'halt')
    peer.node.apply_forces([1.0, 2.0, 3.0])
    taken = peer.taken()
    peer.node.send_setpoint(Setpoint(-1.0, STILL, STILL))
    taken += peer.taken()
    setpoints = [one[1] for one in taken if one[0] == 'setpoint']
    urgent = [one[0] for one in taken if one[0] not in ('setpoint', 'forces')]
    assert len(setpoints) < MORE_THAN_FIT
    assert setpoints == [*range(len(setpoints) - 1), -1.0]
    assert urgent == ['stop', 'forbid', 'limits', 'request']


@pytest.mark.parametrize(
    'first, error, message',
    [
        (('failed', 'q1 = q2'), ParameterError, 'q1 = q2'),
        (('other',), ManipulatorError, 'did not start'),
        ((), ManipulatorError, 'did not start'),
    ],
)
def test_loop_that_does_not_start_is_ended(first, error, message):
    kill = Mock()
    with pytest.raises(error, match=message):
        Peer(first, kill=kill, **RUNS)
    kill.assert_called_once_with()


def test_close_returns_the_last_answer_of_the_loop():
    peer = Peer()
    peer.channel.send('reply', 0, True, 'power: confirmed off')
    assert peer.node.close() == peer.node.close() == 'power: confirmed off'
    closed = peer.node.snapshot()
    assert closed.state == ControllerState.CLOSED
    assert closed.causes == ()
    assert closed.next_step == 'start the driver again'
    assert [message[0] for message in peer.taken()] == ['request', 'feed', 'close']
    ((timeout,),) = peer.process.wait.call_args_list[0][:1]
    assert not peer.process.kill.called
    assert timeout == pytest.approx(CLOSE_TIMEOUT, abs=1.0)
    assert str(ask(peer.node, 'home').exception()) == (
        'the control loop is closed; next: start the driver again'
    )


def test_close_feeds_the_loop_and_times_out(monkeypatch):
    monkeypatch.setattr(process_module, 'CLOSE_TIMEOUT', 0.2)
    peer = Peer(**RUNS)
    begin = time.monotonic()
    with pytest.raises(DriveError, match='has not confirmed that the power'):
        peer.node.close()
    assert time.monotonic() - begin >= 0.2 + SETUP.extra_time
    closed = peer.node.snapshot()
    assert closed.state == ControllerState.CLOSED
    assert closed.causes == ()
    assert closed.next_step == 'start the driver again'
    first, *feeds, last = [message[0] for message in peer.taken()]
    assert first == 'request'
    assert {*feeds} == {'feed'}
    assert last == 'close'
    assert len(feeds) > 3
    assert peer.process.mock_calls == KILLED


def test_loop_that_reads_no_commands_is_ended():
    peer = Peer(**RUNS)
    for number in range(10_000):
        peer.node.stop(f'cause {number}')
        if peer.process.kill.called:
            break
    lost = peer.node.snapshot()
    assert lost.state is ControllerState.LOST
    assert 'has not read its messages, and was ended; the drives stop' in lost.cause


def test_unanswered_feeds_never_fill_the_channel():
    """Some interfaces take long to open, and the loop reads nothing then."""
    peer = Peer(state(1, ControllerState.UNCONFIGURED))
    for _ in range(600):
        peer.node.feed()
    peer.node.forbid_power('software_stop was set')
    kinds = [message[0] for message in peer.taken()]
    assert kinds[-1] == 'forbid'
    assert kinds.count('feed') < 200
    peer.channel.send(*state(2, ControllerState.UNCONFIGURED))
    peer.node.feed()
    peer.node.feed()
    assert ('feed',) in peer.taken()
    assert not peer.process.kill.called


def test_limits_above_the_drives_start_no_process():
    limits = replace(SETUP.limits, speed=5.0)
    launch = Mock()
    with pytest.raises(ParameterError, match='limits.speed = 5 m/s is above'):
        LoopClient(replace(SETUP, limits=limits), Mock(), launch)
    launch.assert_not_called()


def test_live_limits_are_checked_against_the_drives():
    peer = Peer()
    peer.node.check(replace(SETUP.limits, speed=0.1))
    with pytest.raises(ParameterError, match='limits.speed = 5 m/s is above'):
        peer.node.check(replace(SETUP.limits, speed=5.0))
