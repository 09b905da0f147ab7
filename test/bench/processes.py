"""
Processes of the bench: `python -m processes KIND WORD… --ros-args …`.

A listener prints two lines, before and after the measured time. A line has the latencies [s] since
the previous line, and the processor time [s] without the CAN cycle and of the cycle.
"""

from collections import deque
import json
import math
import os
from pathlib import Path
import signal
import struct
import subprocess
import sys
from threading import enumerate as all_threads
from threading import main_thread, Thread
import time

import can
import canopen
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.canopen.pdo import PDO_MAP
from facade_manipulator.control_loop import __main__ as loop_program
from facade_manipulator.control_loop.control_loop import ControlLoop
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.nodes.messages import CARRIAGES, seconds
from facade_manipulator.nodes.run import run
from facade_manipulator.resources import config_path

PATIENCE = 90  # s
HORIZON = 0.06  # s, of the stamps of poses and setpoints
STANDING = (-0.1, 0.1, 0.0)  # m, the home position; the head is near (0, 0.25, 0) there
TOPICS = {one.name: one for one in vars(topics).values() if isinstance(one, topics.Topic)}
DRIVES = (1, 2, 3)
# what drives send besides TPDO1: COB-ID, data, and in which cycles at 500 and at 100 Hz
OTHERS = ((0x280, bytes(8), {500: 10, 100: 1}), (0x380, bytes(8), {500: 50, 100: 10}),
          (0x700, b'\x05', {500: 25, 100: 5}))


def cpu_of(thread):
    """Return the processor time of a thread [s]."""
    return time.clock_gettime(time.pthread_getcpuclockid(thread.ident))


def cpu_of_process(pid):
    """Return the processor time of a process [s]."""
    return 1e-9 * sum(int(path.read_text().split()[0])
                      for path in Path(f'/proc/{pid}/task').glob('*/schedstat'))


def started(function, *arguments):
    """Return a thread that runs a function."""
    thread = Thread(target=function, args=arguments, daemon=True)
    thread.start()
    return thread


def keep_pace(function, rate):
    """Call a function at a rate [Hz] without end."""
    due = time.monotonic()
    while True:
        function()
        due += 1.0 / rate
        time.sleep(max(0.0, due - time.monotonic()))


def report(take):
    """Print the result of `take` before and after the measured time, once latencies exist."""
    while not take()[0]:
        time.sleep(0.1)
    for pause in os.environ['BENCH_TIMES'].split():
        time.sleep(float(pause))
        print(json.dumps(take()), flush=True)


def open_bus():
    return can.Bus(interface='virtual', channel='bench')


def send(bus, cob_id, data):
    bus.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))


def answer(bus, rate):
    """Answer like three drives at their commanded positions, with minimum processor time."""
    frames = {base + number: (every[rate], data) for base, data, every in OTHERS
              for number in DRIVES}
    count = 0
    for message in bus:
        if message.arbitration_id == 0x80:
            count += 1
            for cob_id, (every, data) in frames.items():
                if count % every == 0:
                    send(bus, cob_id, data)
        elif message.arbitration_id - 0x200 in DRIVES:
            status = struct.pack('<Hb', 0x1237, 8) + message.data[3:]
            frames[message.arbitration_id - 0x80] = (1, status)


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
                started(report, self._take)

    def _hear(self, message):
        self._positions = getattr(message, 'position', STANDING)

    def _note(self, message):
        self._latencies.append(time.time() - seconds(message.header.stamp) + HORIZON)

    def _take(self):
        latencies, self._latencies = self._latencies, []
        apart = [cpu_of(one) for one in self._threads]
        return latencies, bool(apart) * (time.process_time() - sum(apart)), sum(apart[1:])

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


class ObservedLoop(ControlLoop):
    """Control loop that gets ready by itself; cheap drives replace the simulated drives."""

    def __init__(self, setup, *channel):
        super().__init__(setup, *channel)
        self._latencies, self._sending, self._feeds = [], 0.0, 0
        self._rate = setup.controller.rate
        started(self._begin)

    def _feed(self):
        super()._feed()
        self._feeds += 1

    def _add_setpoint(self, meant, *rest):
        super()._add_setpoint(meant, *rest)
        self._latencies.append(time.time() - meant + HORIZON)

    def _send_state(self, snapshot):
        begin = time.thread_time()
        super()._send_state(snapshot)
        self._sending += time.thread_time() - begin

    def _begin(self):
        while self._feeds < 2:  # until the node runs: the first is that of the loop itself
            time.sleep(0.05)
        for request in ('configure', 'home', 'activate'):
            self.controller.request(request).result(PATIENCE)
        drives = started(answer, open_bus(), self._rate)
        self.simulator.stop()

        def take():
            latencies, self._latencies = self._latencies, []
            channel = cpu_of(main_thread()) + self._sending
            cycle = time.process_time() - cpu_of(drives) - channel
            return latencies, channel + cpu_of_process(os.getppid()), cycle

        report(take)


def launch(end):
    """Start the observed loop."""
    number = end.fileno()
    return subprocess.Popen([sys.executable, __file__, 'loop', str(number)], pass_fds=[number])


def main(kind, *words):
    """Run one process until SIGINT."""
    signal.alarm(PATIENCE)
    if kind == 'loop':
        loop_program.ControlLoop = ObservedLoop
        return loop_program.main(int(words[0]))
    if kind == 'driver':
        return run(lambda: [DriverNode(launch=launch)], [*words])
    rclpy.init(args=sys.argv)
    executor = {'events': EventsExecutor, 'single': SingleThreadedExecutor}[kind]()
    executor.add_node(Role(words[:words.index('--ros-args')]))
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.2)
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))
