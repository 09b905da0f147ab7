"""Start-up time and resident memory of every process."""

from __future__ import annotations

from statistics import median
import time

from processes import memory_of, Processes
from table import alone, Row

DOMAIN = 95
NODES = ('ik_service', 'compensator', 'manipulator', 'driver', 'gondola_simulator')
PARAMETERS = {'driver': ('simulate_drives:=true',)}
READY_GOAL = '<= 1.5'
SETTLED = 0.5  # s
QUICK_ROUNDS = 2


def footprint(rounds: int, quick: bool) -> list[Row]:
    """Start each node alone."""
    rows = []
    for name in NODES[2:4] if quick else NODES:
        turns = [_start(name) for _ in range(QUICK_ROUNDS if quick else rounds)]
        ready, memory = (median(values) for values in zip(*turns, strict=True))
        rows.append(alone(f'{name} ready after', ready, 's', 'start', READY_GOAL))
        rows.append(alone(f'{name} memory at start', memory, 'MiB'))
    return rows


def _start(name: str) -> tuple[float, float]:
    """Return when a node begins to spin [s] and its memory [MiB]."""
    with Processes(DOMAIN) as processes:
        begin = time.monotonic()
        process = processes.node(name, *PARAMETERS.get(name, ()))
        processes.wait_for(name, ']: ready')
        ready = time.monotonic() - begin
        time.sleep(SETTLED)
        return ready, memory_of(process.pid)
