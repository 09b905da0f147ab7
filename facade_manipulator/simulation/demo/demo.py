"""
Demo of the whole stack on one computer: real nodes, simulated drives and a swaying gondola.

The demo acts as the supervisor of a cleaning robot. It configures, homes and activates the drives
through the nodes' services and sends cleaning strokes. At its end, the demo first ends the nodes,
and the driver stops the drives. Then the demo reports the run.
"""

from __future__ import annotations

import argparse
from collections import defaultdict, deque
from contextlib import suppress
from functools import partial
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
from rclpy.node import Node

from facade_manipulator import topics
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.command_line import above_zero, exit_status, require_packages
from facade_manipulator.drives.realtime import PERMIT_PRIORITY
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics.planar import POSE_AXES
from facade_manipulator.nodes import planar_messages
from facade_manipulator.nodes.run import handle_signals, initialise
from facade_manipulator.nodes.workarounds import take_waiting
from facade_manipulator.package_files import config_path
from facade_manipulator.simulation.demo import demo_report
from facade_manipulator.simulation.world.scenario import (
    load_scenario,
    simulation_parameters,
)
from facade_manipulator.timeouts import DRIVER_TIMEOUT

say = partial(print, sep='\n', flush=True)


class Demo:
    """Run of the demo: starts the nodes, sends goals, ends the nodes and reports the result."""

    NAMESPACE = 'demo'
    RECORDED = (
        topics.HEAD_POSE,
        topics.RAIL_POSE,
        topics.REFERENCE,
        topics.CONTACT_WRENCH,
    )
    KEPT_SAMPLES = 30_000  # for each topic: the last 300 s at 100 Hz
    # components on /diagnostics
    OPERATION = 'driver: operation'
    BUS = 'driver: bus'
    CORRECTION = 'compensator: correction'
    PRIORITY = 'real-time priority'  # key of the bus
    COUNTERS = {  # component and key on /diagnostics
        'bus_cycles': (BUS, 'cycles'),
        'late_cycles': (BUS, 'late commands'),
        'missed_cycles': (BUS, 'missed cycles'),
        'drive_faults': (OPERATION, 'drive faults'),
        'rejected_goals': ('ik_service: goal', 'rejected'),
    }
    MODULES = 'simulation.gondola_simulator', 'nodes.driver', 'nodes.manipulator'
    ESTIMATOR = 'nodes.disturbance_estimator'  # only with raw sensors
    # a node ends with the demo
    START_COMMAND = ('setpriv', '--pdeathsig', 'TERM', sys.executable, '-uPm')
    PARAMETER_FILES = config_path('manipulator.yaml'), config_path('simulation.yaml')
    RESULTS = (
        'summary.json',
        'errors.png',
        'force.png',
        'linkage.gif',
        'disturbance_estimator.log',
    )
    ESTIMATE_TIMEOUT = 15.0  # s; the estimator of raw sensors needs 7 s to start
    CHECK_PERIOD = 0.1  # s, period of the checks of goal and drives
    LINE_SAMPLES = 200  # at 100 Hz; the line counts the second half, the last second
    LAST_COUNTERS = 1.2  # s: each node publishes its counters once a second

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.output: Path = options.output
        self.scenario = load_scenario(options.scenario)
        self.duration: float = options.duration or self.scenario.mission.duration
        self.output.mkdir(parents=True, exist_ok=True)
        self.nodes: dict[str, subprocess.Popen[bytes]] = {}
        stale = partial(DiagnosticStatus, level=DiagnosticStatus.STALE)
        # latest diagnostics by name
        self.components = defaultdict[str, DiagnosticStatus](stale)
        self.tables = [
            deque[tuple[float, ...]](maxlen=self.KEPT_SAMPLES) for _ in self.RECORDED
        ]

        initialise()  # rclpy's own signal handlers would end ROS before the drives are stopped
        self.client = ManipulatorClient(self.NAMESPACE, 'demo_supervisor', self.watch)
        # The messages for this node wait until `watch` takes them. An executor would wake for each
        # message, and use a tenth of a processor.
        self.recorder = Node(
            'demo_recorder', namespace=self.NAMESPACE, start_parameter_services=False
        )
        for topic, table in zip(self.RECORDED, self.tables, strict=True):
            self.recorder.create_subscription(
                topic.type, topic.name, partial(keep_values, table), topics.QUEUE
            )
        self.recorder.create_subscription(
            topics.DIAGNOSTICS.type,
            topics.DIAGNOSTICS.name,
            self.keep_components,
            topics.QUEUE,
        )

    def run(self) -> None:
        """Run the demo to its end; stop the drives and end the nodes even after an error."""
        handle_signals(signal.default_int_handler)
        try:
            self.start_nodes()
            for name in ('configure', 'home', 'activate'):
                say(f'driver: {name}')
                getattr(self.client, name)()
            say('compensator: wait for an estimate of the disturbance')
            self.client.wait_until(
                lambda: (
                    planar_messages.status_level(self.components[self.CORRECTION])
                    == 'ok'
                ),
                'an estimate of the disturbance',
                self.ESTIMATE_TIMEOUT,
            )
            self.send_goals()
        finally:
            # no signal interrupts the stop of the drives
            handle_signals(signal.SIG_IGN)
            self.end_nodes()
        self.report(demo_report.Run(self.tables, self.scenario))

    def start_nodes(self) -> None:
        """Start all nodes with the parameters of the scenario."""
        say(self.scenario.description)
        for name in self.RESULTS:
            # files of an earlier run would mislead
            (self.output / name).unlink(missing_ok=True)

        arguments = ['--ros-args', '-r', f'__ns:=/{self.NAMESPACE}']
        for file in (*self.PARAMETER_FILES, self.write_parameters()):
            arguments += ['--params-file', str(file)]
        modules = list(self.MODULES)
        if self.scenario.raw_sensors:
            modules.append(self.ESTIMATOR)

        say(
            f'starting the nodes (logs in {self.output}/); Ctrl-C stops the drives first'
        )
        for module in modules:
            name = module.split('.')[1]
            command = [*self.START_COMMAND, f'facade_manipulator.{module}', *arguments]
            with (self.output / f'{name}.log').open('w') as log:
                # in its own group: Ctrl-C in the terminal reaches only the demo
                self.nodes[name] = subprocess.Popen(
                    command, stdout=log, stderr=log, process_group=0
                )

    def write_parameters(self) -> Path:
        """Write and return the scenario's parameter file, because `-p` does not override files."""
        content = simulation_parameters(
            self.options.scenario, viewer=self.options.viewer
        )
        path = self.output / 'scenario.yaml'
        path.write_text(json.dumps(content))
        return path

    def watch(self) -> None:
        """Receive messages and check that the nodes run; called while the demo waits."""
        take_waiting(self.recorder)
        for name, process in self.nodes.items():
            if process.poll() is not None:
                raise ManipulatorError(f'{name} ended: {self.last_line(name)}')

    def send_goals(self) -> None:
        """
        Send the goals of the mission when they are due, then wait for the last counters.

        A goal is sent if it differs from the last goal; `send_goal` waits until the compensator
        reports it. Prints a line each second. Raises a ManipulatorError if the drives or a node
        have failed, and a NoAnswerError if the compensator does not answer.
        """
        begin = time.monotonic()
        line_due = 0  # s since the begin
        while (
            elapsed := time.monotonic() - begin
        ) < self.duration + self.LAST_COUNTERS:
            goal = self.scenario.mission.goal(elapsed)
            # the head follows its last goal while the nodes publish their last counters
            if elapsed < self.duration and goal != self.client.goal:
                self.client.send_goal(goal)
            self.watch()
            operation = self.components[self.OPERATION]
            if planar_messages.status_level(operation) == 'error':
                raise ManipulatorError(f'driver: {operation.message}')
            if elapsed >= line_due:
                line_due = int(elapsed) + 1
                self.say_progress(elapsed)
            time.sleep(self.CHECK_PERIOD)

    def say_progress(self, elapsed: float) -> None:
        """Print states, newest errors and counters at a time since the start [s]."""
        figures = ['error not measured yet']
        newest = [list(table)[-self.LINE_SAMPLES :] for table in self.tables]
        with suppress(ManipulatorError):
            figures = demo_report.Run(newest, self.scenario).figures

        operation = self.components[self.OPERATION]
        correction = self.components[self.CORRECTION]
        say(
            f'{elapsed:5.1f} s of {self.duration:g} s | {operation.message}, '
            f'{correction.message} | RMS of 1 s: {", ".join(figures)} | '
            f'{as_text(self.counters())}'
        )

    def end_nodes(self) -> None:
        """End the nodes, including driver and drives; kill each node that does not end."""
        say('stopping the drives, ending the nodes')
        self.client.close()
        rclpy.try_shutdown()
        for process in self.nodes.values():
            process.send_signal(signal.SIGINT)  # no effect on an ended process
        for process in self.nodes.values():
            with suppress(subprocess.TimeoutExpired):
                process.wait(DRIVER_TIMEOUT)
            process.kill()  # also no effect on an ended process
        if 'driver' in self.nodes:
            say(self.last_line('driver'))

    def write_summary(self, run: demo_report.Run, counters: dict[str, int]) -> None:
        """Write the results of a run in a machine-readable file."""
        names = ('disturbance_rms', 'residual_rms', 'attenuation_db')
        axes = {}
        for (axis, *_), figures in zip(POSE_AXES, run.rms.tolist(), strict=True):
            axes[axis] = dict(zip(names, figures, strict=True))
        summary = {
            'axes': axes,
            'duration_s': self.duration,
            'realtime_priority': self.priority,
            **counters,
        }
        text = json.dumps(summary, indent=2)
        (self.output / 'summary.json').write_text(f'{text}\n')

    def report(self, run: demo_report.Run) -> None:
        """Print and plot the results; raise a ManipulatorError if a requirement is not met."""
        counters = self.counters()
        self.write_summary(run, counters)

        # a signal may end the drawing, which is in memory, but not the writing of a file
        handle_signals(signal.default_int_handler)
        say(
            'RMS error on the wall without → with compensation (attenuation)',
            *run.figures,
            as_text(counters),
            f'scheduling: {self.scheduling}',
            f'drawing the pictures in {self.output}/',
        )
        pictures = demo_report.draw(run)
        handle_signals(signal.SIG_IGN)
        for name, content in pictures.items():
            (self.output / name).write_bytes(content)
        say(f'written in {self.output}/: summary.json, pictures, animation, logs')
        if run.low and self.duration >= self.scenario.mission.shown_after:
            raise ManipulatorError(
                f'attenuation too low: {"; ".join(run.low)}; {as_text(counters)}, '
                f'{self.scheduling}; next: end other programs and repeat the demo; if it '
                'fails again, read the logs of the nodes'
            )

    def keep_components(self, message: Any) -> None:
        """Store the components of a node by name, without its namespace."""
        for component in message.status:
            self.components[component.name.partition('/')[2]] = component

    def counters(self) -> dict[str, int]:
        """Return the counters for the summary."""
        counters = {}
        for name, (component, key) in self.COUNTERS.items():
            values = planar_messages.status_values(self.components[component])
            counters[name] = int(values.get(key, 0))
        return counters

    @property
    def priority(self) -> int:
        """Return the real-time priority of the control loop; 0 without real-time scheduling."""
        return int(
            planar_messages.status_values(self.components[self.BUS]).get(
                self.PRIORITY, 0
            )
        )

    @property
    def scheduling(self) -> str:
        """Describe the scheduling of the control loop."""
        if self.priority:
            return f'real-time priority {self.priority} of the control loop'
        return f'no real-time priority; {PERMIT_PRIORITY}'

    def last_line(self, name: str) -> str:
        """Return the last line of a node's log file."""
        return (self.output / f'{name}.log').read_text().strip().rpartition('\n')[2]


