"""Start-up time and resident memory of every process, at start and under load."""

from __future__ import annotations

import os
from statistics import median
import time

from processes import memory_of, Processes
from table import alone, Row

DOMAIN = 95
NODES = ('ik_service', 'compensator', 'manipulator', 'driver', 'gondola_simulator')
PARAMETERS = {'driver': ('simulate_drives:=true',)}
STACK = ('driver', 'manipulator', 'gondola_simulator')
READY_GOAL = '<= 1.5'
SOAK = float(os.environ.get('SOAK', '20'))  # s; 600 shows what ten minutes do
SETTLED = 0.5  # s
QUICK_ROUNDS = 2


def footprint(rounds: int, quick: bool) -> list[Row]:
    """Start each node alone, then the stack for a while."""
    rows = []
    for name in NODES[2:4] if quick else NODES:
        turns = [_start(name) for _ in range(QUICK_ROUNDS if quick else rounds)]
        ready, memory = (median(values) for values in zip(*turns, strict=True))
        rows.append(alone(f'{name} ready after', ready, 's', 'start', READY_GOAL))
        rows.append(alone(f'{name} memory at start', memory, 'MiB'))
    return rows if quick else rows + _soak()


def _start(name: str) -> tuple[float, float]:
    """Return when a node begins to spin [s] and its memory [MiB]."""
    with Processes(DOMAIN) as processes:
        begin = time.monotonic()
        process = processes.node(name, *PARAMETERS.get(name, ()))
        processes.wait_for(name, ']: ready')
        ready = time.monotonic() - begin
        time.sleep(SETTLED)
        return ready, memory_of(process.pid)


def _soak() -> list[Row]:
    """Let the stack run with its inputs; return the memory of each process at the end."""
    with Processes(DOMAIN) as processes:
        running = {name: processes.node(name, *PARAMETERS.get(name, ())) for name in STACK}
        processes.role('inputs', 'events', 100.0)
        time.sleep(3.0)
        before = {name: memory_of(process.pid) for name, process in running.items()}
        time.sleep(SOAK)
        return [
            row for name, process in running.items() for row in (
                alone(f'{name} memory after 3 s in the stack', before[name], 'MiB'),
                alone(f'{name} memory after {SOAK:g} s more', memory_of(process.pid), 'MiB'))]
