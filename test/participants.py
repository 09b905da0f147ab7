"""
Let ROS participants join and leave while the drives move, as `ros2 topic echo` does: what stops?

``python test/participants.py --count 100`` (`. .venv/environment` first) starts a driver with
simulated drives, streams setpoints to it at 100 Hz, lets participants come and go, and prints what
the driver's control loop missed beside what a bare timer loop of the same period missed meanwhile,
and how often the program that streams stood still itself. ``--settings`` names the discovery and
transport to try; ``subnet`` sends multicast: ``unshare -n`` and ``ip link set lo up`` keep it in.
"""

from __future__ import annotations

import argparse
import math
import os
from pathlib import Path
import subprocess
import sys
import time

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import rclpy  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Bool  # noqa: E402

from facade_manipulator import interfaces  # noqa: E402
from facade_manipulator.ros import publisher, subscription  # noqa: E402
from facade_manipulator.ros.client import ManipulatorClient  # noqa: E402
from facade_manipulator.ros.conversions import node_time, stamp  # noqa: E402

SETTINGS = {
    'localhost': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'},
    'loopback.xml': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT',
                     'FASTRTPS_DEFAULT_PROFILES_FILE': str(HERE.parent / 'config/loopback.xml')},
    'subnet': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'},
    'subnet, UDP': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
                    'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'},
    'static peer': {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT',
                    'ROS_STATIC_PEERS': '127.0.0.1'},
}
PERIOD, AHEAD = 0.01, 0.06
STALL = 0.25  # s: Fast DDS's are of 0.333 s
HOME, AMPLITUDE, FREQUENCY = (-0.1, 0.1, 0.0), 0.03, 0.5
COUNTERS = ('cycles', 'missed cycles', 'late commands', 'skipped SYNCs', 'lateness below 20 ms',
            'lateness below 50 ms', 'lateness below 100 ms', 'lateness beyond')


def timer_loop() -> None:
    """Turn until the standard input closes; print how many periods were missed, and the worst."""
    os.set_blocking(0, False)
    due, missed, worst = time.monotonic(), 0, 0.0
    while os.read(0, 1) if _readable() else True:
        due += PERIOD
        time.sleep(max(0.0, due - time.monotonic()))
        late = time.monotonic() - due
        missed += int(late / PERIOD)
        worst = max(worst, late)
        due = max(due, time.monotonic() - PERIOD)
    print(f'{missed} {1e3 * worst:.1f}')


def _readable() -> bool:
    import select
    return bool(select.select([0], [], [], 0.0)[0])


