"""
Processes around the nodes under test: empty relays in their places, their inputs, a listener.

`ros_roles.py ROLE EXECUTOR RATE`. A relay passes on as many messages of the same types as the
node it stands for, and does nothing else. The listener tells the latencies of what it hears from
the line `begin` on stdin to the line `end`.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import math
import signal
import sys
from threading import Event, Thread
import time

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from facade_manipulator import interfaces
from facade_manipulator.kinematics import Geometry, inverse_kinematics, Pose
from facade_manipulator.messages import CARRIAGES, Frames, seconds
from facade_manipulator.ros import publisher, subscription
from facade_manipulator.ros.codec import setpoint_codec
from facade_manipulator.ros.conversions import frames, pose_stamped, stamp
from facade_manipulator.ros.interfaces import is_installed
from facade_manipulator.ros.runtime import choose_executor

HORIZON = 0.06
JOINT_STATES_PERIOD = 0.01
GOAL_PERIOD = 0.5
PLACE = Pose(0.0, 0.25, 0.0)
VARIANCES = (0, 7, 35)


class CompensatorRelay(Node):
    """Hears what the compensator hears, publishes what it publishes."""

    def __init__(self, rate: float) -> None:
        super().__init__('compensator')
        subscription(self, interfaces.GOAL_POSE, self.take)
        subscription(self, interfaces.END_EFFECTOR_POSE, self.take)
        subscription(self, interfaces.DISTURBANCE, self.take)
        self._corrected = publisher(self, interfaces.CORRECTED_POSE)
        self._reference = publisher(self, interfaces.REFERENCE)
        self._message = pose_stamped(frames(self).rail, 0.0, PLACE)
        self.create_timer(1.0 / rate, self._relay)

    def take(self, message) -> None:
        """Do nothing with it."""

    def _relay(self) -> None:
        self._message.header.stamp = stamp(time.time() + HORIZON)
        self._corrected.publish(self._message)
        if self._reference.get_subscription_count() > 0:
            self._reference.publish(self._message)


class IkRelay(Node):
    """Passes corrected_pose on as joint_setpoints, joint_states as end_effector_pose."""

    def __init__(self, _) -> None:
        super().__init__('ik_service')
        self._setpoints = publisher(self, interfaces.JOINT_SETPOINTS)
        self._heads = publisher(self, interfaces.END_EFFECTOR_POSE)
        subscription(self, interfaces.CORRECTED_POSE, self._relay)
        subscription(self, interfaces.JOINT_STATES, self._relay_back)
        self._message = JointState(
            header=Header(frame_id=frames(self).rail), name=CARRIAGES, position=(0.0,) * 3,
            velocity=(0.0,) * 3)
        self._head = pose_stamped(frames(self).rail, 0.0, PLACE)

    def _relay(self, message: PoseStamped) -> None:
        self._message.header.stamp = message.header.stamp
        self._setpoints.publish(self._message)

    def _relay_back(self, message: JointState) -> None:
        self._head.header.stamp = message.header.stamp
        self._heads.publish(self._head)


class DeploymentRelay(IkRelay):
    """Both in one callback: what the way through one process costs with nothing decided."""

    def __init__(self, rate: float) -> None:
        super().__init__(rate)
        for topic in (interfaces.GOAL_POSE, interfaces.END_EFFECTOR_POSE, interfaces.DISTURBANCE):
            subscription(self, topic, self._hear)
        self._pose = pose_stamped(frames(self).rail, 0.0, PLACE)
        self.create_timer(1.0 / rate, self._tick)

    def _hear(self, message) -> None:
        """Do nothing with it."""

    def _tick(self) -> None:
        self._pose.header.stamp = stamp(time.time() + HORIZON)
        self._relay(self._pose)


class RecorderRelay(Node):
    """Hears what the recorder records."""

    def __init__(self, _) -> None:
        super().__init__('recorder')
        for topic in interfaces.TOPICS:
            if topic.recorded and is_installed(topic):
                subscription(self, topic, self.take, raw=True)

    def take(self, data: bytes) -> None:
        """Do nothing with it."""


class Estimates(Node):
    """Supervisor and estimator as far as the nodes hear them; the gondola moves, but little."""

    def __init__(self, rate: float) -> None:
        super().__init__('inputs')
        self._goals = publisher(self, interfaces.GOAL_POSE)
        self._disturbances = publisher(self, interfaces.DISTURBANCE)
        self._disturbance = PoseWithCovarianceStamped()
        self._disturbance.header.frame_id = frames(self).facade
        for index in VARIANCES:
            self._disturbance.pose.covariance[index] = 1e-6
        self.create_timer(1.0 / rate, self._sway)
        self.create_timer(GOAL_PERIOD, self._tell_goal)

    def _sway(self) -> None:
        now = time.time()
        self._disturbance.header.stamp = stamp(now)
        self._disturbance.pose.pose.position.x = 0.02 * math.sin(now)
        self._disturbances.publish(self._disturbance)

    def _tell_goal(self) -> None:
        self._goals.publish(pose_stamped(frames(self).facade, time.time(), PLACE))


class Inputs(Estimates):
    """The driver as well."""

    def __init__(self, rate: float) -> None:
        super().__init__(rate)
        self._states = publisher(self, interfaces.JOINT_STATES)
        self._carriages = inverse_kinematics(Geometry(), PLACE)
        subscription(self, interfaces.JOINT_SETPOINTS, self._follow)
        self.create_timer(JOINT_STATES_PERIOD, self._tell_states)

    def _follow(self, message: JointState) -> None:
        if any(message.position):  # a relay's are all 0
            self._carriages = message.position

    def _tell_states(self) -> None:
        self._states.publish(JointState(
            header=Header(stamp=stamp(time.time())), name=CARRIAGES,
            position=self._carriages, velocity=(0.0,) * 3, effort=(0.0,) * 3))


class Poses(Inputs):
    """A compensator's output on top, for the ik_service alone."""

    def __init__(self, rate: float) -> None:
        super().__init__(1.0)
        self._corrected = publisher(self, interfaces.CORRECTED_POSE)
        self.create_timer(1.0 / rate, self._tell_pose)

    def _tell_pose(self) -> None:
        now = time.time()
        self._corrected.publish(pose_stamped(
            frames(self).rail, now + HORIZON, Pose(0.02 * math.sin(now), PLACE.y, 0.0)))


