"""Processes of the bench with ROS: `python -m processes EXECUTOR WORD…`."""

from collections import deque
import math
import sys
import time

from cheap_drives import answer, cpu_of, DRIVES, HORIZON, open_bus, report, send, start
from frames import encode_rpdo1
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.canopen.pdo import PDO_MAP
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.planar_messages import seconds
from facade_manipulator.package_files import config_path

STANDING = (-0.1, 0.1, 0.0)  # m, the home position; the head is near (0, 0.25, 0) there
COMMAND = (0x0F, 8, 1000)  # controlword, mode and target [counts]
TOPICS = {
    one.name: one for one in vars(topics).values() if isinstance(one, topics.Topic)
}


def ticks(rate):
    """Yield at a rate [Hz] without end."""
    due = time.monotonic()
    while True:
        yield
        due += 1.0 / rate
        time.sleep(max(0.0, due - time.monotonic()))


def python_can_cycle(rate):
    """Run cycles on python-can."""
    bus = open_bus()
    for _ in ticks(rate):
        send(bus, 0x80, b'')
        for number in DRIVES:
            send(bus, 0x200 + number, encode_rpdo1(*COMMAND))
        while bus.recv(0.0) is not None:
            continue


def canopen_cycle(rate):
    """Run cycles by the manual of canopen."""
    import canopen  # only the process that measures it has its memory

    network = canopen.Network(bus=open_bus())
    commands = []
    seen = deque(maxlen=9)
    network.connect()
    for number in DRIVES:
        node = network.add_node(number, str(config_path('drives/cia402.eds')))
        commands.append(node.rpdo[1])
        for ours in PDO_MAP:
            pdo = (node.tpdo if ours.is_transmitted else node.rpdo)[ours.number]
            pdo.clear()
            for index in ours.indices:
                pdo.add_variable(index)
            pdo.cob_id = ours.cob_id(number)
            pdo.enabled = True
            pdo.subscribe()
            pdo.add_callback(lambda one: seen.append([item.raw for item in one.map]))
    for _ in ticks(rate):
        network.sync.transmit()
        for command in commands:
            for item, value in zip(command.map, COMMAND, strict=True):
                item.raw = value
            command.transmit()


CYCLES = {'python_can': python_can_cycle, 'canopen': canopen_cycle}


class Role(Node):
    """
    Publisher and relay by words SOURCE>TARGET: a rate [Hz] or a topic, and a topic.

    The target '' drops a message, '!' records its latency, and a name in CYCLES runs a CAN cycle.
    """

    def __init__(self, words):
        super().__init__('role', namespace='bench')
        self._latencies = []
        for source, target in (word.split('>') for word in words):
            if target in CYCLES:
                start(answer, int(source))
                start(CYCLES[target], int(source))
                continue
            react = {'': id, '!': self._note}.get(target) or self._publishing(target)
            if source in TOPICS:
                topic = TOPICS[source]
                self.create_subscription(*topic[:2], react, topic.subscription_qos)
            else:
                self.create_timer(1.0 / float(source), react)
            if target == '!':
                start(report, self._latencies, self._measure)

    def _note(self, message):
        self._latencies.append(time.time() - seconds(message.header.stamp) + HORIZON)

    def _measure(self):
        cycle = cpu_of('cycle', 'Notifier')
        return bool(cycle) * (time.process_time() - cycle - cpu_of('answer')), cycle

    def _publishing(self, name):
        """Return a callback that publishes a relayed stamp, or a machine that sways by 5 mm."""
        publisher = self.create_publisher(*TOPICS[name])
        message = TOPICS[name].type()
        of_facade = name in ('goal_pose', 'disturbance')
        message.header.frame_id = 'bench/facade' if of_facade else 'bench/rail'
        ahead = HORIZON * (name in ('corrected_pose', 'joint_setpoints'))
        pose = getattr(message, 'pose', None)
        if pose is None:
            message.name = AXIS_NAMES
            message.position = STANDING
            message.velocity = (0.0,) * 3
        elif name == 'disturbance':
            pose.covariance[[0, 7, 35]] = 1e-6
        else:
            pose.position.y = 0.25

        def publish(relayed=None):
            now = time.time()
            message.header.stamp = (
                relayed.header.stamp if relayed else stamp(now + ahead)
            )
            if pose is None and not relayed:
                message.position = [place + 0.005 * math.sin(now) for place in STANDING]
                message.velocity = 3 * [0.005 * math.cos(now)]
            elif name != 'goal_pose' and not relayed:
                getattr(pose, 'pose', pose).position.x = 0.005 * math.sin(now)
            publisher.publish(message)

        return publish


def main(executor, *words):
    """Run one process until SIGINT."""
    rclpy.init()
    executor = {'events': EventsExecutor, 'single': SingleThreadedExecutor}[executor]()
    executor.add_node(Role(words))
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.2)


if __name__ == '__main__':
    main(*sys.argv[1:])
