"""
From a disturbance to the targets on the bus, seen from the process of the driver.

`pipeline_role.py driver|relay RATE`: the real driver with simulated drives, or an empty relay that
sends what it hears last once a cycle. Prints the latencies of each part after `begin` and `end`.
"""

from __future__ import annotations

from bisect import bisect_left
import json
from pathlib import Path
import signal
import sys
from threading import Event, Thread
import time

import can
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from ros_roles import HORIZON, Inputs
from sensor_msgs.msg import JointState

from facade_manipulator import interfaces
from facade_manipulator.drives.canopen import pdo
from facade_manipulator.ros import subscription
from facade_manipulator.ros.runtime import choose_executor

LAST_COMMAND = pdo.RPDO1.cob_id(3)
HOP = 0.0002  # s: an estimate younger than this is not in the next corrected pose yet
CHANNEL = 'driver_bench'
PATIENCE = 60.0


class Estimator(Inputs):
    """
    Disturbances and goals, with the times at which they were sent.

    A little off the rate of the others, so that every phase between them occurs alike.
    """

    def __init__(self, rate: float) -> None:
        super().__init__(0.97 * rate)
        self.sent: list[float] = []

    def _sway(self) -> None:
        super()._sway()
        self.sent.append(time.time())

    def _tell_states(self) -> None:
        """Leave it to the driver."""


class RelayDriver(Node):
    """Commands the newest setpoint once a cycle, and nothing else."""

    def __init__(self, rate: float, heard: list) -> None:
        super().__init__('driver')
        self._heard = heard
        self._bus = can.Bus(interface='virtual', channel=CHANNEL)
        subscription(self, interfaces.JOINT_SETPOINTS, self._hear)
        self._period = 1.0 / rate
        self.cycle = Thread(target=self._command, daemon=True)
        self.cycle.start()

    def _hear(self, message: JointState) -> None:
        stamp = message.header.stamp
        self._heard.append((stamp.sec + stamp.nanosec * 1e-9 - HORIZON, time.time()))

    def _command(self) -> None:
        due = time.monotonic()
        while True:
            for node in (1, 2, 3):
                self._bus.send(can.Message(
                    arbitration_id=pdo.RPDO1.cob_id(node), is_extended_id=False,
                    data=pdo.RPDO1.codec.pack(0x0F, 8, 0)))
            due += self._period
            time.sleep(max(0.0, due - time.monotonic()))


def real_driver(heard: list) -> Node:
    """Return the driver node, homed and active soon, that then notes each setpoint it takes."""
    sys.path.append(str(Path(__file__).resolve().parents[1] / 'helpers'))
    from loop_bench import LoopThread

    from facade_manipulator.nodes.driver import DriverNode

    driver = DriverNode(launch=LoopThread)  # in this process, so that its bus can be watched
    follower = driver._loop._process.loop.follower
    add = follower.add

    def note(setpoint, now):
        add(setpoint, now)
        heard.append((setpoint.time - HORIZON, time.time()))

    def bring_up():
        for request in ('configure', 'home', 'activate'):
            print(driver._loop.request(request).result(PATIENCE), file=sys.stderr)
        follower.add = note

    Thread(target=bring_up, daemon=True).start()
    return driver


def watch_bus(commanded: list[float]) -> None:
    """Note when the last target of each cycle is on the bus."""
    bus = can.Bus(interface='virtual', channel=CHANNEL)
    while True:
        message = bus.recv()
        if message.arbitration_id == LAST_COMMAND:
            commanded.append(time.time())


def parts(sent: list[float], heard: list, commanded: list[float]) -> dict[str, list[float]]:
    """Return for each disturbance the parts of its way to the bus [s]."""
    ticks, arrivals = [tick for tick, _ in heard], [arrival for _, arrival in heard]
    result = {'wait for the tick': [], 'compute and transport': [], 'wait for the cycle': [],
              'total': []}
    for begin in sent:
        k = bisect_left(ticks, begin + HOP)
        if k == len(ticks):
            break
        b = bisect_left(commanded, arrivals[k])
        if b == len(commanded):
            break
        for name, value in zip(result, (
                ticks[k] - begin, arrivals[k] - ticks[k], commanded[b] - arrivals[k],
                commanded[b] - begin), strict=True):
            result[name].append(value)
    return result


def main() -> None:
    """Spin until SIGINT."""
    kind, rate = sys.argv[1], float(sys.argv[2])
    stopping = Event()
    signal.signal(signal.SIGINT, lambda *_: stopping.set())
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    heard, commanded = [], []
    executor = choose_executor() if kind == 'driver' else SingleThreadedExecutor()
    driver = real_driver(heard) if kind == 'driver' else RelayDriver(rate, heard)
    estimator = Estimator(rate)
    executor.add_node(driver)
    executor.add_node(estimator)
    Thread(target=watch_bus, args=(commanded,), daemon=True).start()

    def obey():
        for word in sys.stdin:
            if word.strip() == 'begin':
                for one in (heard, commanded, estimator.sent):
                    one.clear()
            else:
                print(json.dumps(parts(estimator.sent, heard, commanded)), flush=True)

    Thread(target=obey, daemon=True).start()
    while not stopping.is_set():
        executor.spin_once(timeout_sec=0.2)
    if hasattr(driver, 'close'):
        driver.close()


if __name__ == '__main__':
    main()
