"""Driver node with simulated drives on a virtual bus: its topics and services."""

from itertools import groupby
import math
import re
from threading import Event, Timer
import time
from unittest.mock import Mock

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions
from nodes.node_rig import DriverBench, LoopThread
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from support import DEADLINE, limited

from facade_manipulator import topics
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.loop_client import LoopClient
from facade_manipulator.drives.snapshot import (
    AxisSnapshot,
    ControllerSnapshot,
    ControllerState,
)
from facade_manipulator.errors import DriveStateError
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.nodes.conversions import joint_state, stamp
from facade_manipulator.nodes.driver_status import DriverStatus
from facade_manipulator.nodes.planar_messages import status_level, status_values

HOME = (-0.1, 0.1, 0.0)
ENDED = (ControllerState.LOST, ControllerState.CLOSED)


class Bench(DriverBench):
    """Driver, operator and source of setpoints."""

    def __init__(self, ros, parameters=None, **options):
        super().__init__(ros, parameters, **options)
        self.states = self.collect(topics.JOINT_STATES)
        self.statuses = self.collect(topics.DRIVER_STATUS, depth=1)
        self.sent = -math.inf  # time of the last setpoint [s]

    def send(self, positions):
        """Publish a setpoint, at most 200 a second: more would wait in the middleware."""
        if self.now() < self.sent + 0.005:
            return
        self.sent = self.now()
        stamp_ahead = self.sent + 0.06
        setpoint = joint_state(stamp_ahead, positions, (0.0, 0.0, 0.0))
        self.publish(topics.JOINT_SETPOINTS, setpoint)

    def position(self):
        return list(self.states[-1].position) if self.states else None

    def values(self):
        return status_values(self.operation())

    def until_driver(self, *state_and_next_step):
        """Wait for state and next step on driver/status; return the time of the activation [s]."""

        def found():
            status = self.statuses and DriverStatus.from_message(self.statuses[-1])
            return (
                status
                and (status.state, status.next_step) == state_and_next_step
                and status
            )

        return self.ros.until(found, f'{state_and_next_step}').active_since


@pytest.fixture
def bench(ros):
    return Bench(ros)


def test_drives_follow_a_stream_until_it_is_silent(bench):
    bench.bring_up()
    target = [q + 0.02 for q in HOME]

    def has_moved():
        bench.send(target)
        return bench.position() == pytest.approx(target, abs=1e-3)

    bench.ros.until(has_moved, 'the end of the move')
    newest = bench.states[-1]
    assert tuple(newest.name) == AXIS_NAMES
    assert len(newest.velocity) == len(newest.effort) == 3
    bench.ros.until(
        lambda: bench.values()['activity'] == 'holding', 'rest after the stream'
    )
    for transition, state in (
        (None, 'active'),
        ('deactivate', 'inactive'),
        ('cleanup', 'unconfigured'),
    ):
        assert transition is None or bench.change(transition)
        assert bench.call(topics.GET_STATE).current_state.label == state


def test_carriage_forces_act_on_simulated_drives(bench):
    bench.bring_up()
    before = bench.states[-1].effort
    for force in (math.nan, 0.0):
        message = JointState(name=AXIS_NAMES, effort=[-30.0, 20.0, force])
        bench.publish(topics.CARRIAGE_FORCES, message)

    def has_forces():
        change_1 = bench.states[-1].effort[0] - before[0]
        change_2 = bench.states[-1].effort[1] - before[1]
        return change_1 > 15.0 and change_2 < -10.0

    bench.ros.until(has_forces, 'the forces in the effort')


def test_notes_show_a_supervisor_that_was_never_received(bench):
    never = 'software_stop was never received'
    before = bench.operation()
    assert never in status_values(before)['notes']
    assert status_level(before) == 'ok'
    bench.publish(topics.SOFTWARE_STOP, Bool(data=False))
    bench.ros.until(lambda: never not in bench.values()['notes'], 'the end of the note')


def test_notes_show_an_empty_list_of_supervisors(ros):
    bench = Bench(ros, {'software_stop_topics': []})
    status = bench.operation()
    assert 'no topic of software_stop is configured' in status_values(status)['notes']
    assert status_level(status) == 'ok'


