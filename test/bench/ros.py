"""R1 and R2; on real processes."""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
import time
from typing import NamedTuple, TypeVar

from processes import listen, Load, load, Processes, until
from table import compare, Row

T = TypeVar('T')
DOMAIN = 94
DEFAULT_RATE, FAST_RATE = 100.0, 500.0


class Layout(NamedTuple):
    """Which processes stand for what: ours are nodes of the package, the others relays."""

    ours: tuple[str, ...]
    relays: tuple[str, ...]
    executor: str  # of the relays
    inputs: str
    listener: str


COMPENSATOR = Layout(
    ('compensator',), ('compensator_relay',), 'events', 'inputs', 'hear_poses')
IK_SERVICE = Layout(('ik_service',), ('ik_relay',), 'events', 'poses', 'hear_setpoints')
DEPLOYMENT = Layout(
    ('manipulator',), ('compensator_relay', 'ik_relay'), 'single', 'inputs', 'hear_setpoints')
DRIVER = 'both processes without the CAN cycle, setpoint sent to taken'
PATIENT = (  # of drives that must not stop where the computer is busy
    '-p', 'controller.max_missed_cycles:=10', '-p', 'controller.watchdog_timeout:=1.0',
    '-p', 'controller.heartbeat_timeout:=0.5')
EMPTY_DEPLOYMENT = DEPLOYMENT._replace(relays=('deployment_relay',), executor='events')
WHY = {  # of goals missed
    'R1': 'the compensator learns at every other estimate; what takes 0.1 ms in a loop takes '
          '0.4 ms after a sleep of 10 ms, in caches that are cold by then; the driver passes each '
          'setpoint on to a second process, which has to be woken, and hears its state in turn',
    'R2': 'an empty relay of the same shape takes 0.28 of the CPU of the three relays by itself; '
          'prediction, path, limits and certificates come on top',
}
TIMES = {True: (0.3, 0.8), False: (1.0, 2.0)}  # warm-up and duration by quick [s]


def again(measure: Callable[..., T], *arguments) -> T:
    """Measure once more where a process has ended by itself or nothing was heard."""
    try:
        return measure(*arguments)
    except (OSError, RuntimeError) as error:
        print(f'  {error}: measured again')
        return measure(*arguments)


def run(layout: Layout, is_ours: bool, rate: float, quick: bool) -> Load:
    """Measure one layout; the listener stands in the driver's place and counts in a deployment."""
    executor = 'events' if is_ours else layout.executor
    with Processes(DOMAIN) as processes:
        counted = list(layout.ours if is_ours else layout.relays)
        for name in counted:
            if not is_ours:
                processes.role(name, executor, rate)
            elif name == 'ik_service':
                processes.node(name)
            else:
                processes.node(name, f'rate:={rate}')
        listener = layout.listener
        if layout in (DEPLOYMENT, EMPTY_DEPLOYMENT):
            listener = 'hear_as_the_driver' if is_ours else listener
            counted.append(listener)
        processes.role(listener, executor, rate)
        processes.role(layout.inputs, 'events', rate)
        return processes.measure(counted, listener, *TIMES[quick])


def beside(layout: Layout, rate: float, rounds: int, quick: bool) -> tuple[Load, Load]:
    """Measure ours and the relays in turns; return the medians of both."""
    return medians(lambda is_ours: run(layout, is_ours, rate, quick), rounds)


def medians(measure: Callable[[bool], Load], rounds: int) -> tuple[Load, Load]:
    """Measure ours and the other in turns; return the medians of both."""
    turns = [(again(measure, True), again(measure, False)) for _ in range(rounds)]
    return tuple(
        Load(*(median(values) for values in zip(*side, strict=True)))
        for side in zip(*turns, strict=True))


def run_driver(is_ours: bool, rate: float, quick: bool) -> Load:
    """Measure the driver's side of ROS: latencies of setpoints, CPU of both processes."""
    with Processes(DOMAIN) as processes:
        role = processes.script(
            'driver_role', 'driver' if is_ours else 'relay', '--ros-args',
            '-r', '__ns:=/bench', '-p', 'simulate_drives:=true',
            '-p', 'bus.channel:=driver_bench', '-p', f'controller.rate:={FAST_RATE:.0f}',
            *PATIENT)
        processes.role('setpoints', 'events', rate)
        until(lambda: listen(role, 0.2)[0])
        warm_up, duration = TIMES[quick]
        time.sleep(warm_up)
        taken, cpu = listen(role, duration)
        if not taken:
            raise RuntimeError(f'no setpoint was taken: {processes.last_line("driver_role")}')
        return load(taken, cpu)


def nodes(rounds: int, quick: bool) -> list[Row]:
    """R1 and R2."""
    rows = []
    rates = (FAST_RATE,) if quick else (DEFAULT_RATE, FAST_RATE)
    for layout, name in ((COMPENSATOR, 'compensator'), (IK_SERVICE, 'ik_service')):
        for rate in rates:
            ours, relay = beside(layout, rate, 1 if quick else rounds, quick)
            rows += _both(f'{name} at {rate:g} Hz, beside an empty relay', ours, relay,
                          'R1', ('<= 1.15', '<= 1.2'))
    for rate in rates:
        ours, relay = medians(
            lambda is_ours, rate=rate: run_driver(is_ours, rate, quick), 1 if quick else rounds)
        rows += _both(f'driver at {rate:g} Hz, {DRIVER}, beside an empty relay', ours, relay,
                      'R1', ('<= 1.25', '<= 1.4'))
    ours, relay = beside(DEPLOYMENT, FAST_RATE, 1 if quick else rounds, quick)
    rows += _both('deployment at 500 Hz, beside three SingleThreadedExecutor relays', ours,
                  relay, 'R2', ('<= 0.4', ''))
    if not quick:
        ours, relay = beside(EMPTY_DEPLOYMENT, FAST_RATE, rounds, quick)
        rows += _both('deployment at 500 Hz, beside an empty relay of the same shape', ours,
                      relay, 'R2', ('', '<= 1.1'))
    for goal_id in sorted({row.goal_id for row in rows if not row.met}):
        print(f'  missed {goal_id}: {WHY[goal_id]}')
    return rows


def _both(name: str, ours: Load, relay: Load, goal_id: str, goals: tuple[str, str]) -> list[Row]:
    figures = ('p50', ours.p50, relay.p50, 'us'), ('CPU', ours.cpu, relay.cpu, '%')
    return [compare(f'{name}: {what}', *values, goal_id, goal)
            for (what, *values), goal in zip(figures, goals, strict=True) if goal]
