"""R1, R2 and S1; on real processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from statistics import median
from tempfile import TemporaryDirectory
import time
from typing import NamedTuple, TypeVar

from processes import listen, Load, load, Processes, until
from table import compare, Row

T = TypeVar('T')
DEFAULT_RATE, FAST_RATE = 100.0, 500.0


class Layout(NamedTuple):
    """Which processes stand for what: ours are nodes of the package, the others relays."""

    ours: tuple[str, ...]
    relays: tuple[str, ...]
    executor: str  # of the relays
    inputs: str
    listener: str  # in the driver's place; ours reads as the driver does, and counts
    counts: bool = False


COMPENSATOR = Layout(
    ('compensator',), ('compensator_relay',), 'events', 'inputs', 'hear_poses')
IK_SERVICE = Layout(('ik_service',), ('ik_relay',), 'events', 'poses', 'hear_setpoints')
DEPLOYMENT = Layout(
    ('manipulator',), ('compensator_relay', 'ik_relay'), 'single', 'inputs', 'hear_setpoints',
    counts=True)
EMPTY_DEPLOYMENT = DEPLOYMENT._replace(relays=('deployment_relay',), executor='events')
RELAY_GOALS = '<= 1.15', '<= 1.2'  # p50, CPU
ALONE = (  # beside an empty relay: layout, rate
    (COMPENSATOR, DEFAULT_RATE), (COMPENSATOR, FAST_RATE), (IK_SERVICE, DEFAULT_RATE))
DRIVER = 'both processes without the CAN cycle, setpoint sent to taken'
PATIENT = (  # of drives that must not stop where the computer is busy
    '-p', 'controller.max_missed_cycles:=10', '-p', 'controller.watchdog_timeout:=1.0',
    '-p', 'controller.heartbeat_timeout:=0.5')
STACK = {True: ('manipulator', 'recorder'), False: ('deployment_relay', 'recorder_relay')}
TIMES = {True: (0.3, 0.8), False: (1.0, 4.0)}  # warm-up and duration by quick [s]


def again(measure: Callable[[], T]) -> T:
    """Measure once more where a process has ended by itself or nothing was heard."""
    try:
        return measure()
    except (OSError, RuntimeError, ValueError) as error:  # Fast DDS writes its log to stdout
        print(f'  {error}: measured again')
        return measure()


def run(layout: Layout, is_ours: bool, rate: float, quick: bool) -> Load:
    """Measure one layout."""
    executor = 'events' if is_ours else layout.executor
    with Processes() as processes:
        counted = list(layout.ours if is_ours else layout.relays)
        for name in counted:
            if not is_ours:
                processes.role(name, executor, rate)
            elif name == 'ik_service':
                processes.node(name)
            else:
                processes.node(name, f'rate:={rate}')
        listener = layout.listener
        if layout.counts:
            listener = 'hear_as_the_driver' if is_ours else listener
            counted.append(listener)
        processes.role(listener, executor, rate)
        processes.role(layout.inputs, 'events', rate)
        return processes.measure(counted, listener, *TIMES[quick])


def medians(measures: Sequence[Callable[[], Load]], rounds: int) -> list[Load]:
    """Measure all in turns; return the median of each."""
    turns = [[again(measure) for measure in measures] for _ in range(rounds)]
    return [Load(*(median(values) for values in zip(*side, strict=True)))
            for side in zip(*turns, strict=True)]


def start_driver(processes: Processes, is_ours: bool, rate: float) -> None:
    """Start the driver, or a relay in its place, with a CAN cycle of some rate."""
    processes.script(
        'driver_role', 'driver' if is_ours else 'relay', str(rate), '--ros-args',
        '-r', '__ns:=/bench', '-p', 'simulate_drives:=true',
        '-p', 'bus.channel:=driver_bench', '-p', f'controller.rate:={rate:.0f}', *PATIENT)


def hear_driver(processes: Processes, quick: bool, others: Sequence[str] = ()) -> tuple:
    """Return latencies of setpoints [s], CPU of the driver without its cycle, and of all."""
    role = processes.running['driver_role']
    until(lambda: listen(role, 0.2)[0])
    warm_up, duration = TIMES[quick]
    time.sleep(warm_up)
    before, begin = processes.cpu(others), time.monotonic()
    taken, apart, whole = listen(role, duration)
    if not taken:
        raise RuntimeError(f'no setpoint was taken: {processes.last_line("driver_role")}')
    return taken, apart, whole + (processes.cpu(others) - before) / (time.monotonic() - begin)


def run_driver(is_ours: bool, quick: bool) -> Load:
    """Measure the driver's side of ROS: latencies of setpoints, CPU of both processes."""
    with Processes() as processes:
        start_driver(processes, is_ours, FAST_RATE)
        processes.role('setpoints', 'events', DEFAULT_RATE)
        taken, apart, _ = hear_driver(processes, quick)
        return load(taken, apart)


def run_stack(is_ours: bool, quick: bool) -> Load:
    """Measure driver, control loop, manipulator and recorder; drives and estimator are apart."""
    with Processes() as processes, TemporaryDirectory() as folder:
        start_driver(processes, is_ours, DEFAULT_RATE)
        for name in STACK[is_ours]:
            if is_ours:
                processes.node(name, *[f'folder:={folder}'] * (name == 'recorder'))
            else:
                processes.role(name, 'events', DEFAULT_RATE)
        processes.role('estimates', 'events', DEFAULT_RATE)
        taken, _, cpu = hear_driver(processes, quick, STACK[is_ours])
        print(f'  {"stack" if is_ours else "relays"}: {processes.memory():.0f} MiB')
        return load(taken, cpu)


def nodes(rounds: int, quick: bool) -> list[Row]:
    """R1, R2 and S1."""
    rounds = 1 if quick else rounds
    rows = []
    for layout, rate in ALONE[:1] if quick else ALONE:
        ours, relay = medians(
            [partial(run, layout, is_ours, rate, quick) for is_ours in (True, False)], rounds)
        rows += _both(f'{layout.ours[0]} at {rate:g} Hz, beside an empty relay', ours, relay,
                      'R1', RELAY_GOALS)
    ours, relay = medians([partial(run_driver, one, quick) for one in (True, False)], rounds)
    rows += _both(f'driver at 100 Hz, {DRIVER}, beside an empty relay', ours, relay,
                  'R1', ('<= 1.25', '<= 1.4'))
    ours, relays, empty = medians([
        partial(run, DEPLOYMENT, True, FAST_RATE, quick),
        partial(run, DEPLOYMENT, False, FAST_RATE, quick),
        partial(run, EMPTY_DEPLOYMENT, False, FAST_RATE, quick)], rounds)
    rows += _both('deployment at 500 Hz, beside three SingleThreadedExecutor relays', ours,
                  relays, 'R2', ('<= 0.4', ''))
    rows += _both('deployment at 500 Hz, beside an empty relay of the same shape', ours,
                  empty, 'R2', ('', '<= 1.1'))
    ours, empty = medians([partial(run_stack, one, quick) for one in (True, False)], rounds)
    return rows + _both(
        'whole stack at 100 Hz, beside empty nodes and a CAN cycle of python-can', ours, empty,
        'S1', ('', '<= 1.3'))


def _both(name: str, ours: Load, relay: Load, goal_id: str, goals: tuple[str, str]) -> list[Row]:
    figures = ('p50', ours.p50, relay.p50, 'us'), ('CPU', ours.cpu, relay.cpu, '%')
    return [compare(f'{name}: {what}', *values, goal_id, goal)
            for (what, *values), goal in zip(figures, goals, strict=True) if goal]
