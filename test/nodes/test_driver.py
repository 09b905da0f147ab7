"""The driver node with simulated drives on its own virtual bus, from its topics and services."""

from collections import Counter
import math
import os
from pathlib import Path
import platform
import re
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from diagnostic_msgs.srv import SelfTest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from loop_bench import LoopThread
import pytest
import rclpy
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from support import children, patiently, wait_until

from facade_manipulator import topics
from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.control_loop.channel import Channel
from facade_manipulator.control_loop.control_loop import StreamStatus
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.cycle import CycleStatistics
from facade_manipulator.drives.snapshot import AxisSnapshot, ControllerSnapshot, ControllerState
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.driver_status import DriverStatus
from facade_manipulator.resources import version
from facade_manipulator.topics import LATCHED, LATEST, RELIABLE

HOME = (-0.1, 0.1, 0.0)
SIMULATED = (
    Parameter('simulate_drives', value=True),
    Parameter('bus.interface', value='virtual'),
    # the machine of the tests may be busy; that such time-outs act is the controller's tests'
    Parameter('controller.heartbeat_timeout', value=1.0),
    Parameter('controller.max_missed_cycles', value=10),
)


class Bench:
    """A driver node and an operator beside it."""

    def __init__(self, ros, *overrides, launch=LoopThread):
        self.ros = ros
        self.node = ros.add(DriverNode(launch, parameter_overrides=[*SIMULATED, *overrides]))
        self.operator = ros.node('operator')
        self.states = ros.collect(self.operator, JointState, 'joint_states', RELIABLE)
        self.setpoints = self.operator.create_publisher(JointState, 'joint_setpoints', LATEST)
        self.software_stop = self.operator.create_publisher(Bool, 'software_stop', LATEST)
        ros.until(lambda: self.setpoints.get_subscription_count()
                  and self.software_stop.get_subscription_count(), 'the subscriptions')

    def change(self, transition):
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.ros.call(self.operator, ChangeState, 'driver/change_state', request).success

    def ask(self, name):
        return self.ros.call(self.operator, Trigger, f'driver/{name}', deadline=60.0)

    def state(self):
        return self.ros.call(
            self.operator, GetState, 'driver/get_state').current_state.label

    def bring_up(self):
        assert self.change(Transition.TRANSITION_CONFIGURE)
        assert self.ask('home').success
        assert self.change(Transition.TRANSITION_ACTIVATE)

    def now(self):
        return self.operator.get_clock().now().nanoseconds * 1e-9

    def send(self, positions, velocities=(0.0, 0.0, 0.0), ahead=0.06,
             names=('q1', 'q2', 'q3')):
        message = JointState(name=names, position=positions, velocity=velocities)
        message.header.stamp = stamp(self.now() + ahead)
        self.setpoints.publish(message)

    def stream_to(self, shift, duration=0.6):
        """Stream a smooth move of all carriages by `shift` until they are there."""
        begin = self.now()
        target = [q + shift for q in HOME]

        def arrived():
            share = min(1.0, (self.now() + 0.06 - begin) / duration)
            blend = share * share * (3.0 - 2.0 * share)
            self.send([q + blend * shift for q in HOME])
            self.ros.executor.spin_once(0.005)
            return self.position() == pytest.approx(target, abs=1e-3)
        self.ros.until(arrived, 'the end of the move')

    def repeat(self, publisher, level):
        self.operator.create_timer(0.1, lambda: publisher.publish(Bool(data=level)))

    def position(self):
        return list(self.states[-1].position) if self.states else None

    def values(self, component='operation'):
        statuses = {status.name: status for status in self.node._components()}
        return {item.key: item.value for item in statuses[component].values}

    def message(self, component='operation'):
        return {status.name: status.message for status in self.node._components()}[component]


