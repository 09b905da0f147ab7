"""Processes of the bench with ROS: `python -m processes KIND WORD… --ros-args …`."""

from collections import deque
import math
import signal
import struct
import sys
from threading import enumerate as all_threads
import time

from cheap_drives import answer, cpu_of, DRIVES, HORIZON, open_bus, PATIENCE, report, send, started
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.canopen.pdo import PDO_MAP
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.messages import CARRIAGES, seconds
from facade_manipulator.resources import config_path

STANDING = (-0.1, 0.1, 0.0)  # m, the home position; the head is near (0, 0.25, 0) there
TOPICS = {one.name: one for one in vars(topics).values() if isinstance(one, topics.Topic)}


def keep_pace(function, rate):
    """Call a function at a rate [Hz] without end."""
    due = time.monotonic()
    while True:
        function()
        due += 1.0 / rate
        time.sleep(max(0.0, due - time.monotonic()))


def python_can_cycle():
    """Return a function that does one cycle on python-can."""
    bus = open_bus()

    def turn():
        send(bus, 0x80, b'')
        for number in DRIVES:
            send(bus, 0x200 + number, struct.pack('<Hbi', 0x0F, 8, 1000))
        while bus.recv(0.0) is not None:
            continue

    return turn


def canopen_cycle():
    """Return a function that does one cycle by the manual of canopen."""
    import canopen  # only the process that measures it has its memory

    network, commands, seen = canopen.Network(bus=open_bus()), [], deque(maxlen=9)
    network.connect()
    for number in DRIVES:
        node = network.add_node(number, str(config_path('drives/cia402.eds')))
        commands.append(node.rpdo[1])
        for ours in PDO_MAP:
            pdo = (node.tpdo if ours.is_transmitted else node.rpdo)[ours.number]
            pdo.clear()
            for index in ours.indices:
                pdo.add_variable(index)
            pdo.cob_id, pdo.enabled = ours.cob_id(number), True
            pdo.subscribe()
            pdo.add_callback(lambda one: seen.append([item.raw for item in one.map]))

    def turn():
        network.sync.transmit()
        for command in commands:
            for item, value in zip(command.map, (0x0F, 8, 1000), strict=True):
                item.raw = value
            command.transmit()

    return turn


CYCLES = {'python_can': python_can_cycle, 'canopen': canopen_cycle}


class Role(Node):
    """
    Publisher and relay by words SOURCE>TARGET: a rate [Hz] or a topic, and a topic.

    The target '' drops a message, '!' records its latency, and a name in CYCLES runs a CAN cycle.
    """

    def __init__(self, words):
        super().__init__('role')
        self._latencies, self._positions, self._threads = [], STANDING, []
        for source, target in (word.split('>') for word in words):
            if target in CYCLES:
                self._threads = [
                    started(answer, open_bus(), int(source)),
                    started(keep_pace, CYCLES[target](), int(source)),
                    *(one for one in all_threads() if 'notifier' in one.name.lower())]
                continue
            react = {'': self._hear, '!': self._note}.get(target) or self._publishing(target)
            if source in TOPICS:
                topic = TOPICS[source]
                self.create_subscription(topic.type, source, react, topic.qos)
            else:
                self.create_timer(1.0 / float(source), react)
            if target == '!':
                started(report, self._latencies, self._measure)

    def _hear(self, message):
        self._positions = getattr(message, 'position', STANDING)

    def _note(self, message):
        self._latencies.append(time.time() - seconds(message.header.stamp) + HORIZON)

    def _measure(self):
        apart = [cpu_of(one) for one in self._threads]
        return bool(apart) * (time.process_time() - sum(apart)), sum(apart[1:])

    def _publishing(self, name):
        """Return a callback that publishes a relayed stamp, or a motion of the machine."""
        out, message = self.create_publisher(*TOPICS[name]), TOPICS[name].type()
        of_facade = name in ('goal_pose', 'disturbance')
        message.header.frame_id = 'bench/facade' if of_facade else 'bench/rail'
        pose = getattr(message, 'pose', None)
        if pose is None:
            message.name, message.position, message.velocity = CARRIAGES, STANDING, (0.0,) * 3
        elif name == 'disturbance':
            pose.covariance[[0, 7, 35]] = 1e-6
        else:
            pose.position.y = 0.25

        def publish(relayed=None):
            now = time.time()
            shift = 0.02 * math.sin(now)
            if relayed:
                message.header.stamp = relayed.header.stamp
            else:
                ahead = name in ('corrected_pose', 'joint_setpoints')
                message.header.stamp = stamp(now + HORIZON * ahead)
                if name == 'joint_states':
                    message.position = self._positions
                elif pose is None:
                    message.position = [place + 0.25 * shift for place in STANDING]
                    message.velocity = 3 * [0.005 * math.cos(now)]
                elif name != 'goal_pose':
                    getattr(pose, 'pose', pose).position.x = shift
            out.publish(message)

        return publish


def main(kind, *words):
    """Run one process until SIGINT."""
    signal.alarm(PATIENCE)
    rclpy.init(args=sys.argv)
    executor = {'events': EventsExecutor, 'single': SingleThreadedExecutor}[kind]()
    executor.add_node(Role(words[:words.index('--ros-args')]))
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.2)
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
