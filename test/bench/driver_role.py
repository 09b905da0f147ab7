"""
The driver's side of ROS, seen from its own processes: setpoints in, joint states out.

`driver_role.py driver|relay`: the real driver, active, with its control loop in a process of its
own (`loop_role.py`), or an empty relay that runs a CAN cycle at the same rate. What the CAN cycle
costs is measured in the section `bus` and is left out here; all else counts: every thread of the
node, the thread of the loop that receives from it, and what the control thread spends on sending
states. Between the lines `begin` and `end` on stdin it notes how long each setpoint took from its
sender until it was taken.
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
from cycle_makers import cpu_of, keep_pace
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

CYCLE_RATE = 500.0
PATIENCE = 60.0


class DriverRelay(Node):
    """Hears setpoints, publishes joint states, sends targets on a bus, and does nothing else."""

    def __init__(self) -> None:
        super().__init__('driver')
        self._taken: list[float] = []
        self._bus = can.Bus(interface='virtual', channel='driver_bench')
        subscription(self, interfaces.JOINT_SETPOINTS, self._hear)
        self._states = publisher(self, interfaces.JOINT_STATES)
        self._message = JointState(
            name=CARRIAGES, position=(0.0,) * 3, velocity=(0.0,) * 3, effort=(0.0,) * 3)
        self.create_timer(JOINT_STATES_PERIOD, lambda: self._states.publish(self._message))
        self._cycle = keep_pace(self._command, 1.0 / CYCLE_RATE)

    def _hear(self, message: JointState) -> None:
        self._taken.append(time.time() - (seconds(message.header.stamp) - HORIZON))

    def _command(self) -> None:
        for node in (1, 2, 3):
            self._bus.send(can.Message(
                arbitration_id=pdo.RPDO1.cob_id(node), is_extended_id=False,
                data=pdo.RPDO1.codec.pack(0x0F, 8, 0)))

    def take(self) -> tuple[list[float], float]:
        """Return the latencies [s] since last asked, and the CPU outside this process's [s]."""
        latencies, self._taken = self._taken, []
        return latencies, -cpu_of(self._cycle)

    def close(self) -> None:
        """Do nothing."""


class ObservedDriver(DriverNode):
    """The driver, whose loop's process tells what it takes."""

    def __init__(self) -> None:
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

    def take(self) -> tuple[list[float], float]:
        """Return the latencies [s] since last asked, and the CPU outside this process [s]."""
        self._process.stdin.write('take\n')
        self._process.stdin.flush()
        ages, cpu = json.loads(self._process.stdout.readline())
        return [HORIZON + age for age in ages], cpu


def main() -> None:
    """Spin until SIGINT."""
    stopping = Event()
    signal.signal(signal.SIGINT, lambda *_: stopping.set())
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    driver = ObservedDriver() if sys.argv[1] == 'driver' else DriverRelay()
    executor = choose_executor()
    executor.add_node(driver)

    def take():
        latencies, elsewhere = driver.take()
        return latencies, time.process_time() + elsewhere, time.monotonic()

    def obey():
        begin = take()
        for word in sys.stdin:
            end = latencies, used, now = take()
            if word.strip() == 'end':
                print(json.dumps([latencies, (used - begin[1]) / (now - begin[2])]), flush=True)
            begin = end

    Thread(target=obey, daemon=True).start()
    while not stopping.is_set():
        executor.spin_once(timeout_sec=0.2)
    driver.close()


if __name__ == '__main__':
    main()