class ScriptedLoop:
    """In place of the control loop's process: it has sent the states of cycles."""

    def __init__(self, stamps, late_share=0.0, state=ControllerState.INACTIVE, causes=()):
        self.stamps, self.cycle = stamps, CycleStatistics(late_share=late_share)
        self.present, self.causes = state, causes

    def __call__(self, end):
        self.channel = Channel(end.dup())
        self.channel.send('ready', *self.state(None))
        for instant in self.stamps:
            self.channel.send('state', *self.state(instant))
        return self

    def state(self, time):
        axes = [AxisSnapshot(f'q{number + 1}', number + 1, position=position, homed=True)
                for number, position in enumerate(HOME)]
        return ControllerSnapshot(
            self.present, time, tuple(axes), self.causes, 'wait', cycle=self.cycle
        ), StreamStatus()

    def wait(self, timeout):
        return 0

    def kill(self):
        pass


@pytest.fixture
def scripted(ros):
    """Make scripted loops, which are gone when their node ends: it waits for none of them."""
    loops = []

    def make(*script, **details):
        loops.append(ScriptedLoop(*script, **details))
        return loops[-1]

    yield make
    for loop in loops:
        loop.channel.close()


@pytest.fixture
def bench(ros):
    return Bench(ros)


def test_drives_follow_a_stream_until_it_is_silent(bench):
    bench.bring_up()
    bench.stream_to(0.04)  # within reach from anywhere on the way, should the stream pause
    newest = bench.states[-1]
    assert list(newest.name) == ['q1', 'q2', 'q3']
    assert len(newest.velocity) == len(newest.effort) == 3
    bench.ros.until(lambda: bench.values()['activity'] == 'holding', 'rest after the stream')
    assert bench.state() == 'active'
    assert bench.change(Transition.TRANSITION_DEACTIVATE)
    assert bench.state() == 'inactive'
    assert bench.change(Transition.TRANSITION_CLEANUP)
    assert bench.state() == 'unconfigured'


def test_carriage_forces_act_on_simulated_drives(bench):
    bench.bring_up()
    loads = bench.operator.create_publisher(
        JointState, 'gondola_simulator/carriage_forces', LATEST)
    bench.ros.until(lambda: loads.get_subscription_count(), 'the driver')
    before = bench.states[-1].effort
    loads.publish(JointState(name=['q1', 'q2', 'q3'], effort=[-30.0, 20.0, math.nan]))
    loads.publish(JointState(name=['q1', 'q2', 'q3'], effort=[-30.0, 20.0, 0.0]))
    bench.ros.until(lambda: bench.states[-1].effort[0] - before[0] > 15.0
                    and bench.states[-1].effort[1] - before[1] < -10.0, 'the forces in the effort')


def test_driver_status_has_each_state_and_next_step(bench):
    statuses = bench.ros.collect(bench.operator, DiagnosticStatus, 'driver/status', LATCHED)

    def newest():
        return DriverStatus.from_message(statuses[-1]) if statuses else None

    def until(state, next_step):
        bench.ros.until(lambda: newest() and (newest().state, newest().next_step)
                        == (state, next_step), f'{state}, not {newest()}')

    until('unconfigured', 'configure, home, activate')
    bench.change(Transition.TRANSITION_CONFIGURE)
    until('inactive', 'home, activate')
    bench.ask('home')
    until('inactive', 'activate')
    assert newest().active_since == math.inf
    before = bench.now()
    bench.change(Transition.TRANSITION_ACTIVATE)
    after = bench.now()
    until('active', '')
    assert before <= newest().active_since <= after
    bench.ros.until(lambda: bench.stream_to(0.02) or any(
        DriverStatus.from_message(status).activity != 'holding' for status in statuses), 'motion')
    bench.ask('halt')
    until('halted', 'clear_faults')
    bench.ask('clear_faults')
    until('active', '')
    assert newest().active_since > after
    bench.node._loop.disturb(1, 'inject_fault', 0x8611)
    bench.ros.until(lambda: newest().state == 'stopped', 'the stop')
    assert statuses[-1].level == DiagnosticStatus.ERROR and 'q2' in statuses[-1].message
    bench.ros.until(lambda: bench.node.state_label == 'inactive', 'inactive')
    assert 'q2' in bench.message()
    assert bench.values()['drive faults'] == '1' and bench.values()['next step']