def visit(count: int, pause: float) -> None:
    """Join and leave as many times, with a publisher and a subscription of its own."""
    for number in range(count):
        context = rclpy.Context()
        context.init()
        node = rclpy.create_node(f'visitor_{number}', context=context)
        node.create_subscription(JointState, 'joint_states', lambda message: None, 10)
        node.create_publisher(Bool, 'software_stop_of_nobody', 10)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        end = time.monotonic() + pause
        while time.monotonic() < end:
            executor.spin_once(0.05)
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def hurry(pid: int, priority: int) -> None:
    """Let a process run before other programs, and what it has started before it."""
    if not priority:
        return
    for thread in Path(f'/proc/{pid}/task').iterdir():
        os.sched_setscheduler(
            int(thread.name), os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split():
        hurry(int(child), priority + 1)


def start(*arguments: str, **details) -> subprocess.Popen:
    """Start a python process."""
    return subprocess.Popen([sys.executable, *arguments], **details)


class Pauses:
    """Notes how often something that happens again and again stood still."""

    def __init__(self) -> None:
        self._last = math.inf
        self._found: list[float] = []

    def happens(self) -> None:
        """Note that it happens now."""
        now = time.monotonic()
        if now - self._last > STALL:
            self._found.append(now - self._last)
        self._last = now

    def __str__(self) -> str:
        return f'{len(self._found)} times, worst {1e3 * max(self._found, default=0.0):.0f} ms'


class Streamer:
    """Sends setpoints and follows what the driver says of itself."""

    def __init__(self, client: ManipulatorClient) -> None:
        self._client, self._node = client, client.node
        self._publisher = publisher(self._node, interfaces.JOINT_SETPOINTS)
        self._begin = 0.0
        self._timer = None
        self.pauses, self.driver_pauses = Pauses(), Pauses()
        subscription(self._node, interfaces.JOINT_STATES, lambda _: self.driver_pauses.happens())

    def start(self) -> None:
        """Begin to send."""
        self._begin = node_time(self._node) + AHEAD
        self._timer = self._node.create_timer(PERIOD, self._send)

    def _send(self) -> None:
        now = node_time(self._node) + AHEAD
        angle = 2.0 * math.pi * FREQUENCY * (now - self._begin)
        shift = AMPLITUDE * (1.0 - math.cos(angle))
        speed = AMPLITUDE * 2.0 * math.pi * FREQUENCY * math.sin(angle)
        message = JointState(
            name=('q1', 'q2', 'q3'), position=[q + shift for q in HOME], velocity=[speed] * 3)
        message.header.stamp = stamp(now)
        self._publisher.publish(message)
        self.pauses.happens()

    def values(self, component: str) -> dict[str, str]:
        """Return a component's newest values in /diagnostics."""
        self._client.spin(1.2)
        return {item.key: item.value for item in self._client.component(component).status.values}


def measure(options: argparse.Namespace) -> bool:
    """Measure and print; return whether the drives went on."""
    client = ManipulatorClient()
    streamer = Streamer(client)
    client.wait_until(lambda: client.component('driver: operation'), 'the driver', 30.0)
    client.configure()
    client.home()
    client.activate()
    hurry(os.getpid(), options.priority)  # and the driver above it, and its loop above that
    streamer.start()
    client.spin(1.0)
    before, braked = streamer.values('driver: bus'), streamer.values('driver: operation')['brakes']
    timer = start(__file__, '--timer', stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    hurry(timer.pid, options.priority and options.priority + 2)
    visitors = start(__file__, '--visit', '--count', str(options.count),
                     '--pause', str(options.pause))
    while visitors.poll() is None:
        client.spin(0.1)
    after, operation = streamer.values('driver: bus'), streamer.values('driver: operation')
    bare, worst = timer.communicate(input='')[0].split()
    state = client.driver_state()
    counts = [int(after[name]) - int(before[name]) for name in COUNTERS]
    print(f'{options.settings}: {options.count} participants came and went; the driver is {state}'
          + (f': {operation["cause"]}' if operation['cause'] else ''))
    print(', '.join(f'{name} {count}' for name, count in zip(COUNTERS, counts, strict=True))
          + f', brakes {int(operation["brakes"]) - int(braked)}; '
          f'a bare timer loop missed {bare} periods, worst {worst} ms; '
          f'setpoints paused {streamer.pauses}, joint_states {streamer.driver_pauses}; '
          f'load {os.getloadavg()[0]:.1f}')
    client.close()
    return state == 'active'


def main() -> int:
    """Start a driver, measure, end it; exit status 1 if the drives stopped."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=20)
    parser.add_argument('--pause', type=float, default=0.4, help='how long each stays [s]')
    parser.add_argument('--settings', choices=SETTINGS, default='localhost')
    parser.add_argument('--priority', type=int, default=0, help='SCHED_FIFO, against other load')
    parser.add_argument('--timer', action='store_true', help=argparse.SUPPRESS)
    parser.add_argument('--visit', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.timer:
        timer_loop()
        return 0
    if options.visit:
        visit(options.count, options.pause)
        return 0
    os.environ.setdefault('ROS_DOMAIN_ID', str(os.getpid() % 100))
    os.environ.update(SETTINGS[options.settings])
    driver = start('-m', 'facade_manipulator.nodes.driver', '--ros-args', '-p',
                   'simulate_drives:=true')
    rclpy.init()
    try:
        return 0 if measure(options) else 1
    finally:
        driver.terminate()
        driver.wait(20.0)
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
