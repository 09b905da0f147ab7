"""The control loop and its node: each survives the other, and nothing holds the loop up."""

from __future__ import annotations

from dataclasses import replace
import socket
import subprocess
import time

from command_watch import CommandWatch
from frames import decode_rpdo1
from loop_bench import AHEAD, CONTROLLER, loop_setup, LoopThread, PATIENCE
import pytest
from support import wait_until

from facade_manipulator.canopen import pdo
from facade_manipulator.control_loop import control_loop as control_loop_module
from facade_manipulator.control_loop import process as process_module
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import Controlword, Mode, State
from facade_manipulator.errors import DriveError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.guard import mechanism_guard
from facade_manipulator.motion.setpoints import Setpoint

pytestmark = pytest.mark.quick

RAMP_TIME = 3.0  # s: bound of the way to rest and power off


def in_thread(make_bench, **controller):
    """Return a bench whose drives and bus can be looked at."""
    return make_bench(loop_setup(replace(CONTROLLER, **controller)), launch=LoopThread)


def targets(frames):
    """Yield the three targets [m] of each cycle that enables the drives."""
    found = {}
    for frame in frames:
        node = frame.arbitration_id - pdo.RPDO1.cob_id(0)
        if node in (1, 2, 3):
            command = decode_rpdo1(bytes(frame.data))
            if (command.controlword & 0x0F == Controlword.ENABLE_OPERATION
                    and command.mode == Mode.CYCLIC_SYNCHRONOUS_POSITION):
                found[node] = loop_setup().axes[node - 1].to_metres(command.target_counts)
                if node == 3 and len(found) == 3:
                    yield found[1], found[2], found[3]


def assert_orderly_end(bench, loop):
    """Check that the carriages came to rest inside the limits, then lost power, on commands."""
    begin = time.monotonic()
    assert bench.process._process.wait(PATIENCE) == 0
    assert time.monotonic() - begin < RAMP_TIME
    frames = bench.frames()
    watch = CommandWatch(bench.setup.axes, CONTROLLER.period)
    watch.take(frames)
    assert watch.enabling and not watch.complaints
    guard = mechanism_guard(Geometry())
    for positions in targets(frames):
        guard(positions)
    words = [decode_rpdo1(bytes(frame.data)).controlword for frame in frames
             if frame.arbitration_id == pdo.RPDO1.cob_id(1)]
    assert Controlword.QUICK_STOP not in words
    assert words[-1] == Controlword.DISABLE_VOLTAGE
    assert loop.controller.snapshot().state is ControllerState.CLOSED
    states = [drive.state for drive in loop.simulator._drives]
    assert states == [State.SWITCH_ON_DISABLED] * 3


# --- the node ends, hangs, or is slow

def shut_down(bench):
    """Do what the kernel does for a node that is killed."""
    bench.process._channel._socket.shutdown(socket.SHUT_RDWR)


@pytest.mark.parametrize('watchdog_timeout, leave, is_error', [
    (2.0, shut_down, True), (0.3, lambda bench: None, True),
    (2.0, lambda bench: bench.process.close(), False)], ids=['ends', 'hangs', 'closes'])
def test_a_node_that_ends_at_full_speed_however_leaves_carriages_that_ramp_down(
        make_bench, caplog, watchdog_timeout, leave, is_error):
    bench = in_thread(make_bench, watchdog_timeout=watchdog_timeout)
    bench.move()
    loop = bench.loop
    bench.streams.clear()
    bench.feeds.clear()
    leave(bench)
    assert_orderly_end(bench, loop)
    assert caplog.text.count('the carriages ramp down and the power goes off') == is_error


def test_a_node_that_hangs_while_the_drives_are_stopped_leaves_no_power(make_bench):
    """As where a starved loop has stopped them: they hold with power, and nobody cuts it."""
    bench = in_thread(make_bench, watchdog_timeout=1.0)
    bench.do('configure', 'home', 'activate')
    loop = bench.loop
    bench.process.stop('the control loop stood still')
    bench.until(ControllerState.STOPPED)
    assert bench.process.snapshot().cause == 'the control loop stood still'
    bench.feeds.clear()
    assert bench.process._process.wait(PATIENCE) == 0
    assert {drive.state for drive in loop.simulator._drives} == {State.SWITCH_ON_DISABLED}


def test_a_node_that_hangs_while_nothing_has_power_ends_nothing(make_bench, caplog):
    bench = in_thread(make_bench, watchdog_timeout=0.1)
    bench.do('configure', 'home')
    bench.feeds.clear()
    with pytest.raises(subprocess.TimeoutExpired):
        bench.process._process.wait(0.5)
    assert bench.state is ControllerState.INACTIVE
    shut_down(bench)
    assert bench.process._process.wait(PATIENCE) == 0
    assert 'ramp down' not in caplog.text