@pytest.mark.quick
@pytest.mark.parametrize('rate, cycles', [(100, range(1, 9)), (200, (2, 4, 6, 8))])
def test_joint_states_are_published_at_100_hz_at_most(ros, scripted, rate, cycles):
    loop = scripted([0.01 * cycle for cycle in (*range(1, 9), 8)])
    bench = Bench(ros, Parameter('controller.rate', value=rate), launch=loop)
    ros.until(lambda: len(bench.states) >= len(cycles), 'joint_states')
    assert min(timer.timer_period_ns for timer in bench.node.timers) <= 1e7
    bench.node._supervise()  # reads too
    ros.executor.spin_once(0.02)
    assert [message.header.stamp for message in bench.states] == [
        stamp(0.01 * cycle) for cycle in cycles]


@pytest.mark.quick
@pytest.mark.parametrize('state', [ControllerState.DEACTIVATING, ControllerState.HALTED])
def test_setpoints_during_deactivation_are_counted_and_not_logged(
        ros, scripted, capfd, state):
    bench = Bench(ros, launch=scripted([], state=state))
    diagnostics = ros.collect(bench.operator, DiagnosticArray, '/diagnostics')
    bench.send(HOME)
    ros.until(lambda: bench.values()['rejected'] == '1', 'the rejection')
    assert ('setpoint rejected' in capfd.readouterr().err) == (state is ControllerState.HALTED)
    ros.until(lambda: diagnostics, '/diagnostics')
    identities = {one.name.partition(': ')[2]: one.hardware_id for one in diagnostics[-1].status}
    assert identities['q2'] == 'node 2'
    assert identities['operation'] == identities['bus'] == platform.node()


def test_early_request_is_rejected_with_the_next_step(bench):
    statuses = bench.ros.collect(bench.operator, DiagnosticStatus, 'driver/status', LATCHED)
    reply = bench.ask('home')
    assert not reply.success
    assert 'next: configure, home, activate' in reply.message
    assert bench.change(Transition.TRANSITION_CONFIGURE)
    assert bench.states == []  # not homed: the positions are unknown
    assert not bench.change(Transition.TRANSITION_ACTIVATE)
    assert 'home' in bench.message()
    bench.ros.until(lambda: any(
        'activate is not possible' in status.message for status in statuses), 'the reason')
    assert bench.state() == 'inactive'
    bench.ask('home')
    bench.ros.until(lambda: bench.states, 'joint_states')
    bench.send([q + 0.01 for q in HOME])
    bench.ros.until(lambda: bench.node.rejections.total, 'the rejection')
    assert 'setpoint rejected: the drives are inactive' in bench.node.rejections.last_message
    assert bench.position() == pytest.approx(HOME, abs=1e-4)


BAD_SETPOINTS = (
    ((math.nan, 0.1, 0.0), ('q1', 'q2', 'q3'), 'not_finite'),
    ((-0.1, 0.1, 0.0), ('q1', 'q2', 'q2'), 'names'),
    ((-0.1, 0.1), ('q1', 'q2'), 'names'),
    ((0.2, 0.4, 0.3), ('q1', 'q2', 'q3'), 'far_setpoint'),
    ((-0.1, 0.6, 0.0), ('q1', 'q2', 'q3'), 'stroke'),
    ((-0.1, 0.1, -0.09), ('q1', 'q2', 'q3'), 'carriage_gap'),
)


