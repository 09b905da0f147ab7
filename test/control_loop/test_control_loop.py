"""Control loop and its node: the loop outlives the node, and ends in order."""

from collections import defaultdict, deque
from dataclasses import replace
from functools import cache
import math

from bus_world import (
    at_rest,
    configured,
    HOME,
    in_motion,
    LEAD,
    Rig,
    SETTINGS,
    stopping,
)
from frames import decode_rpdo1
import numpy as np
import pytest
from support import wait_until

from facade_manipulator.canopen import pdo
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.control_loop import (
    ControlLoop,
    HANG_TIMEOUT,
    HangAlarm,
)
from facade_manipulator.control_loop.loop_channel import LoopSetup, Message
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import Controlword, State
from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.limits import MotionLimits

pytestmark = pytest.mark.long

OFF = [State.SWITCH_ON_DISABLED] * 3
FEED_PERIOD = 0.02  # s
STREAM = ('setpoint', 'forces')  # kinds of messages that may be lost
SLOW = 0.05  # m/s
RAMP_TIME = 3.0  # s, the longest way to rest and power off


class NodeEnd:
    """Channel of the loop, with the messages of a simulated node."""

    def __init__(self, rig):
        #: what the node sends in each cycle
        self.repeated: Message | None = ('feed', ())
        self.sent = defaultdict(list)  #: contents of the messages of the loop, by kind
        self.inbox: deque[Message] = deque()
        self.has_ended = False
        self.pause_at = math.inf  #: when the loop returns to the test [s]
        self._rig = rig
        self._next_feed = 0.0  # s

    def wait(self, timeout):
        self._rig.pass_time(timeout)

    def commands(self):
        self._look()
        now = self._rig.clock.now
        if self.repeated is not None and now >= self._next_feed:
            self._next_feed = now + FEED_PERIOD
            self.inbox.append(self.repeated)
        return self._take(lambda kind: kind not in STREAM)

    def stream(self, number, may_continue):
        return self._take(lambda kind: kind in STREAM)[-number:]

    def send(self, kind, *content):
        self.sent[kind].append(content)

    def close(self):
        self.has_ended = True

    def _look(self):
        if self.has_ended:
            raise ConnectionError('the other process has ended')
        if not self.inbox and self._rig.clock.now >= self.pause_at:
            raise TimeoutError

    def _take(self, is_wanted):
        taken = [one for one in self.inbox if is_wanted(one[0])]
        for one in taken:
            self.inbox.remove(one)
        return taken


class LoopRig(Rig):
    """Control loop between three simulated drives and a simulated node."""

    def __init__(self, axes=DEFAULT_AXES, **changes: object) -> None:
        settings = replace(SETTINGS, **changes)
        super().__init__(settings, axes)
        self.node = NodeEnd(self)
        setup = LoopSetup(Geometry(), settings, self.axes)
        machine = (self.follower, self.controller)
        self.loop = ControlLoop(setup, self.node, self.clock, machine)
        self._send_state = self.controller.observe
        self.controller.observe = self._send_and_observe

    def _send_and_observe(self, snapshot) -> None:
        self._send_state(snapshot)
        self._observe(snapshot)

    def say(self, kind: str, *content: object) -> None:
        self.node.inbox.append((kind, content))

    def serve(self, seconds: float = 10.0) -> bool:
        """Let the loop serve its node for a while [s]; return whether it has ended by then."""
        self.node.pause_at = self.clock.now + seconds
        try:
            self.loop.run()
        except TimeoutError:
            return False
        self.loop.close()
        return True


def hang(rig, sending=None):
    """Stop feeding the loop; the node may send another message in each cycle."""
    rig.node.repeated = sending