def test_a_node_that_reads_nothing_holds_nothing_up(make_bench, monkeypatch):
    monkeypatch.setattr(process_module, 'MAX_UNANSWERED', 10_000)
    bench = in_thread(make_bench)
    bench.move()
    with monkeypatch.context() as patch:
        patch.setattr(bench.process, 'read', lambda: None)
        before = bench.loop._channel.dropped  # states while it was configured
        wait_until(lambda: bench.loop._channel.dropped > before, 'a full channel')
        test = bench.process.request('self_test')
        cycle = bench.loop.controller.snapshot().cycle
        wait_until(
            lambda: bench.loop.controller.snapshot().cycle.cycles > cycle.cycles + 50, 'cycles')
        snapshot = bench.loop.controller.snapshot()
        assert snapshot.state is ControllerState.ACTIVE, snapshot.cause
    wait_until(lambda: bench.process.stream_status().dropped, 'the newest state')
    with pytest.raises(DriveError, match='while powered: deactivate first'):  # no answer gets lost
        test.result(PATIENCE)


def test_a_message_that_makes_no_sense_ends_nothing(make_bench):
    bench = in_thread(make_bench)
    channel = bench.process._channel
    for message in (('nonsense',), ('request', 1, 'nonsense'), ('setpoint', 'x'), ('limits',)):
        channel.send(*message)
    channel._socket.send(b'garbage')
    assert 'power: confirmed off' in bench.do('configure')


# --- what goes through

def test_how_early_setpoints_come_is_said_once_a_second(make_bench):
    bench, found = in_thread(make_bench), set()
    bench.move()
    begin = time.monotonic()
    while time.monotonic() < begin + 2.0:
        time.sleep(0.1)
        found.add(bench.process.stream_status().margins)
    late, typical = max(found)
    assert 2 <= len(found) <= 4 and 0.0 < late <= typical <= AHEAD


def test_faults_and_forces_reach_simulated_drives(make_bench):
    bench, forces = in_thread(make_bench), [1.0, 2.0, 3.0]
    bench.do('configure')
    bench.process.apply_forces(forces)
    bench.process.disturb(1, 'inject_fault', 0x8611)
    bench.until(ControllerState.STOPPED)
    assert bench.process.snapshot().causes[0].axis == 'q2'
    assert [one.motor.external_force for one in bench.loop.simulator._drives] == forces


def test_faults_and_forces_that_simulated_drives_get_change_nothing_of_real_ones(
        make_bench, caplog):
    bench = make_bench(replace(loop_setup(), simulate=None), launch=LoopThread)
    bench.process.apply_forces([1.0, 2.0, 3.0])
    bench.process.disturb(1, 'inject_fault', 0x8611)
    with pytest.raises(DriveError, match='not configured'):  # what came before is done by then
        bench.do('activate')
    assert 'failed' not in caplog.text


def test_rejected_setpoints_come_back_with_reason_and_message(make_bench):
    bench = in_thread(make_bench)
    bench.do('configure', 'home', 'activate')
    bench.process.send_setpoint(Setpoint(time.time() + 0.06, (0.3, 0.4, 0.35), (0.0,) * 3))
    wait_until(lambda: bench.rejections, 'the rejection')
    reason, message = bench.rejections[0]
    assert reason == 'far_setpoint' and 'is above the bound 0.05 m' in message


def test_limits_and_stream_are_changed_while_it_runs_and_kept_for_another_loop(make_bench):
    bench = in_thread(make_bench)
    limits = replace(bench.setup.limits, speed=0.1)
    stream = replace(bench.setup.stream, first_step=0.02)
    bench.process.change(limits=limits)
    bench.process.change(stream=stream)
    follower = bench.loop.follower
    wait_until(lambda: follower._limiter.limits is not bench.setup.limits
               and follower.settings == stream, 'the change')
    assert follower._limiter.limits == limits
    assert (bench.process._setup.limits, bench.process._setup.stream) == (limits, stream)


def test_an_interface_that_takes_long_to_open_is_waited_for(make_bench, monkeypatch):
    monkeypatch.setattr(process_module, 'MAX_UNANSWERED', 20)
    bench = in_thread(make_bench)
    open_bus = control_loop_module.open_bus
    monkeypatch.setattr(
        control_loop_module, 'open_bus', lambda bus: (time.sleep(1.0), open_bus(bus))[1])
    assert 'configured' in bench.do('configure')


def test_a_loop_that_is_started_again_gets_what_was_changed_meanwhile(make_bench):
    bench = in_thread(make_bench)
    launch, limits = bench.process._launch, replace(bench.setup.limits, speed=0.1)

    def launch_late(end):
        bench.process.change(limits=limits)
        bench.process.feed()
        return launch(end)

    bench.process._process.kill()
    bench.until(ControllerState.LOST)
    bench.process._launch = launch_late
    bench.process.start()
    assert 'homed' in bench.do('configure', 'home')