def test_bad_setpoint_is_counted_and_moves_nothing(bench):
    bench.bring_up()
    counts = Counter()
    for positions, names, reason in BAD_SETPOINTS:
        counts[f'rejected: {reason}'] += 1

        def reject(positions=positions, names=names):
            bench.send(positions, (0.0,) * len(positions), names=names)
            bench.ros.until(lambda: bench.node.rejections.total == counts.total(),
                            'the rejection', 5.0)

        patiently(reject)  # a lost setpoint is not repeated
        values = bench.values()
        assert {key: values[key] for key in counts} == {
            key: str(count) for key, count in counts.items()}
        assert bench.state() == 'active'
        assert bench.position() == pytest.approx(HOME, abs=1e-4)


@pytest.mark.quick
def test_changed_limit_is_reported_with_both_values(bench):
    before = bench.values()
    assert before['limits changed'] == ''
    assert before['version'] == version()
    assert re.fullmatch(
        r'simulated.yaml [0-9a-f]{8}, cia402.eds [0-9a-f]{8}', before['profiles'])
    answer, = bench.node.set_parameters([Parameter('limits.speed', value=0.3)])
    assert answer.successful
    after = bench.values()
    assert 'from 0.5 m/s, ' in after['limits changed']
    assert 'to 0.3 m/s, ' in after['limits changed']


def test_self_test_reports_each_part(bench):
    before = bench.ros.call(bench.operator, SelfTest, 'driver/self_test')
    assert before.passed == b'\x01' and before.status[0].message  # a new drive's first question
    bench.change(Transition.TRANSITION_CONFIGURE)
    reply = bench.ros.call(bench.operator, SelfTest, 'driver/self_test')
    failed = {status.name for status in reply.status if status.level != DiagnosticStatus.OK}
    assert failed <= {'cycle'}  # which a busy computer holds up
    assert (reply.passed == b'\x01') == (not failed) and len(reply.status) >= 3


def exit_status(process):
    wait_until(lambda: process.poll() is not None, 'the end of the process')
    return process.returncode


@pytest.fixture
def active_driver(ros_domain, start_process):
    """Start a driver in a separate process and power its drives on; give it and its loop."""
    process = start_process(
        'facade_manipulator.nodes.driver', '--ros-args', '-p', 'simulate_drives:=true',
        '-p', 'controller.heartbeat_timeout:=1.0',
        '-p', 'controller.max_missed_cycles:=10')
    rclpy.init(domain_id=ros_domain)
    try:
        with ManipulatorClient() as client:
            client.configure()
            client.home()
            client.activate()
            yield process, *children(process.pid)
    finally:
        rclpy.try_shutdown()


def wait_for_the_end_of(pid):
    wait_until(lambda: not Path(f'/proc/{pid}').exists()
               or Path(f'/proc/{pid}/stat').read_text().split()[2] == 'Z', 'the end of the loop')


def test_active_driver_ends_cleanly_on_a_signal(active_driver):
    process, loop = active_driver
    os.kill(process.pid, signal.SIGHUP)
    assert exit_status(process) == 0
    wait_for_the_end_of(loop)
    log = process.log.read_text()
    assert 'The drives have confirmed that their power is off; the bus is closed' in log
    assert 'Traceback' not in log


def test_signal_to_node_and_loop_ends_both_cleanly(active_driver):
    """As systemd does: the loop hears it as well as the node."""
    process, loop = active_driver
    os.kill(loop, signal.SIGTERM)
    os.kill(process.pid, signal.SIGTERM)
    assert exit_status(process) == 0
    wait_for_the_end_of(loop)


def test_joining_and_leaving_participants_stop_nothing(active_driver):
    _, loop = active_driver
    for number in range(4):
        context = rclpy.Context()
        context.init()
        visitor = rclpy.create_node(f'visitor_{number}', context=context)
        visitor.create_subscription(JointState, 'joint_states', lambda message: None, 10)
        visitor.create_publisher(Bool, 'software_stop_of_nobody', 10)
        visitor.destroy_node()
        context.try_shutdown()
    with ManipulatorClient(node_name='onlooker') as client:
        assert client.driver_state() == 'active'
    assert Path(f'/proc/{loop}').exists()


