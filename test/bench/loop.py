"""
Control loop of the bench on drives that need little processor time: `python -m loop DESCRIPTOR`.

The process imports only what the package's control loop imports, because its memory is measured.
"""

import os
import sys
import time

from cheap_drives import answer, cpu_of, cpu_of_process, HORIZON, report, start

from facade_manipulator.control_loop import control_loop as program


class ObservedLoop(program.ControlLoop):
    """Control loop that gets ready by itself; cheap drives replace the simulated drives."""

    def __init__(self, setup, channel):
        super().__init__(setup, channel)
        self._latencies, self._sending, self._feeds = [], 0.0, 0

    def _feed(self):
        super()._feed()
        self._feeds += 1
        if self._feeds == 2:  # the node runs: the first feed is that of the loop itself
            start(self._get_ready)

    def _add_setpoint(self, meant, *rest):
        super()._add_setpoint(meant, *rest)
        self._latencies.append(time.time() - meant + HORIZON)

    def _send_state(self, snapshot):
        begin = time.thread_time()
        super()._send_state(snapshot)
        self._sending += time.thread_time() - begin

    def _get_ready(self):
        for request in ('configure', 'home', 'activate'):
            self.controller.request(request).result()
        start(answer, self._setup.controller.rate)
        self.simulator.stop()
        report(self._latencies, self._measure)

    def _measure(self):
        channel = cpu_of('MainThread') + self._sending
        return (
            channel + cpu_of_process(os.getppid()),
            time.process_time() - cpu_of('answer') - channel,
        )


if __name__ == '__main__':
    program.ControlLoop = ObservedLoop
    sys.exit(program.main(int(sys.argv[1])))
