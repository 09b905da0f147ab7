"""
Run the whole stack on one computer: real nodes, simulated drives, a swaying gondola.

The demo acts as the supervisor of a cleaning robot. It configures, homes and activates the drives
through the nodes' services and sends cleaning strokes. Whenever it ends, it first stops the drives
and then reports the run.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
import json
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
import yaml

from facade_manipulator import topics
from facade_manipulator.client import ManipulatorClient, NoAnswerError
from facade_manipulator.commands import above_zero, exit_status
from facade_manipulator.errors import InputError, ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes import messages
from facade_manipulator.nodes.run import initialise, STOP_SIGNALS
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.resources import config_path
from facade_manipulator.simulation.demo.samples import Run
from facade_manipulator.simulation.gondola_simulator import require_display
from facade_manipulator.simulation.world.scenario import load_scenario

NAMESPACE = 'demo'
RECORDED = topics.HEAD_POSE, topics.RAIL_POSE, topics.REFERENCE, topics.CONTACT_WRENCH
SAMPLES = 30_000  # for each topic: the last 300 s at 100 Hz
# best effort, so that no node waits for the demo; 1 s of messages may wait
BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
OPERATION, CORRECTION = 'driver: operation', 'compensator: correction'  # on /diagnostics
COUNTERS = {  # of the summary: component and key on /diagnostics
    'bus_cycles': ('driver: bus', 'cycles'), 'missed_cycles': ('driver: bus', 'missed cycles'),
    'late_cycles': ('driver: bus', 'late commands'), 'drive_faults': (OPERATION, 'drive faults'),
    'rejected_goals': ('ik_service: goal', 'rejected')}
CYCLES = ('{bus_cycles} bus cycles, {late_cycles} late, {missed_cycles} missed, '
          '{drive_faults} drive faults, {rejected_goals} goals rejected')
MODULES = 'simulation.gondola_simulator', 'nodes.driver', 'nodes.manipulator'
ESTIMATOR = 'nodes.disturbance_estimator'  # only with raw sensors
# a node ends with the demo, even if the demo is killed: 1 is PR_SET_PDEATHSIG
START = ('import ctypes, signal; ctypes.CDLL(None).prctl(1, signal.SIGTERM); '
         'from facade_manipulator.{} import main; raise SystemExit(main())')
PATIENCE = 5.0  # s, maximum time until a node ends
PARAMETER_FILES = config_path('manipulator.yaml'), config_path('simulation.yaml')
SUMMARY, FORCE = 'summary.json', 'force.png'
PICTURES = 'errors.png', 'moments.png', FORCE, 'linkage.gif'  # functions of `pictures`
ESTIMATE_TIMEOUT = 15.0  # s; the estimator of raw sensors needs 7 s to start
LINE_PERIOD, TURN = 1.0, 0.1  # s, period of the lines and of the checks of the goal
LINE_SAMPLES = 200  # at 100 Hz; the line counts the second half, the last second
LAST_COUNTERS = 1.2  # s: each node publishes its counters once a second
say = partial(print, flush=True)


class Demo:
    """One run: start the nodes, send strokes, stop the drives, report."""

    def __init__(self, options: argparse.Namespace) -> None:
        if options.viewer:
            require_display()
        self.options, self.output = options, options.output
        self.output.mkdir(parents=True, exist_ok=True)
        self.scenario = load_scenario(options.scenario)
        self.duration: float = options.duration or self.scenario.mission.duration
        self.geometry = settings_from(
            Geometry, read_parameters(PARAMETER_FILES, 'driver'), 'geometry')
        self.nodes: dict[str, subprocess.Popen[bytes]] = {}
        initialise()  # rclpy's own signal handlers would end ROS before the drives are stopped
        self.client = ManipulatorClient(NAMESPACE, 'demo_supervisor', self.watch)
        self.components: dict[str, DiagnosticStatus] = {}  # latest diagnostics by name
        kind, name, qos = topics.DIAGNOSTICS
        self.client.node.create_subscription(kind, name, self.keep_components, qos)
        self.rows = [deque[tuple[float, ...]](maxlen=SAMPLES) for _ in RECORDED]
        for topic, rows in zip(RECORDED, self.rows, strict=True):
            self.client.node.create_subscription(
                topic.type, topic.name, partial(keep, rows), BEST_EFFORT)
        self.begin, self.next_line = math.inf, 0.0  # of strokes and line [s, monotonic]
        # `watch` checks the signals: an exception in a handler could leave a node running
        self.signals: list[int] = []

    def run(self) -> None:
        """Run to the end; in every case stop the drives first, then the nodes."""
        handle_signals(lambda number, _: self.signals.append(number))
        try:
            self.start_nodes()
            self.bring_up()
            self.begin, self.next_line = time.monotonic(), 0.0
            while (elapsed := time.monotonic() - self.begin) < self.duration:
                if (goal := self.scenario.mission.goal(elapsed)) != self.client.goal:
                    self.client.send_goal(goal)
                self.watch()
                time.sleep(TURN)
            time.sleep(LAST_COUNTERS)
            self.watch()
            run, counters = self.recorded(), self.counters()  # without the messages of the stop
        finally:
            handle_signals(signal.SIG_IGN)  # no signal interrupts the stop of the drives
            self.stop()
        handle_signals(signal.default_int_handler)
        self.report(run, counters)

    def start_nodes(self) -> None:
        """Start the nodes with the parameters of the scenario."""
        say(self.scenario.description)
        for name in (SUMMARY, *PICTURES, 'disturbance_estimator.log'):
            (self.output / name).unlink(missing_ok=True)  # files of an earlier run would mislead
        parameters = self.output / 'scenario.yaml'
        parameters.write_text(yaml.safe_dump({  # `-p` would not overrule manipulator.yaml
            '/**/compensator': {'ros__parameters': self.scenario.compensator},
            '/**/gondola_simulator': {'ros__parameters': {
                'scenario': self.options.scenario, 'viewer': self.options.viewer}}}))
        files = [word for file in (*PARAMETER_FILES, parameters)
                 for word in ('--params-file', str(file))]
        say(f'starting the nodes (logs in {self.output}/); Ctrl-C stops the drives first')
        for module in (*MODULES, *([ESTIMATOR] if self.scenario.raw_sensors else [])):
            name = module.split('.')[1]
            with (self.output / f'{name}.log').open('w') as log:
                self.nodes[name] = subprocess.Popen(
                    [sys.executable, '-P', '-c', START.format(module), '--ros-args',
                     '-r', f'__ns:=/{NAMESPACE}', *files],
                    stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                    process_group=0,  # Ctrl-C in the terminal reaches only the demo
                    env={**os.environ, 'PYTHONUNBUFFERED': '1'})

    def bring_up(self) -> None:
        """Power the drives on and wait for the disturbance."""
        for name in ('configure', 'home', 'activate'):
            say(f'driver: {name}')
            getattr(self.client, name)()
        say('compensator: wait for an estimate of the disturbance')
        with suppress(NoAnswerError):  # a scenario may have no estimates
            self.client.wait_until(
                lambda: messages.status_level(self.component(CORRECTION)) == 'ok',
                'an estimate of the disturbance', ESTIMATE_TIMEOUT)

    def watch(self) -> None:
        """Check for signals, ended nodes and stopped drives; called while the demo waits."""
        if self.signals:
            say('interrupted: stopping')
            raise KeyboardInterrupt
        now = time.monotonic()
        if now < self.next_line:
            return
        self.next_line = now + LINE_PERIOD
        for name, process in self.nodes.items():
            if process.poll() is not None:
                raise ManipulatorError(f'{name} ended with exit status {process.returncode}; '
                                       f'next: read {self.output}/{name}.log')
        if 0.0 <= now - self.begin < self.duration:
            operation, correction = map(self.component, (OPERATION, CORRECTION))
            cycles, figures = CYCLES.format(**self.counters()), 'error not measured yet'
            if messages.status_level(operation) == 'error':
                raise ManipulatorError(f'driver: {operation.message}; {cycles}')
            with suppress(ManipulatorError):
                figures = ', '.join(self.recorded(LINE_SAMPLES).figures)
            say(f'{now - self.begin:5.1f} s of {self.duration:g} s | {operation.message}, '
                f'{correction.message} | RMS of 1 s: {figures} | {cycles}')

    def keep_components(self, message: Any) -> None:
        """Record the components of a node."""
        self.components.update((status.name, status) for status in message.status)

    def component(self, name: str) -> DiagnosticStatus:
        """Return the latest diagnostics of a component, empty before the first message."""
        return self.components.get(f'{NAMESPACE}/{name}', DiagnosticStatus())

    def counters(self) -> dict[str, int]:
        """Return the counters of the summary."""
        return {name: int(messages.status_values(self.component(component)).get(key, 0))
                for name, (component, key) in COUNTERS.items()}

    def recorded(self, count: int = SAMPLES) -> Run:
        """Return the latest samples of the run."""
        return Run([list(rows)[-count:] for rows in self.rows], self.scenario, self.geometry)

    def stop(self) -> None:
        """Stop the drives, then end the nodes; kill the nodes that exceed the timeout."""
        self.signals.clear()
        self.next_line = math.inf
        try:
            # no driver answers before its node has started
            if self.component(OPERATION).message and self.client.driver_state() == 'active':
                say('driver: deactivate: ramp down, power off')
                self.client.deactivate()
        except ManipulatorError as error:
            say(error)  # the driver stops its drives when it ends
        self.client.close()
        rclpy.try_shutdown()
        for process in self.nodes.values():
            process.send_signal(signal.SIGINT)  # no effect on an ended process
        for process in self.nodes.values():
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()

    def report(self, run: Run, counters: dict[str, int]) -> None:
        """Print and draw the run; raises a ManipulatorError if a result is below its bound."""
        names = 'disturbance_rms', 'residual_rms', 'attenuation_db'
        axes = {axis: dict(zip(names, figures, strict=True)) for axis, figures in zip(
            Pose._fields, run.rms.T.tolist(), strict=True)}
        (self.output / SUMMARY).write_text(json.dumps(
            {'axes': axes, 'duration_s': self.duration, **counters}, indent=2) + '\n')
        cycles = CYCLES.format(**counters)
        say('RMS error on the wall without → with compensation (attenuation)', *run.figures,
            cycles, f'drawing the pictures in {self.output}/', sep='\n')
        # matplotlib is imported here, so that it does not delay the start of the nodes
        from facade_manipulator.simulation.demo import pictures

        with TemporaryDirectory(dir=self.output, prefix='.drafts_') as drafts:
            for draft in (Path(drafts) / name for name in PICTURES):
                if draft.name != FORCE or len(run.forces):
                    picture = getattr(pictures, draft.stem)(run)
                    (picture.savefig if draft.suffix == '.png' else picture.save)(draft)
                    draft.replace(self.output / draft.name)
        say(f'written in {self.output}/: {SUMMARY}, pictures, animation, logs')
        if run.low and self.duration >= self.scenario.mission.shown_after:
            raise ManipulatorError(
                f'attenuation too low: {"; ".join(run.low)}; {cycles}; '
                'next: end other programs and run it again, then read the logs of the nodes')


def keep(rows: deque[tuple[float, ...]], message: Any) -> None:
    """Record stamp and planar values of a message."""
    with suppress(InputError):  # the nodes reject such a message as well
        is_pose = hasattr(message, 'pose')
        values = (messages.planar_pose(message.pose, 'pose') if is_pose
                  else messages.planar_wrench(message))
        rows.append((messages.seconds(message.header.stamp), *values))


def handle_signals(action: Callable[..., object] | signal.Handlers) -> None:
    """Set the handler of all signals that stop the demo."""
    for number in STOP_SIGNALS:
        signal.signal(number, action)


def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit status."""
    parser = argparse.ArgumentParser(
        prog='demo', description='Run the whole stack with simulated drives on a swaying gondola.')
    add = parser.add_argument
    add('--duration', type=above_zero, metavar='S',
        help='duration of the strokes [s] (default: that of the scenario)')
    add('--scenario', default='breeze', help='wind and wall: a name in config/scenarios, or a '
        'file (default %(default)s)')
    add('--viewer', action='store_true', help="show the world in MuJoCo's viewer")
    add('--output', type=Path, default=Path('demo_report'), metavar='DIR',
        help='folder of the report (default %(default)s)')
    options = parser.parse_args(args)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return exit_status('demo', lambda: Demo(options).run(),
                       interrupted='interrupted: drives stopped, nodes ended')


if __name__ == '__main__':
    raise SystemExit(main())