class Setpoints(Node):
    """An ik_service's output for the driver alone: a sway about where the carriages stand."""

    def __init__(self, rate: float) -> None:
        super().__init__('setpoints')
        self._begin = time.time()
        self._home: tuple[float, ...] = ()
        self._message = JointState(header=Header(frame_id=frames(self).rail), name=CARRIAGES)
        self._setpoints = publisher(self, interfaces.JOINT_SETPOINTS)
        subscription(self, interfaces.JOINT_STATES, self._stand)
        self.create_timer(1.0 / rate, self._tell)

    def _stand(self, message: JointState) -> None:
        if not self._home:
            self._begin, self._home = time.time(), tuple(message.position)

    def _tell(self) -> None:
        if not self._home:
            return
        now = time.time()
        phase = now - self._begin
        shift, speed = 0.005 * (1.0 - math.cos(phase)), 0.005 * math.sin(phase)
        self._message.header.stamp = stamp(now + HORIZON)
        self._message.position = [place + shift for place in self._home]
        self._message.velocity = (speed,) * 3
        self._setpoints.publish(self._message)


class Listener(Node):
    """Measures how late messages are: now less the instant at which their sender began."""

    def __init__(self, topic: interfaces.Topic, read: Callable | None = None) -> None:
        super().__init__('listener')
        self._latencies: list[float] = []
        self._read = read or (lambda message: (seconds(message.header.stamp), message))
        subscription(self, topic, self._hear, raw=read is not None)
        Thread(target=self._obey, daemon=True).start()

    def _hear(self, message) -> None:
        time_meant, _ = self._read(message)
        self._latencies.append(time.time() - (time_meant - HORIZON))

    def _obey(self) -> None:
        for word in sys.stdin:
            if word.strip() == 'begin':
                self._latencies = []
            else:
                print(json.dumps(self._latencies), flush=True)


ROLES = {
    'compensator_relay': CompensatorRelay,
    'ik_relay': IkRelay,
    'deployment_relay': DeploymentRelay,
    'recorder_relay': RecorderRelay,
    'estimates': Estimates,
    'inputs': Inputs,
    'poses': Poses,
    'setpoints': Setpoints,
    'hear_poses': lambda _: Listener(interfaces.CORRECTED_POSE),
    'hear_setpoints': lambda _: Listener(interfaces.JOINT_SETPOINTS),
    'hear_as_the_driver': lambda _: Listener(
        interfaces.JOINT_SETPOINTS, setpoint_codec(Frames.of('bench').rail).read),
}


def main() -> None:
    """Spin one role until SIGINT."""
    role, kind, rate = sys.argv[1:4]
    stopping = Event()
    signal.signal(signal.SIGINT, lambda *_: stopping.set())
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    executor = choose_executor() if kind == 'events' else SingleThreadedExecutor()
    executor.add_node(ROLES[role](float(rate)))
    while not stopping.is_set():
        executor.spin_once(timeout_sec=0.2)


if __name__ == '__main__':
    main()
