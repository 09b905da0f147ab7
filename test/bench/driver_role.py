"""
The driver's side of ROS, seen from its own processes: setpoints in, joint states out.

`driver_role.py driver|relay RATE`: the real driver, active, with its control loop in a process of
its own (`loop_role.py`), or an empty relay that runs a CAN cycle at the same rate. Between the
lines `begin` and `end` on stdin it notes how long each setpoint took from its sender until it was
taken, and two shares of the processor: without the CAN cycle, which the section `bus` measures
(every thread of the node, the thread of the loop that receives from it, and what the control
thread spends on sending states), and with it.
"""

from __future__ import annotations

import json
from pathlib import Path
import signal
import socket
import subprocess
import sys
from threading import Event, Thread
import time

import can
from cycle_makers import Answers, cpu_of, keep_pace, NODES
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from ros_roles import HORIZON, JOINT_STATES_PERIOD
from sensor_msgs.msg import JointState

from facade_manipulator import interfaces
from facade_manipulator.drives.canopen import pdo
from facade_manipulator.messages import CARRIAGES, seconds
from facade_manipulator.nodes.driver import DriverNode
from facade_manipulator.ros import publisher, subscription
from facade_manipulator.ros.runtime import choose_executor

PATIENCE = 60.0


class DriverRelay(Node):
    """Hears setpoints, publishes joint states, sends targets on a bus, and does nothing else."""

    def __init__(self, rate: float) -> None:
        super().__init__('driver')
        self._taken: list[float] = []
        self._drives = Answers(
            can.Bus(interface='virtual', channel='driver_bench'), round(rate))
        self._bus = can.Bus(interface='virtual', channel='driver_bench')
        subscription(self, interfaces.JOINT_SETPOINTS, self._hear)
        self._states = publisher(self, interfaces.JOINT_STATES)
        self._message = JointState(
            name=CARRIAGES, position=(0.0,) * 3, velocity=(0.0,) * 3, effort=(0.0,) * 3)
        self.create_timer(JOINT_STATES_PERIOD, lambda: self._states.publish(self._message))
        self._cycle = keep_pace(self._command, 1.0 / rate)

    def _hear(self, message: JointState) -> None:
        self._taken.append(time.time() - (seconds(message.header.stamp) - HORIZON))

    def _command(self) -> None:
        for cob_id, data in [(pdo.SYNC_COB_ID, b''), *(
                (pdo.RPDO1.cob_id(node), pdo.RPDO1.codec.pack(0x0F, 8, 0)) for node in NODES)]:
            self._bus.send(can.Message(arbitration_id=cob_id, is_extended_id=False, data=data))
        while self._bus.recv(0.0) is not None:
            continue

    def take(self) -> tuple[list[float], float, float]:
        """Return latencies [s] since last asked, and the CPU [s] without the cycle and with."""
        latencies, self._taken = self._taken, []
        used = time.process_time() - cpu_of(self._drives)
        return latencies, used - cpu_of(self._cycle), used

    def close(self) -> None:
        """Do nothing."""


class ObservedDriver(DriverNode):
    """The driver, whose loop's process tells what it takes."""

    def __init__(self, _) -> None:
        super().__init__(launch=self._launch)
        Thread(target=self._bring_up, daemon=True).start()

    def _launch(self, end: socket.socket) -> subprocess.Popen:
        number = end.fileno()
        self._process = subprocess.Popen(
            [sys.executable, Path(__file__).with_name('loop_role.py'), str(number)],
            pass_fds=(number,), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self._process

    def _bring_up(self) -> None:
        for request in ('configure', 'home', 'activate'):
            print(self._loop.request(request).result(PATIENCE), file=sys.stderr)

    def take(self) -> tuple[list[float], float, float]:
        """Return the same of both processes."""
        self._process.stdin.write('take\n')
        self._process.stdin.flush()
        ages, channel, loop = json.loads(self._process.stdout.readline())
        node = time.process_time()
        return [HORIZON + age for age in ages], node + channel, node + loop


def main() -> None:
    """Spin until SIGINT."""
    stopping = Event()
    signal.signal(signal.SIGINT, lambda *_: stopping.set())
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    driver = (ObservedDriver if sys.argv[1] == 'driver' else DriverRelay)(float(sys.argv[2]))
    executor = choose_executor()
    executor.add_node(driver)

    def take():
        return *driver.take(), time.monotonic()

    def obey():
        begin = take()
        for word in sys.stdin:
            end = latencies, *used, now = take()
            if word.strip() == 'end':
                print(json.dumps([latencies, *(
                    (after - before) / (now - begin[-1])
                    for before, after in zip(begin[1:3], used, strict=True))]), flush=True)
            begin = end

    Thread(target=obey, daemon=True).start()
    while not stopping.is_set():
        executor.spin_once(timeout_sec=0.2)
    driver.close()


if __name__ == '__main__':
    main()