def test_driver_status_publishes_each_state_and_next_step(bench, capfd):
    bench.until_driver('unconfigured', 'configure, home, activate')
    bench.change('configure')
    bench.until_driver('inactive', 'home, activate')
    bench.call(topics.HOME)
    assert bench.until_driver('inactive', 'activate') == math.inf
    before = bench.now()
    bench.change('activate')
    after = bench.now()
    assert before <= bench.until_driver('active', '') <= after
    bench.call(topics.HALT)
    bench.until_driver('halted', 'clear_faults')
    assert bench.statuses[-1].level == DiagnosticStatus.WARN
    assert not bench.change('activate')
    assert bench.message() == (
        'halted; activate rejected: the node is active; next: clear_faults'
    )
    assert bench.call(topics.CLEAR_FAULTS).success
    assert bench.until_driver('active', '') > after
    bench.disturb(1, lambda drive: drive.inject_fault(0x8611))
    bench.until_state('inactive')
    bench.ros.until(
        lambda: bench.statuses[-1].level == DiagnosticStatus.ERROR, 'the error'
    )
    assert 'q2' in bench.statuses[-1].message
    assert 'q2' in bench.message()
    next_step = bench.values()['next step']
    assert bench.values()['drive faults'] == '1'
    assert next_step
    assert capfd.readouterr().err.count(f'; next: {next_step}\n') == 1


def test_driver_status_is_the_component_operation(bench):
    bench.bring_up()
    bench.until_driver('active', '')
    published = status_values(bench.statuses[-1])
    assert published.keys() == bench.values().keys()
    assert bench.statuses[-1].message == bench.message()
    bench.statuses.clear()
    end = bench.loop.snapshot().cycle.cycles + 100
    bench.ros.until(lambda: bench.loop.snapshot().cycle.cycles > end, 'a second')
    assert len(bench.statuses) < 5  # twice a second


def test_early_request_is_rejected_with_the_next_step(bench, capfd):
    for _ in range(3):
        reply = bench.call(topics.HOME)
        assert not reply.success
        assert 'next: configure, home, activate' in reply.message
    assert capfd.readouterr().err.count('home is not possible') == 1
    for transition in (
        Transition.TRANSITION_ACTIVATE,
        99,
        Transition.TRANSITION_CALLBACK_SUCCESS,
    ):
        assert not bench.change(number=transition)
        assert bench.message().endswith(
            ' rejected: the node is unconfigured; next: configure, home, activate'
        )
    assert bench.change(number=Transition.TRANSITION_CONFIGURE)
    assert bench.states == []  # not homed, so the positions are unknown
    assert not bench.change('activate')
    failure = bench.statuses[-1].message
    assert 'activate failed: ' in failure
    assert 'must be homed' in failure
    bench.call(topics.HOME)
    bench.ros.until(lambda: bench.states, 'joint_states')
    bench.send([q + 0.01 for q in HOME])
    assert 'setpoint rejected: the drives are inactive' in bench.until_rejected(
        'inactive'
    )
    assert bench.position() == pytest.approx(HOME, abs=1e-4)


def test_self_test_reports_drives_and_bus(bench):
    early = bench.call(topics.SELF_TEST)
    assert early.passed == b'\x00'
    assert 'not configured' in early.status[0].message
    assert early.status[0].name == 'self_test'
    assert early.status[0].message.startswith('not possible ')
    bench.change('configure')
    reply = bench.call(topics.SELF_TEST)
    assert [status.name for status in reply.status] == ['q1', 'q2', 'q3', 'bus']
    failed = {
        status.name for status in reply.status if status.level != DiagnosticStatus.OK
    }
    assert failed <= {'bus'}  # a busy computer delays its cycle
    assert (reply.passed == b'\x01') == (not failed)


def test_end_of_the_loop_makes_the_driver_unconfigured(bench):
    bench.bring_up()
    bench.thread.kill()
    bench.until_state('unconfigured')
    assert 'the control loop has ended by itself, exit status 0' in bench.message()
    assert bench.values()['next step'].endswith('then configure, home, activate')
    assert not bench.call(topics.HOME).success
    bench.bring_up()  # a new loop, homed again


def test_frozen_loop_is_silent_with_unknown_power(bench, monkeypatch):
    bench.bring_up()
    released = Event()
    monkeypatch.setattr(
        bench.thread.loop, '_require_node', lambda: released.wait(DEADLINE)
    )
    step = 'wait until the control loop answers or is ended'
    bench.until_driver('control loop silent', step)
    values = bench.values()
    assert values['power'] == 'unknown'
    assert values['active since'] == 'inf'
    assert bench.tested.state_label == 'active'  # the loop may still answer
    bench.send(HOME)
    assert 'the control loop is silent' in bench.until_rejected('control loop silent')
    released.set()
    bench.ros.until(lambda: bench.values()['state'] == 'stopped', 'the stop')
    assert 'the control loop was paused' in bench.message()
    assert bench.values()['drive faults'] == '1'


