"""Commands of compensator and ik_service before the activation and during silence."""

import math
from typing import NamedTuple

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.nodes.command_gate import CommandGate, GATE_PERIOD
from facade_manipulator.nodes.driver_status import DRIVER_SILENCE, DriverStatus

START = 100.0  # s, monotonic
EPOCH = 1.8e9  # s, from the monotonic to the system clock


class Pose(NamedTuple):
    """Command with its time of reception."""

    received: float


class Bench:
    """Gate, its clock, and the answers that it gives to commands."""

    def __init__(self):
        self.now = START
        self.followed = []
        self.rejected = []
        self.reasons = []
        self.ends = []
        self.error = None  # that `follow` raises
        self.gate = CommandGate(
            self._follow, self._reject, self._end, 'send the pose again'
        )

    def _follow(self, command):
        if self.error is not None:
            raise self.error
        self.followed.append(command)

    def _reject(self, command, error):
        self.rejected.append(command)
        self.reasons.append(str(error))

    def _end(self):
        self.ends.append(self.now)

    def offer(self):
        """Offer a command, and return it."""
        command = Pose(self.now)
        self.gate.offer(command)
        return command

    def report(self, state, since=math.inf, step=0.0):
        """Receive a status; the system clock is set ahead by `step` [s]."""
        now_of_clock = self.now + EPOCH + step
        status = DriverStatus(state, 'holding', 'activate', since + EPOCH)
        self.gate.receive(self.now, now_of_clock, status)

    def wait(self, duration):
        for _ in range(round(duration / GATE_PERIOD)):
            self.now += GATE_PERIOD
            self.gate.update(self.now)


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def active(bench):
    """Return the bench of a driver that has just reported its activation."""
    bench.report('inactive')
    bench.now += 1.0
    bench.report('active', bench.now)
    bench.ends.clear()
    return bench


def test_commands_pass_without_a_driver_after_a_delay(bench):
    early = bench.offer()
    bench.wait(CommandGate.PATIENCE)
    assert bench.followed == []
    bench.wait(2 * GATE_PERIOD)
    late = bench.offer()
    assert bench.followed == [early, late]
    assert bench.rejected == []
    assert bench.ends == []


def test_late_first_callback_does_not_open_the_gate(bench):
    """A busy process may begin its callbacks a second after the node exists."""
    bench.now += 1.0
    bench.offer()
    bench.report('inactive')
    bench.wait(2 * CommandGate.PATIENCE)
    assert bench.followed == []
    assert len(bench.rejected) == 1


@pytest.mark.parametrize('since', [START - 1.0, START + 1.0])
def test_driver_that_appears_late_ends_only_earlier_commands(bench, since):
    bench.wait(CommandGate.PATIENCE + 2 * GATE_PERIOD)
    bench.offer()
    bench.now += 1.0
    bench.report('active', since)
    assert len(bench.ends) == (since > START + CommandGate.PATIENCE)


def test_invalid_first_status_closes_the_gate(bench):
    """Two drivers from the start are not a driver of another make."""
    command = bench.offer()
    bench.gate.receive_invalid()
    bench.wait(2 * CommandGate.PATIENCE)
    assert bench.followed == []
    assert bench.rejected == [command]


def test_command_between_activation_and_its_status_is_followed(bench):
    bench.report('activating')
    bench.now += 0.1
    since = bench.now
    bench.now += 0.1
    command = bench.offer()
    bench.wait(CommandGate.PATIENCE / 2)
    bench.report('active', since)
    assert bench.followed == [command]
    assert bench.rejected == []


def test_command_before_the_activation_is_rejected_at_once(bench):
    bench.report('inactive')
    command = bench.offer()
    bench.now += 0.1
    bench.report('active', bench.now)
    assert bench.followed == []
    assert bench.rejected == [command]
    assert bench.reasons == [
        'the command was sent before the drives were activated; next: send the pose again'
    ]