@pytest.mark.parametrize(
    ('leave', 'errors'),
    [
        (lambda rig: rig.node.close(), 1),
        (hang, 1),
        (lambda rig: hang(rig, ('setpoint', (0.0, HOME, (0.0,) * 3))), 1),
        (lambda rig: rig.say('close'), 0),
    ],
)
def test_node_lost_at_full_speed_ends_in_a_ramp(caplog, leave, errors):
    rig = LoopRig(watchdog_timeout=0.3)
    in_motion(rig)
    rig.serve(0.1)
    rig.frames()
    leave(rig)
    begin = rig.clock.now
    assert rig.serve(RAMP_TIME)
    assert rig.clock.now < begin + RAMP_TIME
    words = []
    for frame in rig.frames():
        if frame.cob_id == pdo.RPDO1.cob_id(1):
            words.append(decode_rpdo1(frame.data).controlword)
    assert Controlword.QUICK_STOP not in words
    assert words[-1] == Controlword.DISABLE_VOLTAGE
    assert rig.state == ControllerState.CLOSED
    assert rig.drive_states == OFF
    assert (
        caplog.text.count('the carriages ramp down and the drives power off') == errors
    )


def test_silence_of_the_node_names_other_programs_as_next_step(caplog):
    rig = LoopRig(watchdog_timeout=0.3)
    at_rest(rig)
    hang(rig)
    rig.serve(RAMP_TIME)
    assert (
        'above the limit 0.3 s; next: end other programs on this computer'
        in caplog.text
    )


def test_node_that_hangs_after_a_stop_leaves_no_power():
    """A starved loop has stopped the drives, which hold with power."""
    rig = LoopRig(watchdog_timeout=0.3)
    at_rest(rig)
    rig.say('stop', 'the control loop was paused')
    rig.serve(1.0)
    assert rig.snapshot.cause == 'the control loop was paused'
    assert rig.state is ControllerState.STOPPED
    assert rig.drive_states != OFF
    hang(rig)
    assert rig.serve()
    assert rig.drive_states == OFF


@pytest.mark.parametrize('is_silent', [False, True])
def test_end_of_the_loop_returns_whether_power_is_off(is_silent):
    rig = LoopRig()
    at_rest(rig)
    rig.drives[1].is_silent = is_silent
    assert rig.loop.close() is not is_silent


def test_end_of_the_loop_waits_for_slow_brakes():
    """A quick stop from full speed takes 3 s."""
    slow = tuple(
        replace(one, stop_deceleration=one.max_speed / 3) for one in DEFAULT_AXES
    )
    rig = LoopRig(slow)
    stopping(rig)
    assert rig.loop.close()
    assert rig.drive_states == OFF


def test_node_hanging_without_power_keeps_the_loop(caplog):
    rig = LoopRig(watchdog_timeout=0.1)
    configured(rig)
    hang(rig)
    assert not rig.serve(1.0)
    assert rig.state is ControllerState.INACTIVE
    assert not caplog.text


def record_limits(follower):
    """Return a list of the limits that a follower applies from now on."""
    applied = []
    change_limits = follower.change_limits

    def record(limits):
        change_limits(limits)
        applied.append(limits)

    follower.change_limits = record
    return applied


def test_invalid_messages_and_requests_keep_the_loop():
    rig = LoopRig()
    limits = MotionLimits(speed=0.1)
    out_of_range = replace(limits)
    object.__setattr__(out_of_range, 'speed', 50.0)
    rig.say('nonsense')
    rig.say('request', 1, 'nonsense')
    rig.say('setpoint', 'x')
    rig.say('limits')
    rig.say('limits', limits)
    rig.say('limits', out_of_range)
    rig.say('forces', 1.0, 2.0, 3.0)  # real drives have none
    rig.say('request', 3, 'activate')
    rig.say('request', 7, 'configure')
    applied = record_limits(rig.follower)
    assert not rig.serve(5.0)
    assert applied == [limits]
    failed, answered = rig.node.sent['reply']
    assert failed[:2] == (3, False)
    assert 'not configured' in failed[2]
    assert answered[:2] == (7, True)
    assert 'power: confirmed off' in answered[2]