@pytest.mark.parametrize('is_released', [False, True])
def test_node_ends_while_configure_restarts_the_loop(bench, is_released):
    """The signal comes while the loop starts, or after its start."""
    bench.require('configure')
    bench.thread.kill()
    bench.until_state('unconfigured')
    released = Event()
    is_starting = Event()

    class SlowLoop(LoopThread):
        def run(self):
            is_starting.set()
            released.wait(DEADLINE)
            super().run()

    bench.make_thread = SlowLoop
    if is_released:
        released.set()
    change = bench.node.create_client(*topics.CHANGE_STATE)
    bench.ros.until(change.service_is_ready, 'the service')
    change.call_async(ChangeState.Request(transition=Transition(label='configure')))
    bench.ros.until(is_starting.is_set, 'the restart')

    Timer(0.3, released.set).start()
    with limited('the end of the node', DEADLINE):
        bench.tested.close()
    assert bench.loop.snapshot().state in ENDED
    assert bench.thread.wait(DEADLINE) == 0
    assert bench.thread.loop.controller.snapshot().state is ControllerState.CLOSED


def test_live_limits_with_which_carriages_touch_are_rejected(bench):
    result = bench.tested.set_parameters([Parameter('limits.speed', value=5.0)])[0]
    assert not result.successful
    assert 'axes.max_speed' in result.reason
    assert bench.loop._setup.limits.speed < 5.0


def test_end_of_the_node_is_published(bench):
    bench.bring_up()
    bench.tested.close()
    bench.until_driver('closed', 'start the driver again')


def test_configure_at_start_waits_for_the_can_interface(ros, monkeypatch):
    missing = ['the CAN interface can0 is missing or down', '']
    monkeypatch.setattr(BusSettings, 'missing', lambda bus: missing[0])
    bench = Bench(ros, {'configure_at_start': True})
    ros.until(
        lambda: 'configure waits: the CAN interface can0 is' in bench.message(),
        'a reason',
    )
    assert bench.tested.state_label == 'unconfigured'
    missing.pop(0)
    bench.until_state('inactive')


def test_halt_is_answered_within_100_ms_during_configure(ros):
    bench = Bench(ros, {'simulate_drives': False, 'bus.interface': 'virtual'})
    change = bench.node.create_client(*topics.CHANGE_STATE)
    halt = bench.node.create_client(*topics.HALT)
    ros.until(lambda: change.service_is_ready() and halt.service_is_ready(), 'services')
    configure = change.call_async(
        ChangeState.Request(transition=Transition(label='configure'))
    )
    bench.until_state('configuring')
    elapsed = 1.0
    while elapsed > 0.1:  # a busy computer delays some of the answers
        begin = time.monotonic()
        reply = halt.call_async(Trigger.Request())
        ros.until(reply.done, 'the answer')
        elapsed = time.monotonic() - begin
        assert not reply.result().success
        assert 'configur' in reply.result().message
        assert not bench.change(number=Transition.TRANSITION_CALLBACK_SUCCESS)
        assert bench.call(topics.GET_STATE).current_state.label == 'configuring'
        assert not configure.done()
    assert ros.call(
        bench.node, GetAvailableTransitions, 'driver/get_available_transitions'
    ).available_transitions
    ros.until(configure.done, 'the end of configure')
    assert not configure.result().success
    assert bench.tested.state_label == 'unconfigured'
    assert "(python-can's bus within one process" in bench.message()


def test_exception_in_a_callback_stops_the_drives(bench):
    bench.bring_up()
    bench.tested.handle_exception(ZeroDivisionError('a defect'))
    bench.until_state('inactive')
    assert (
        "a callback of the driver raised ZeroDivisionError('a defect')"
        in bench.message()
    )


def test_each_joint_state_is_published_once(ros, monkeypatch):
    times = [0.01, 0.02, 0.02, 0.03]
    axes = tuple(
        AxisSnapshot(f'q{number}', number, position=position, homed=True)
        for number, position in enumerate(HOME, 1)
    )
    states = [
        ControllerSnapshot(ControllerState.INACTIVE, time, axes) for time in times
    ]
    monkeypatch.setattr(LoopClient, 'take_states', lambda _: states)
    bench = Bench(ros)
    ros.until(lambda: len(bench.states) > 3, 'joint_states')
    stamps = [message.header.stamp for message in bench.states]
    assert stamps[:3] == [stamp(time) for time in (0.01, 0.02, 0.03)]
    assert [one for one, _ in groupby(stamps)] == stamps


def test_second_driver_in_a_namespace_gets_no_power(ros):
    remapping = ['--ros-args', '-r', 'driver/status:=/site/status']
    first = Bench(ros, cli_args=remapping)
    second = Bench(ros, cli_args=remapping)
    reason = 'driver/status has 2 publishers (/driver, /driver), above the limit 1'
    ros.until(
        lambda: first.message().startswith(f'unconfigured; {reason}; next: '),
        'the fault',
    )
    for request in ('configure', 'activate'):
        with pytest.raises(DriveStateError) as rejection:
            second.tested.transitions[request](Mock())
        expected = re.escape(
            f'{request} rejected: {reason}, and both drivers would follow the setpoints; next: '
        )
        ways = 'both drivers, or wait 20 s if a driver has crashed'
        assert re.fullmatch(
            f'{expected}end one of {ways}, then {request}', str(rejection.value)
        )
