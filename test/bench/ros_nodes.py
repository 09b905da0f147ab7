"""C1, R1, R2 and S1: processes of the package, compared with empty processes."""

from functools import partial
import json
from pathlib import Path
import signal
from statistics import median
import subprocess
from tempfile import TemporaryDirectory
import time

from cheap_drives import cpu_of_process, HORIZON
from own_processes import end_process, free_domain, Processes
from rows import in_turns, row
from support import children, limited

PATIENCE = 90.0  # s, for one measurement
# words of an empty process that replaces a node or several nodes
COMPENSATOR = 'goal_pose> end_effector_pose> disturbance> {}>corrected_pose'
IK_SERVICE = 'corrected_pose>joint_setpoints joint_states>end_effector_pose'
DEPLOYMENT = (
    'goal_pose> disturbance> 100>joint_setpoints joint_states>end_effector_pose'
)
DRIVER = '{}>python_can 100>joint_states joint_setpoints>!'
SWAY = '2>goal_pose {}>disturbance 100>joint_states joint_setpoints>'  # feeds a compensator
# of figures
UNITS = {
    'p50': 'us',
    'CPU': '%',
    'cycle': 'us',
    'whole CPU': '%',
    'memory': 'MiB',
}


def role(words, executor='events'):
    """Return the command of an empty process, a feeder or a listener."""
    return 'processes', executor, *words.split()


def node(module, *parameters):
    """Return the command of a node of the package."""
    words = [module, '--ros-args', '-r', '__ns:=/bench']
    for one in parameters:
        words += ['-p', one]
    return tuple(words)


def driver(rate):
    """Return the command of a driver that does not stop where the computer is busy."""
    return node(
        'driver',
        'simulate_drives:=true',
        'bus.channel:=bench',
        f'controller.rate:={rate}',
        'controller.max_missed_cycles:=10',
        'controller.heartbeat_timeout:=0.5',
    )


NODES = 'facade_manipulator.nodes.'
LEAD = f'horizon:={HORIZON}'  # that the latency of a pose contains
POSES = role('corrected_pose>!')
SETPOINTS = role('joint_setpoints>!')
MOVING = role('100>joint_setpoints joint_states>')
#: name, bounds of the figures, processes of both sides without the last, and the last process,
#: which feeds the others; the first process of a side reports
LAYOUTS = (
    (
        'R1 compensator at 100 Hz / empty relay',
        {'CPU': '<= 1.6', 'p50': '<= 1.3'},
        (POSES, node(NODES + 'compensator', LEAD)),
        (POSES, role(COMPENSATOR.format(100))),
        role(SWAY.format(100)),
    ),
    (
        'R1 ik_service at 100 Hz / empty relay',
        {'CPU': '<= 1.2', 'p50': '<= 1.2'},
        (SETPOINTS, node(NODES + 'ik_service')),
        (SETPOINTS, role(IK_SERVICE)),
        role('100>corrected_pose 100>joint_states joint_setpoints>'),
    ),
    (
        'R1 driver at 100 Hz / empty relay',
        {'CPU': '<= 1.5', 'p50': '<= 1.5'},
        (driver(500),),
        (role(DRIVER.format(500)),),
        MOVING,
    ),
    (
        'C1 whole cycle at 500 Hz / bare exchange on canopen',
        {'cycle': '<= 1.3'},
        (driver(500),),
        (role('500>canopen joint_setpoints>!'),),
        MOVING,
    ),
    (
        'R2 deployment at 500 Hz / three SingleThreadedExecutor relays',
        {'p50': '<= 0.4'},
        (SETPOINTS, node(NODES + 'manipulator', 'rate:=500.0', LEAD)),
        (
            role('joint_setpoints>!', 'single'),
            role(COMPENSATOR.format(500), 'single'),
            role(IK_SERVICE, 'single'),
        ),
        role(SWAY.format(500)),
    ),
    (
        'S1 whole stack at 100 Hz / empty nodes and python-can',
        {'whole CPU': '<= 1.5', 'memory': '<= 1.25'},
        (driver(100), node(NODES + 'manipulator', LEAD)),
        (role(DRIVER.format(100)), role(DEPLOYMENT)),
        role('2>goal_pose 100>disturbance'),
    ),
)


def memory_of(pid):
    """Return the private memory of a process [bytes]."""
    kilobytes = 0
    for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines():
        if line.startswith('Private'):
            kilobytes += int(line.split()[1])
    return 1024.0 * kilobytes


def measure(quick, commands, _):
    """
    Measure processes: the first reports, the last publishes the inputs of the others.

    The result is the median latency [s], the processor time without the CAN cycle [s/s], that of a
    cycle at 500 Hz [s], the whole processor time [s/s], and the memory [bytes] of all processes
    except the last.
    """
    with (
        free_domain() as domain,
        TemporaryDirectory() as folder,
        limited('it', PATIENCE),
    ):
        environment = {
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONPATH': str(Path(__file__).parent),
            'BENCH_TIMES': '0.3 0.8' if quick else '1.0 4.0',
        }
        start = partial(
            Processes(Path(folder)).start,
            text=True,
            stdout=subprocess.PIPE,
            env=environment,
        )
        running = [start(*command) for command in commands]
        samples = []
        try:
            for _ in range(2):
                # Fast DDS may write other lines
                line = next(one for one in running[0].stdout if one.startswith('['))
                latencies, cpu, cycle = json.loads(line)
                cpu += sum(cpu_of_process(one.pid) for one in running[1:-1])
                samples.append((time.monotonic(), cpu, cycle))
            elapsed, cpu, cycle = (
                end - begin for begin, end in zip(*samples, strict=True)
            )
            memory = 0.0
            for one in running[:-1]:
                memory += sum(map(memory_of, (one.pid, *children(one.pid))))
            return (
                median(latencies),
                cpu / elapsed,
                cycle / elapsed / 500.0,
                (cpu + cycle) / elapsed,
                memory,
            )
        finally:
            for one in running:
                one.send_signal(signal.SIGINT)
            for one in running:
                end_process(one)


def rows(quick):
    """Compare both sides of one layout after another."""
    for name, goals, ours, theirs, feeder in LAYOUTS:
        contenders = [
            partial(measure, quick, (*ours, feeder)),
            partial(measure, quick, (*theirs, feeder)),
        ]
        sides = in_turns(contenders, 1 if quick else 7)
        for figure, goal in goals.items():
            index = list(UNITS).index(figure)
            yield row(
                f'{name}: {figure}', UNITS[figure], goal, *(one[index] for one in sides)
            )