def keep_values(table: deque[tuple[float, ...]], message: Any) -> None:
    """Store stamp and planar values of a message."""
    if hasattr(message, 'pose'):
        values: tuple[float, ...] = planar_messages.planar_pose(message.pose, 'pose')
    else:
        values = planar_messages.planar_wrench(message)
    table.append((planar_messages.seconds(message.header.stamp), *values))


def as_text(counters: dict[str, int]) -> str:
    """Format counters as text, such as ``5 late cycles, 0 drive faults``."""
    text = ', '.join(f'{count} {name}' for name, count in counters.items())
    return text.replace('_', ' ')


def main(args: list[str] | None = None) -> int:
    """Run the demo; return 0, or 1 after an error, or 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(
        prog='demo',
        description='Run the whole stack with simulated drives on a swaying gondola.',
    )
    parser.add_argument(
        '--duration',
        type=above_zero,
        metavar='S',
        help='duration of the strokes [s] (default: from the scenario)',
    )
    parser.add_argument(
        '--scenario',
        default='breeze',
        help='wind and wall: a name in config/scenarios, or a file (default %(default)s)',
    )
    parser.add_argument(
        '--viewer', action='store_true', help="show the world in MuJoCo's viewer"
    )
    parser.add_argument(
        '--output',
        type=Path,
        default=Path('demo_report'),
        metavar='DIR',
        help='folder of the report (default %(default)s)',
    )
    options = parser.parse_args(args)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

    def run() -> None:
        # needed by the simulator, a node that the demo starts
        require_packages('mujoco')
        Demo(options).run()

    return exit_status('demo', run)


if __name__ == '__main__':
    raise SystemExit(main())
