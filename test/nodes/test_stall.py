"""The manipulator's process stands still while the drives move: they brake, hold and go on."""

import math
import os
import signal

import can
from frames import decode_rpdo1
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from loop_bench import LoopThread
import pytest
from rclpy.parameter import Parameter
from support import patiently

from facade_manipulator.canopen import pdo
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.kinematics import Pose
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.nodes.conversions import pose_stamped
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.topics import LATEST

STALL = 0.35  # s, as Fast DDS may stand still while a participant joins
# a C call that holds the interpreter's lock, and the executor with it
STALLING = f"""
import ctypes, signal, sys
from facade_manipulator.nodes.manipulator import main
signal.signal(signal.SIGUSR1, lambda *_: ctypes.PyDLL(None).usleep({int(1e6 * STALL)}))
sys.exit(main())
"""
PERIOD, LIMITS = 0.01, MotionLimits()
SWAY, SWAY_PERIOD = 0.15, 3.0  # m, s: the carriages follow with up to 0.31 m/s
FAST, JITTER = 0.2, 0.001  # m/s, s
GOAL = Pose(0.0, 0.25, 0.0)


class Machine:
    """Driver and bus in this process, the manipulator in another one, a sway that both follow."""

    def __init__(self, ros, start_process, tmp_path):
        (tmp_path / 'stalling.py').write_text(STALLING)
        self.process = start_process('stalling')
        channel = f'stall {os.getpid()}'
        self.bus = can.Bus(interface='virtual', channel=channel, ignore_config=True)
        self.node = ros.add(DriverNode(launch=LoopThread, parameter_overrides=[
            Parameter('simulate_drives', value=True), Parameter('bus.channel', value=channel),
            Parameter('controller.heartbeat_timeout', value=1.0),
            Parameter('controller.max_missed_cycles', value=10)]))
        self._supervisor = ros.node('supervisor')
        self._goals = self._supervisor.create_publisher(PoseStamped, 'goal_pose', LATEST)
        self._estimates = self._supervisor.create_publisher(
            PoseWithCovarianceStamped, 'disturbance', LATEST)
        self._supervisor.create_timer(0.02, self._sway)
        self.until = ros.until
        self._ask('configure', 'home', 'activate')

    def _ask(self, *names):
        for name in names:
            job = self.node._loop.request(name)
            self.until(job.done, name)
            job.result(0.0)

    def recover(self):
        """Go on where a machine that is too busy has stopped the drives."""
        if self.node._loop.snapshot().state is ControllerState.STOPPED:
            self._ask('clear_faults', 'activate')

    def _sway(self):
        now = self._supervisor.get_clock().now()
        x = SWAY * math.sin(2.0 * math.pi * 1e-9 * now.nanoseconds / SWAY_PERIOD)
        message = PoseWithCovarianceStamped()
        message.header.frame_id, message.header.stamp = 'facade', now.to_msg()
        message.pose.pose.position.x = x
        message.pose.pose.orientation.w = 1.0
        self._estimates.publish(message)
        self._goals.publish(pose_stamped('facade', 0.0, GOAL))

    @property
    def status(self):
        return self.node._loop.stream_status()

    @property
    def is_following(self):
        """Return whether the carriages follow fast; fail where they are stopped."""
        snapshot = self.node._loop.snapshot()
        assert snapshot.state is ControllerState.ACTIVE, snapshot.cause
        return self.status.activity == 'following' and abs(snapshot.axes[2].velocity) > FAST

    def targets(self):
        """Return 607A of q3 [m] and the time of its SYNC, cycle by cycle, since last asked."""
        found, sync, axis = [], None, DEFAULT_AXES[2]
        while (frame := self.bus.recv(0.0)) is not None:
            if frame.arbitration_id == pdo.SYNC_COB_ID:
                sync = frame.timestamp
            elif sync and frame.arbitration_id == pdo.RPDO1.cob_id(axis.node_id):
                command = decode_rpdo1(bytes(frame.data))
                found.append((sync, axis.to_metres(command.target_counts)))
        return found


@pytest.fixture
def machine(ros, start_process, tmp_path):
    machine = Machine(ros, start_process, tmp_path)
    yield machine
    machine.bus.shutdown()


def test_a_manipulator_that_stands_still_makes_the_carriages_brake_smoothly_and_go_on(machine):
    def prove():
        machine.until(lambda: machine.is_following, 'speed')
        brakes = machine.status.brakes
        machine.targets()
        os.kill(machine.process.pid, signal.SIGUSR1)
        machine.until(lambda: machine.status.brakes > brakes, 'the pause')
        machine.until(lambda: machine.is_following, 'the carriages to go on by themselves')
        speed, acceleration = greatest(machine.targets())
        assert FAST < speed < 1.02 * LIMITS.speed
        assert acceleration < 1.1 * LIMITS.acceleration

    patiently(prove, machine.recover)


def greatest(targets):
    """Return the greatest speed and acceleration of targets in cycles without a late SYNC."""
    speeds, accelerations = [], []
    for (first, a), (second, b), (third, c) in zip(
            targets, targets[1:], targets[2:], strict=False):
        if max(abs(second - first - PERIOD), abs(third - second - PERIOD)) < JITTER:
            speeds.append(abs(c - b) / PERIOD)
            accelerations.append(abs(c - 2.0 * b + a) / PERIOD ** 2)
    assert len(accelerations) > 20
    return max(speeds), max(accelerations)
