"""
Control loop of the bench on drives that need little processor time: `python -m loop DESCRIPTOR …`.

The process imports only what the package's control loop imports, because its memory is measured.
"""

import os
import sys
import time

from cheap_drives import answer, cpu_of, cpu_of_process, HORIZON, report, start

from facade_manipulator.control_loop import control_loop as program


class ObservedLoop(program.ControlLoop):
    """Control loop that gets ready by itself; cheap drives replace the simulated drives."""

    def __init__(self, setup, channel, **options):
        super().__init__(setup, channel, **options)
        self._latencies = []
        self._messages = 0.0  # processor time of the messages [s]
        self._feeds = 0
        self._read_begin = 0.0  # of the present turn [s, system clock]

    def _feed(self):
        super()._feed()
        self._feeds += 1
        if self._feeds == 2:  # the node runs: the first feed is that of the loop itself
            self._get_ready()

    def _add_setpoint(self, meant, position, velocity, sent):
        """
        Add the time from the source to the loop, and that of reading.

        The wait for the next turn is not part of it: the step that uses the setpoint is the same,
        and the empty relay has no cycle.
        """
        super()._add_setpoint(meant, position, velocity)
        reading = time.time() - self._read_begin
        self._latencies.append(sent - meant + HORIZON + reading)

    def _read(self):
        self._read_begin = time.time()
        begin = time.thread_time()
        super()._read()
        self._messages += time.thread_time() - begin

    def _send_state(self, snapshot):
        begin = time.thread_time()
        super()._send_state(snapshot)
        self._messages += time.thread_time() - begin

    def _get_ready(self, reply=None, requests=('configure', 'home', 'activate')):
        """Send the first request; its reply leads to the others."""
        if isinstance(reply, Exception):
            raise reply
        if requests:
            first, *others = requests
            self.controller.request(first, lambda reply: self._get_ready(reply, others))
        else:
            self._begin()

    def _begin(self):
        start(answer, self._setup.controller.rate)
        self.simulator.stop()
        start(report, self._latencies, self._measure)

    def _measure(self):
        cpu = self._messages + cpu_of_process(os.getppid())
        cycle = time.process_time() - cpu_of('answer') - self._messages
        return cpu, cycle


if __name__ == '__main__':
    program.ControlLoop = ObservedLoop
    sys.exit(program.main(*map(int, sys.argv[1:])))