@pytest.mark.quick
def test_end_of_the_loop_leaves_the_driver_unconfigured(bench):
    bench.bring_up()
    bench.node._loop._process.kill()
    bench.ros.until(lambda: bench.node.state_label == 'unconfigured', 'unconfigured')
    assert 'the control loop has ended by itself, exit status 0' in bench.message()
    assert bench.values()['next step'].endswith('then configure, home, activate')
    assert not bench.ask('home').success
    bench.bring_up()  # with another one, homed again
    assert bench.state() == 'active'


def test_configure_without_drives_names_the_bus(ros):
    bench = Bench(ros, Parameter('simulate_drives', value=False))
    assert not bench.change(Transition.TRANSITION_CONFIGURE)
    assert "virtual can0 (python-can's bus within one process" in bench.message()


@pytest.mark.quick
def test_repeated_rejected_request_is_logged_once(bench, capfd):
    for _ in range(20):
        assert not bench.ask('home').success
    assert capfd.readouterr().err.count('home is not possible') == 1


def test_impossible_transition_is_rejected_with_the_next_step(bench):
    assert not bench.change(Transition.TRANSITION_ACTIVATE)
    assert bench.message() == ('unconfigured; activate is not possible, the node is unconfigured; '
                               'next: configure, home, activate')
    bench.bring_up()
    assert bench.ask('halt').success
    assert not bench.change(Transition.TRANSITION_ACTIVATE)
    assert bench.message() == (
        'halted; activate is not possible, the node is active; next: clear_faults')
    bench.send(HOME)
    bench.ros.until(lambda: bench.node.rejections.total, 'the rejection')
    assert 'halted' in bench.node.rejections.last_message
    assert bench.ask('clear_faults').success
    bench.stream_to(0.02)


@pytest.mark.quick
def test_second_driver_in_a_namespace_gets_no_power(ros, scripted):
    bench = Bench(ros, launch=scripted([], state=ControllerState.ACTIVE))
    second = ros.add(DriverNode(scripted([]), parameter_overrides=[*SIMULATED]))
    for node in (bench.node, second):
        ros.until(lambda node=node: node.count_publishers('driver/status') == 2, 'two drivers')
    reason = ('another driver runs in namespace /, and both would follow the setpoints; next: '
              'end one of the two')
    assert bench.message() == f'active; {reason}'
    for request in ('configure', 'activate'):
        error = second.transitions[request]().exception(1.0)
        assert str(error) == f'{request} is not possible, {reason}, then {request}'
    assert bench.values()['state'] == 'active'


@pytest.mark.quick
def test_setpoints_of_two_publishers_reach_no_drive(ros, scripted):
    loop = scripted([], state=ControllerState.ACTIVE)
    bench = Bench(ros, launch=loop)
    statuses = ros.collect(bench.operator, DiagnosticStatus, 'driver/status', LATCHED)
    player = ros.node('rosbag2_player')
    foreign = player.create_publisher(JointState, 'joint_setpoints', LATEST)
    fault = 'joint_setpoints has 2 publishers (/operator, /rosbag2_player), bound 1'
    ros.until(lambda: statuses and fault in statuses[-1].message, 'the error')
    assert statuses[-1].level == DiagnosticStatus.ERROR and fault in bench.message()
    bench.send(HOME)
    ros.until(lambda: bench.node.rejections.total == 1, 'the rejection')
    assert bench.values()['rejected: publishers'] == '1'
    kinds = set()
    while (message := loop.channel.receive(0.0)) is not None:
        kinds.add(message.kind)
    assert 'setpoint' not in kinds
    player.destroy_publisher(foreign)
    ros.until(lambda: fault not in bench.message(), 'one publisher')


