"""
The process of the control loop, as the driver starts it, that tells what it takes.

A line on stdin is answered with the ages [s] at which setpoints were taken since the last one,
each against the instant it is meant for, and with the CPU [s] so far: what the channel to the
node has cost, all of the thread that receives and of the control thread what it spends on sending
states; and all that the loop has cost. Once active, drives that cost next to nothing take the
place of the simulated ones.
"""

from __future__ import annotations

import json
import sys
from threading import main_thread, Thread
import time

import can
from cycle_makers import Answers, cpu_of

from facade_manipulator.drives.controller import ControllerSnapshot, ControllerState
from facade_manipulator.loop import __main__ as program
from facade_manipulator.loop.control_loop import ControlLoop, LoopSetup


class ObservedLoop(ControlLoop):
    """The control loop; notes when it takes a setpoint."""

    def __init__(self, setup: LoopSetup, *channel) -> None:
        super().__init__(setup, *channel)
        self._ages: list[float] = []
        self._sending = 0.0
        self._bus_channel, self._rate = setup.bus.channel, setup.controller.rate
        Thread(target=self._obey, daemon=True).start()

    def _add_setpoint(self, time_meant: float, *rest) -> None:
        super()._add_setpoint(time_meant, *rest)
        self._ages.append(time.time() - time_meant)

    def _send_state(self, snapshot: ControllerSnapshot) -> None:
        begin = time.thread_time()
        super()._send_state(snapshot)
        self._sending += time.thread_time() - begin

    def _obey(self) -> None:
        while self.controller.snapshot().state is not ControllerState.ACTIVE:
            time.sleep(0.01)
        drives = Answers(can.Bus(interface='virtual', channel=self._bus_channel), self._rate)
        self.simulator.stop()
        for _ in sys.stdin:
            ages, self._ages = self._ages, []
            print(json.dumps([ages, cpu_of(main_thread()) + self._sending,
                              time.process_time() - cpu_of(drives)]), flush=True)


if __name__ == '__main__':
    program.ControlLoop = ObservedLoop
    sys.exit(program.main(int(sys.argv[1])))