def test_command_without_activation_is_rejected_once(bench):
    bench.report('inactive')
    command = bench.offer()
    bench.wait(CommandGate.PATIENCE)
    assert bench.rejected == []
    bench.wait(3 * CommandGate.PATIENCE)
    assert bench.rejected == [command]
    assert bench.reasons == [
        'the drives are inactive; next: activate, then send the pose again'
    ]


def test_newer_command_replaces_the_held_command(bench):
    bench.report('inactive')
    bench.offer()
    bench.wait(CommandGate.PATIENCE / 2)
    newer = bench.offer()
    bench.wait(2 * CommandGate.PATIENCE)
    assert bench.rejected == [newer]


def test_command_during_silence_is_rejected_at_once(active):
    active.wait(DRIVER_SILENCE + 2 * GATE_PERIOD)
    command = active.offer()
    assert active.rejected == [command]
    assert active.followed == []
    assert active.reasons[0].startswith('the driver is silent; next: check whether')


def test_driver_silence_ends_followed_commands_once(active):
    active.offer()
    active.wait(2 * DRIVER_SILENCE)
    assert len(active.ends) == 1
    assert not active.gate.has_passed


def test_driver_that_returns_follows_no_earlier_command(active):
    since = active.now
    active.offer()
    active.wait(DRIVER_SILENCE + 2 * GATE_PERIOD)
    active.followed.clear()
    active.report('active', since)
    active.wait(CommandGate.PATIENCE)
    assert active.followed == []
    assert not active.gate.has_passed
    newer = active.offer()
    assert active.followed == [newer]


def test_another_activation_ends_the_followed_commands(active):
    active.offer()
    active.now += 1.0
    active.report('active', active.now)
    assert len(active.ends) == 1


@pytest.mark.parametrize('step', [0.0, -600.0])
def test_system_clock_step_lets_no_earlier_command_pass(bench, step):
    """The system clock is set back, so that the activation is in the future."""
    bench.report('inactive')
    earlier = bench.offer()
    bench.now += 0.1
    bench.report('active', bench.now, step)
    later = bench.offer()
    assert bench.rejected == [earlier]
    assert bench.followed == [later]


def test_status_that_repeats_the_activation_ends_nothing(active):
    since = active.now
    active.offer()
    for _ in range(20):
        active.wait(CommandGate.PATIENCE)
        active.report('active', since)
    assert active.ends == []


def test_error_of_a_passing_command_is_its_answer(active):
    active.error = InputError('publishers', 'joint_states has 2 publishers')
    command = active.offer()
    assert active.rejected == [command]
    assert not active.gate.has_passed
    assert active.reasons[0].startswith('joint_states has 2 publishers')


EVENTS = 'offer activate repeat stop wait wait_long'.split()


@given(st.lists(st.sampled_from(EVENTS), max_size=20))
def test_only_commands_after_the_activation_are_followed(events):
    """The driver reports each change 10 ms late, after the events in between."""
    bench = Bench()
    bench.report('inactive')
    since = math.inf
    offered = []
    for event in events:
        bench.now += 1e-3
        if event == 'offer':
            offered.append(bench.offer())
        elif event == 'activate':
            since = bench.now
            bench.now += 0.01
            offered.append(bench.offer())
            bench.report('active', since)
        elif event == 'stop':
            since = math.inf
            bench.report('stopped')
        elif event == 'repeat':
            bench.report('active' if since < math.inf else 'stopped', since)
        else:
            bench.wait(DRIVER_SILENCE + 1.0 if event == 'wait_long' else 0.1)
        if bench.followed:
            newest = bench.followed[-1]
            ended = bench.ends and bench.ends[-1] > newest.received
            assert ended or newest.received >= since
    bench.wait(2 * CommandGate.PATIENCE)
    answered = bench.followed + bench.rejected
    assert len(answered) == len({*answered})
    assert not offered or offered[-1] in answered