@pytest.mark.quick
def test_second_driver_is_found_behind_a_remapping(ros, scripted):
    made = [ros.add(DriverNode(
        scripted([]), parameter_overrides=[*SIMULATED],
        cli_args=['--ros-args', '-r', 'driver/status:=/site/status'])) for _ in range(2)]
    for node in made:
        ros.until(lambda node=node: node._requests.rival, 'the other driver')


@pytest.mark.quick
def test_setpoint_reaches_the_loop_unchanged(ros, scripted):
    loop = scripted([], state=ControllerState.ACTIVE)
    bench, heard = Bench(ros, launch=loop), []

    def setpoint():
        message = loop.channel.receive(0.0)
        if message is not None and message.kind == 'setpoint':
            heard.append(message.content)
        return heard

    bench.send(HOME, (0.1, 0.2, 0.3))
    ros.until(setpoint, 'the setpoint')
    (time, positions, velocities), = heard
    assert (positions, velocities) == (HOME, (0.1, 0.2, 0.3))
    assert 0.0 < time - bench.now() + 1.0 < 1.06 and not bench.node.rejections.total


@pytest.mark.quick
def test_stop_is_counted_and_logged_once(ros, scripted, capfd):
    bench = Bench(ros, launch=scripted(
        [], state=ControllerState.STOPPED, causes=(Cause('late', 'wait'),)))
    for _ in range(3):
        bench.node._supervise()
    assert bench.values()['drive faults'] == '1'
    assert capfd.readouterr().err.count('late; next: wait') == 1


def test_configure_at_start_waits_for_the_can_interface(ros, monkeypatch):
    missing = ['the CAN interface can0 is missing or down', '']
    monkeypatch.setattr(BusSettings, 'missing', lambda bus: missing[0])
    bench = Bench(ros, Parameter('configure_at_start', value=True))
    ros.until(lambda: 'configure waits: the CAN interface can0 is' in bench.message(), 'a word')
    assert bench.state() == 'unconfigured'
    missing.pop(0)
    ros.until(lambda: bench.node.state_label == 'inactive', 'drives that are configured')


@pytest.mark.quick
def test_halt_is_answered_within_100_ms_during_configure(ros):
    bench = Bench(ros, Parameter('simulate_drives', value=False))
    change, get, halt = (bench.operator.create_client(*one) for one in (
        topics.CHANGE_STATE, topics.GET_STATE, topics.HALT))
    ros.until(lambda: all(one.service_is_ready() for one in (change, get, halt)), 'services')
    configure = change.call_async(ChangeState.Request(transition=Transition(label='configure')))
    ros.until(lambda: bench.node.state_label == 'configuring', 'the transition')

    def answer_time(client, request):
        begin, reply = time.monotonic(), client.call_async(request)
        ros.until(reply.done, 'the answer')
        return reply.result(), time.monotonic() - begin

    times = []  # a busy computer delays some of the answers
    while not times or min(times) > 0.1:
        reply, elapsed = answer_time(halt, Trigger.Request())
        state, _ = answer_time(get, GetState.Request())
        assert state.current_state.label == 'configuring' and not configure.done()
        assert not reply.success and 'configur' in reply.message
        times.append(elapsed)
    assert bench.ros.call(bench.operator, GetAvailableTransitions,
                          'driver/get_available_transitions').available_transitions
    ros.until(configure.done, 'the end of configure')
    assert not configure.result().success and bench.state() == 'unconfigured'


def test_exception_in_a_callback_stops_the_drives(bench):
    bench.bring_up()
    bench.node.handle_exception(ZeroDivisionError('a defect'))
    bench.ros.until(lambda: bench.values()['state'] == 'stopped', 'the stop')
    assert "a callback of the driver raised ZeroDivisionError('a defect')" in bench.message()
    bench.ros.until(lambda: bench.node.state_label == 'inactive', 'inactive')
