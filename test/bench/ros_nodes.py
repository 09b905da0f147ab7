"""C1, R1, R2 and S1: processes of the package, compared with empty processes."""

from functools import partial
import json
import os
from pathlib import Path
import signal
from statistics import median
import subprocess
from tempfile import TemporaryDirectory
import time

from cheap_drives import cpu_of_process
from own_processes import end_process, free_domain, Processes
from rows import in_turns, row
from support import children

NAMESPACE = ('--ros-args', '-r', '__ns:=/bench')
SWAY = '2>goal_pose {0}>disturbance 100>joint_states joint_setpoints>'  # feeds a compensator
COMPENSATOR = 'goal_pose> end_effector_pose> disturbance> {0}>corrected_pose'
IK_SERVICE = 'corrected_pose>joint_setpoints joint_states>end_effector_pose'
DEPLOYMENT = 'goal_pose> disturbance> 100>joint_setpoints joint_states>end_effector_pose'
DRIVER = '{0}>python_can 100>joint_states joint_setpoints>!'
PATIENT = (  # of drives that must not stop where the computer is busy
    'simulate_drives:=true', 'bus.channel:=bench', 'controller.max_missed_cycles:=10',
    'controller.heartbeat_timeout:=0.5')


def role(words, kind='events'):
    """Return the command of an empty process, a feeder or a listener."""
    return ('processes', kind, *words.split(), *NAMESPACE)


def node(module, *parameters):
    """Return the command of a node of the package."""
    return (*module.split(), *NAMESPACE, *(word for one in parameters for word in ('-p', one)))


def driver(rate):
    return node('driver', *PATIENT, f'controller.rate:={rate}')


def listen(process):
    """Return the next report; Fast DDS may write other lines."""
    while not (line := process.stdout.readline()).startswith('['):
        if not line:
            raise ChildProcessError('a process of the bench has ended')
    return json.loads(line)


def memory_of(pid):
    """Return the private memory of a process [bytes]."""
    return 1024.0 * sum(
        int(line.split()[1]) for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()
        if line.startswith('Private'))


def measure(quick, commands, _):
    """
    Measure processes: the first reports, the last publishes the inputs of the others.

    The result is the median latency [s], the processor time without and of the CAN cycle [s/s],
    and the memory [bytes] of all processes except the last.
    """
    with free_domain() as domain, TemporaryDirectory() as folder:
        start = partial(Processes(Path(folder)).start, text=True, stdout=subprocess.PIPE, env={
            'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'PYTHONPATH': str(Path(__file__).parent),
            'BENCH_TIMES': '0.3 0.8' if quick else '1.0 4.0'})
        running = [start(*command) for command in commands]
        samples = []
        try:
            for _ in range(2):
                latencies, cpu, cycle = listen(running[0])
                cpu += sum(cpu_of_process(one.pid) for one in running[1:-1])
                samples.append((time.monotonic(), cpu, cycle))
            elapsed, cpu, cycle = (end - begin for begin, end in zip(*samples, strict=True))
            pids = [pid for one in running[:-1] for pid in (one.pid, *children(one.pid))]
            return median(latencies), cpu / elapsed, cycle / elapsed, sum(map(memory_of, pids))
        finally:
            for one in running:
                if one.poll() is None:
                    os.killpg(one.pid, signal.SIGINT)
            for one in running:
                end_process(one)


def rows(quick):
    """Compare one layout after another."""
    def compare(*sides):
        return in_turns([partial(measure, quick, side) for side in sides], 1 if quick else 7)

    def both(name, ours, relay, *goals):
        for index, figure, unit, goal in ((1, 'CPU', '%', goals[0]), (0, 'p50', 'us', goals[1])):
            yield row(f'R1 {name} at 100 Hz / empty relay: {figure}', unit, goal, ours[index],
                      relay[index])

    hear, world = role('corrected_pose>!'), role(SWAY.format(100))
    yield from both('compensator', *compare(
        (hear, node('facade_manipulator.nodes.compensator'), world),
        (hear, role(COMPENSATOR.format(100)), world)), '<= 1.8', '<= 1.3')
    hear = role('joint_setpoints>!')
    world = role('100>corrected_pose 100>joint_states joint_setpoints>')
    yield from both('ik_service', *compare(
        (hear, node('facade_manipulator.nodes.ik_service'), world),
        (hear, role(IK_SERVICE), world)), '<= 1.2', '<= 1.15')
    world = role('100>joint_setpoints joint_states>')
    ours, relay, canopen = compare(
        (driver(500), world), (role(DRIVER.format(500)), world),
        (role('500>canopen joint_setpoints>!'), world))
    yield from both('driver', ours, relay, '<= 1.9', '<= 1.6')
    yield row('C1 whole cycle at 500 Hz / bare exchange on canopen', 'us', '<= 1.3',
              ours[2] / 500.0, canopen[2] / 500.0)
    world = role(SWAY.format(500))
    ours, relays = compare(
        (hear, node('facade_manipulator.nodes.manipulator', 'rate:=500.0'), world),
        (role('joint_setpoints>!', 'single'), role(COMPENSATOR.format(500), 'single'),
         role(IK_SERVICE, 'single'), world))
    yield row('R2 deployment at 500 Hz / three SingleThreadedExecutor relays: p50', 'us', '<= 0.4',
              ours[0], relays[0])
    world = role('2>goal_pose 100>disturbance')
    ours, empty = compare(
        (driver(100), node('facade_manipulator.nodes.manipulator'), world),
        (role(DRIVER.format(100)), role(DEPLOYMENT), world))
    for figure, unit, goal, part in (
            ('CPU', '%', '<= 1.45', slice(1, 3)), ('memory', 'MiB', '<= 1.15', slice(3, 4))):
        yield row(f'S1 whole stack at 100 Hz / empty nodes and python-can: {figure}', unit, goal,
                  sum(ours[part]), sum(empty[part]))
