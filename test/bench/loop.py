"""
Control loop of the bench on drives that need little processor time: `python loop.py DESCRIPTOR`.

The process imports only what the package's control loop imports, because its memory is measured.
"""

import json
import os
from pathlib import Path
import signal
import struct
import sys
from threading import main_thread, Thread
import time

import can

from facade_manipulator.control_loop import control_loop as program

PATIENCE = 90  # s
HORIZON = 0.06  # s, of the stamps of poses and setpoints
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


def report(latencies, measure):
    """
    Print one line before and one after the measured time, which begins after the first latency.

    A line has the latencies [s] since the previous line, and the processor time [s] without and of
    the CAN cycle.
    """
    while not latencies:
        time.sleep(0.1)
    for pause in os.environ['BENCH_TIMES'].split():
        latencies.clear()
        time.sleep(float(pause))
        print(json.dumps((latencies, *measure())), flush=True)


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