@cache
def delayed_stream(step):
    """Return commands [m] of a slow stream while the system clock is set by a step [s]."""
    rig = LoopRig()
    at_rest(rig)
    start = rig.follower.motion.position
    begin = rig.clock.now
    on_their_way = deque()
    commanded = []
    for cycle in range(100):
        if cycle == 50:
            rig.clock.offset += step
        way = SLOW * (rig.clock.now - begin + LEAD)
        position = tuple(q + way for q in start)
        on_their_way.append((rig.clock.time() + LEAD, position, (SLOW,) * 3))
        if len(on_their_way) > 2:  # cycles from the sender to the loop
            rig.loop._handlers['setpoint'](*on_their_way.popleft())
        rig.cycles(1)
        commanded.append(rig.follower.motion.position)
    assert rig.state is ControllerState.ACTIVE, rig.all_causes
    return np.array(commanded)


@pytest.mark.parametrize('step', [-30.0, -0.4, -0.3, -0.05, 0.05, 0.3, 30.0])
def test_setpoints_sent_before_a_clock_step_hardly_delay_carriages(step):
    """Two setpoints have wrong times: the delay is at most the way of five cycles."""
    deviation = delayed_stream(step) - delayed_stream(0.0)
    assert abs(deviation).max() < 5.0 * SLOW * SETTINGS.period
    assert abs(deviation[-1]).max() < 1e-5


@pytest.mark.parametrize('rate', [100, 500])
def test_states_are_sent_at_most_at_100_hz(rate):
    rig = LoopRig(rate=rate)
    configured(rig)
    rig.serve(1.0)
    assert 90 <= len(rig.node.sent['state']) <= 105


def test_stream_flood_delays_a_step_by_a_tenth():
    rig = LoopRig()
    at_rest(rig)
    times = []

    def endless_stream(number, may_continue):
        begin = rig.clock.now
        while may_continue() and rig.clock.now < begin + 1.0:
            rig.clock.now += 1e-5
        times.append(rig.clock.now - begin)
        return []

    rig.node.stream = endless_stream
    rig.serve(0.1)
    assert times == pytest.approx([0.1 * SETTINGS.period] * len(times), abs=2e-5)


class RecordedAlarm(HangAlarm):
    """Alarm that only records its timeouts."""

    def __init__(self) -> None:
        super().__init__()
        self.timeouts: list[float] = []  # s

    def set(self, timeout: float) -> None:
        self.timeouts.append(timeout)


def test_hang_alarm_pauses_while_the_bus_is_opened():
    alarm = RecordedAlarm()
    bus = BusSettings(interface='unknown')
    setup = LoopSetup(Geometry(), SETTINGS, DEFAULT_AXES, bus)
    controller = ControlLoop(setup, NodeEnd(None), alarm=alarm).controller
    replies = []
    controller.request('configure', replies.append)
    wait_until(lambda: replies, 'the reply', step=controller.turn)
    assert 'cannot be opened' in str(replies[0])
    assert alarm.timeouts == [0.0, HANG_TIMEOUT]


def test_bit_rate_too_low_for_the_cycle_is_rejected_at_the_start():
    bus = BusSettings(bitrate=125_000)
    setup = LoopSetup(Geometry(), SETTINGS, DEFAULT_AXES, bus)
    with pytest.raises(
        ParameterError, match='bus load = 126 % .* is above the limit 50 %'
    ):
        ControlLoop(setup, NodeEnd(None))


def test_software_stop_shorter_than_a_cycle_stops_the_drives():
    rig = LoopRig()
    at_rest(rig)
    rig.say('forbid', 'the red button is pressed', '')
    rig.say('forbid', '', '')
    rig.say('request', 1, 'clear_faults')
    rig.serve(2.0)
    ((_, succeeded, answer),) = rig.node.sent['reply']
    assert succeeded
    assert 'cleared (the red button is pressed)' in answer
    assert rig.drive_states == OFF


def test_end_after_an_unconfirmed_cleanup_reports_the_power_unknown():
    rig = LoopRig(step_timeout=0.3)
    at_rest(rig)
    rig.controller.stop('the operator stops')
    rig.until_stopped()
    rig.drives[1].is_silent = True
    assert 'not confirmed off' in rig.rejection('cleanup')
    assert rig.loop.close() is False
