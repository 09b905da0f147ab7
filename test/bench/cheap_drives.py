"""Cheap drives, measurements and reports of the bench, which import only python-can."""

import json
import os
from pathlib import Path
import struct
from threading import enumerate as all_threads
from threading import Thread
import time

import can

HORIZON = 0.06  # s, of the stamps of poses and setpoints
DRIVES = (1, 2, 3)
# what drives send besides TPDO1: COB-ID, data, and in which cycles at 500 and at 100 Hz
OTHERS = (
    (0x280, bytes(8), {500: 10, 100: 1}),
    (0x380, bytes(8), {500: 50, 100: 10}),
    (0x700, b'\x05', {500: 25, 100: 5}),
)


def cpu_of(*words):
    """Return the processor time of the threads with one of these words in their name [s]."""
    spent = 0.0
    for one in all_threads():
        if any(word in one.name for word in words):
            spent += time.clock_gettime(time.pthread_getcpuclockid(one.ident))
    return spent


def cpu_of_process(pid):
    """Return the processor time of a process [s]."""
    tasks = Path(f'/proc/{pid}/task').glob('*/schedstat')
    return 1e-9 * sum(int(path.read_text().split()[0]) for path in tasks)


def start(function, *arguments):
    """Run a function in a thread, whose name contains that of the function."""
    Thread(target=function, args=arguments, daemon=True).start()


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


def answer(rate):
    """Answer like three drives at their commanded positions, with minimum processor time."""
    frames = {}
    for base, data, every in OTHERS:
        for number in DRIVES:
            frames[base + number] = (every[rate], data)
    bus = open_bus()
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
