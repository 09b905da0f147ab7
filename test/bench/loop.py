"""
Control loop of the bench on drives that need little processor time: `python loop.py DESCRIPTOR`.

The process imports only what the package's control loop imports, because its memory is measured.
"""

import os
import signal
import sys
from threading import main_thread
import time

from cheap_drives import (
    answer,
    cpu_of,
    cpu_of_process,
    HORIZON,
    open_bus,
    PATIENCE,
    report,
    started,
)

from facade_manipulator.control_loop import control_loop as program


class ObservedLoop(program.ControlLoop):
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

        def measure():
            channel = cpu_of(main_thread()) + self._sending
            return (channel + cpu_of_process(os.getppid()),
                    time.process_time() - cpu_of(drives) - channel)

        report(self._latencies, measure)


if __name__ == '__main__':
    signal.alarm(PATIENCE)
    program.ControlLoop = ObservedLoop
    sys.exit(program.main(int(sys.argv[1])))
