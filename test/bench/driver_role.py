"""
The driver's side of ROS, seen from its own process: setpoints in, joint states out.

`driver_role.py driver|relay`: the real driver, active, or an empty relay. Beside the executor
a thread of the process runs the CAN cycle at 500 Hz, as in the section `bus`, which measures that
thread; here the main thread alone counts, that of the executor. Between the lines `begin` and
`end` on stdin it notes how long each setpoint took from its sender until it was taken.
"""

from __future__ import annotations

import json
import signal
import sys
from threading import Event, get_ident, Thread
import time

import can
from cycle_makers import Answers
from pipeline_role import CHANNEL, real_driver, RelayDriver
import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from ros_roles import JOINT_STATES_PERIOD
from sensor_msgs.msg import JointState

from facade_manipulator.ros.conversions import CARRIAGES
from facade_manipulator.ros.executors import choose_executor
from facade_manipulator.ros.runtime import RELIABLE

CYCLE_RATE = 500.0


class DriverRelay(RelayDriver):
    """Hears setpoints, publishes joint states, sends targets on a bus, and does nothing else."""

    def __init__(self, taken: list) -> None:
        super().__init__(CYCLE_RATE, taken)
        self._states = self.create_publisher(JointState, 'joint_states', RELIABLE)
        self._message = JointState(
            name=CARRIAGES, position=(0.0,) * 3, velocity=(0.0,) * 3, effort=(0.0,) * 3)
        self.create_timer(JOINT_STATES_PERIOD, lambda: self._states.publish(self._message))


def answer_instead(driver: Node) -> None:
    """Give an active driver drives that cost next to nothing."""
    Answers(can.Bus(interface='virtual', channel=CHANNEL))
    simulator = driver._loop._process.loop.simulator
    simulator.stop()


def main() -> None:
    """Spin until SIGINT."""
    stopping = Event()
    signal.signal(signal.SIGINT, lambda *_: stopping.set())
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    taken: list[tuple[float, float]] = []
    clock = time.pthread_getcpuclockid(get_ident())
    is_real = sys.argv[1] == 'driver'
    driver = real_driver(taken, answer_instead) if is_real else DriverRelay(taken)
    executor = choose_executor()
    executor.add_node(driver)

    def obey():
        for word in sys.stdin:
            if word.strip() == 'begin':
                taken.clear()
                begin, used = time.monotonic(), time.clock_gettime(clock)
            else:
                cpu = (time.clock_gettime(clock) - used) / (time.monotonic() - begin)
                print(json.dumps([[end - sent for sent, end in taken], cpu]), flush=True)

    Thread(target=obey, daemon=True).start()
    while not stopping.is_set():
        executor.spin_once(timeout_sec=0.2)
    if hasattr(driver, 'close'):
        driver.close()


if __name__ == '__main__':
    main()
