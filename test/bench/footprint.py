"""Start-up time and resident memory of every process, at start and under load."""

from __future__ import annotations

import os
from statistics import median
import time

from processes import memory_of, Processes
from table import alone, Row

DOMAIN = 95
NODES = ('ik_service', 'compensator', 'manipulator', 'driver', 'gondola_simulator',
         'drive_simulator')
PARAMETERS = {'driver': ('simulate_drives:=true',)}
STACK = ('driver', 'manipulator', 'gondola_simulator')
READY_GOAL = '<= 1.5'
SOAK = float(os.environ.get('SOAK', '20'))  # s; 600 shows what ten minutes do
DEADLINE = 20.0
# services are made last but for /diagnostics: each is the first that a user may call
WITNESSES = {
    'ik_service': ('ik_service/solve',), 'compensator': ('compensator/tare',),
    'manipulator': ('ik_service/solve', 'compensator/tare'), 'driver': ('driver/clear_faults',),
    'gondola_simulator': ('gondola_simulator/describe_parameters',), 'drive_simulator': (),
}


def footprint(rounds: int, quick: bool) -> tuple[list[Row], dict]:
    """Start each node alone, then the stack for a while."""
    os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    import rclpy

    rclpy.init()
    observer = rclpy.create_node('footprint')
    try:
        rows = []
        for name in NODES[2:4] if quick else NODES:
            turns = [_start(observer, name) for _ in range(1 if quick else 3)]
            ready, memory = (median(values) for values in zip(*turns, strict=True))
            if WITNESSES[name]:
                rows.append(alone(f'{name} ready after', ready, 's', 'start', READY_GOAL))
            rows.append(alone(f'{name} memory at start', memory, 'MiB'))
        if not quick:
            rows += _soak()
    finally:
        observer.destroy_node()
        rclpy.try_shutdown()
    return rows, {}


def _start(observer, name: str) -> tuple[float, float]:
    """Return when a node's services are there [s] and its memory [MiB]."""
    with Processes(DOMAIN) as processes:
        begin = time.monotonic()
        process = processes.node(name, *PARAMETERS.get(name, ()))
        wanted = {f'/bench/{service}' for service in WITNESSES[name]}
        while not wanted <= {one for one, _ in observer.get_service_names_and_types()}:
            if time.monotonic() - begin > DEADLINE:
                raise RuntimeError(f'{name} was not ready within {DEADLINE:g} s')
            time.sleep(0.005)
        ready = time.monotonic() - begin
        time.sleep(0.7)
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
