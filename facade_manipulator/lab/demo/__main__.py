"""
The whole stack on one machine: real nodes, simulated drives, a gondola that sways.

The demo is a supervisor as a cleaning robot has one: it configures, homes and activates the
drives through the nodes' services, sends cleaning strokes, and stops the drives first when it
ends, however it ends.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import cycle
import json
import os
from pathlib import Path
import signal
from threading import Event
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from std_srvs.srv import Trigger
import yaml

from facade_manipulator import config_path, interfaces
from facade_manipulator.blackbox import read_recording
from facade_manipulator.diagnostics import OPERATION
from facade_manipulator.errors import exit_status, file_errors, ManipulatorError
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab import gondola
from facade_manipulator.lab.demo.course import course_of, HEAD, TOPICS
from facade_manipulator.lab.demo.processes import NodeProcesses
from facade_manipulator.lab.demo.report import counters, draw, PICTURES, SUMMARY, summary_lines
from facade_manipulator.lab.gondola import Scenario
from facade_manipulator.nodes.monitor import Observer, REFRESH_PERIOD, screen
from facade_manipulator.parameter_file import ALL_NODES, read_settings
from facade_manipulator.ros import ManipulatorClient, USAGE_ERROR

NODES = ('gondola_simulator', 'driver', 'manipulator', 'recorder')
ESTIMATOR = 'disturbance_estimator'  # beside them where the scenario has raw sensors
FIRST_GOAL_AFTER = 1.0
KEPT = 300.0  # s of a longer run, which the recorder keeps for the pictures
SAVE_TIMEOUT = 60.0  # s


class Demo:
    """One run: nodes up, strokes for a while, drives off, report."""

    def __init__(
        self, options: argparse.Namespace, console: Console, interrupted: Event
    ) -> None:
        self.options = options
        self.geometry = read_settings(
            _parameter_files(options), ALL_NODES, 'geometry', Geometry, f'/{options.namespace}')
        self.console = console
        self._interrupted = interrupted
        self._is_stopping = False
        self.output = options.output
        self.scenario = gondola.load_scenario(options.scenario) if options.scenario else Scenario()
        self.nodes = (*NODES, ESTIMATOR) if self.scenario.sensors.rail.present else NODES
        self.processes = NodeProcesses(self.output)
        self.client = ManipulatorClient(
            options.namespace, 'demo_supervisor', self._check_interrupt)
        self.observer = Observer(self.client)

    def run(self) -> None:
        """Run to the end; whatever happens the drives stop first, then the nodes end."""
        try:
            self._start_nodes()
            self._bring_up()
            begin = time.monotonic()
            self._strokes()
            self.client.spin(1.2)  # the nodes' last counters come within a second
            counted = counters(self.client, time.monotonic() - begin)
            recording = self._save()
        finally:
            self._is_stopping = True  # nothing interrupts the stopping of the drives
            self._stop()
        self._is_stopping = False
        self._report(recording, counted)

    def _check_interrupt(self) -> None:
        if self._interrupted.is_set() and not self._is_stopping:
            raise KeyboardInterrupt

    def _start_nodes(self) -> None:
        for name in PICTURES:  # beside a new summary an earlier run's would mislead
            (self.output / name).unlink(missing_ok=True)
        self.console.print(
            f'starting {", ".join(self.nodes)} in namespace {self.options.namespace} '
            f'(logs in {self.output}/)')
        if self.scenario.mission.description:
            self.console.print(self.scenario.mission.description)
        for name in self.nodes:
            self.processes.start(name, _ros_arguments(name, self.options, self.scenario))

    def _bring_up(self) -> None:
        for what, step in (
            ('configure: bus up, drives checked', self.client.configure),
            ('home', self.client.home),
            ('activate: power on', self.client.activate),
        ):
            self.processes.check()
            self.console.print(f'driver: {what}')
            step()

    def _strokes(self) -> None:
        self.client.spin(FIRST_GOAL_AFTER)
        begin = time.monotonic()
        with screen(self.console) as show:
            def remaining(*_: Any) -> float:
                self._require_moving_drives()
                self.processes.check()
                elapsed = time.monotonic() - begin
                show(self.observer.overview(), f' {elapsed:.1f} s of {self.options.duration:g} s '
                     '(Ctrl-C stops the drives first)')
                return self.options.duration - elapsed

            if self.scenario.mission.waits:
                self._follow_plan(remaining)
            while (left := remaining()) > 0.0:
                self._send_due_goal(self.options.duration - left)
                self.client.spin(REFRESH_PERIOD)

    def _follow_plan(self, remaining: Callable[..., Any]) -> None:
        """Go through the goals again and again, from one to the next as soon as it is reached."""
        for count, goal in enumerate(cycle(self.scenario.mission.plan)):
            if remaining() <= 0.0:
                self.console.print(f'{count} goals reached, one after the other')
                return
            self.client.go_to(goal, on_progress=remaining)

    def _require_moving_drives(self) -> None:
        """End the demo with the driver's own reason once the drives have stopped."""
        operation = self.client.component(str(OPERATION))
        if operation is not None and operation.status.level == DiagnosticStatus.ERROR:
            raise ManipulatorError(f'driver: {operation.status.message}')

    def _send_due_goal(self, elapsed: float) -> None:
        goal = self.scenario.mission.goal(elapsed)
        if goal != self.client.goal:
            self.client.send_goal(goal)

    def _save(self) -> Path:
        """Return the recorder's file of the run."""
        saved = self.client.call(interfaces.SAVE, Trigger.Request(), SAVE_TIMEOUT)
        if not saved.success:
            raise ManipulatorError(f'recorder: {saved.message}')
        return Path(saved.message.removeprefix('recorded in '))

    def _report(self, recording: Path, counted: dict[str, Any]) -> None:
        """Print and draw the run when the drives have stopped already; Ctrl-C ends it."""
        run = read_recording(recording, TOPICS)
        course = course_of(run, self.scenario.wall.settling_time)
        summary = {'axes': gondola.figures(course), **counted}
        with atomic_write(self.output / SUMMARY) as draft:
            draft.write_text(json.dumps(summary, indent=2) + '\n')
        self.console.print(*summary_lines(summary, self.scenario), sep='\n')
        self.console.print(f'drawing the pictures in {self.output}/')
        draw(self.output, run, course, summary, self.scenario, self.geometry,
             self._check_interrupt)
        written = (name for name in (SUMMARY, *PICTURES, recording.name)
                   if (self.output / name).exists())
        self.console.print(f'written in {self.output}/: {", ".join(written)}')

    def _stop(self) -> None:
        try:
            if rclpy.ok() and self.client.driver_state() == 'active':
                self.console.print('driver: deactivate: ramp down, power off')
                self.client.deactivate()
        except ManipulatorError as error:
            self.console.print(f'[red]{error}[/red]')  # the driver stops its drives when it ends
        finally:
            self.processes.end()
            self.client.close()


def _parameter_files(options: argparse.Namespace) -> list[Path]:
    return [options.parameters, config_path('simulation.yaml')]


def _ros_arguments(name: str, options: argparse.Namespace, scenario: Scenario) -> list[str]:
    arguments = ['--ros-args', '-r', f'__ns:=/{options.namespace}']
    if name == 'recorder':
        return [*arguments, '-p', f'folder:={options.output.resolve()}', '-p', f'duration:={KEPT}',
                '-r', f'head_on_wall:={HEAD}']
    files = _parameter_files(options)
    if name == 'manipulator':
        files.append(_write_parameters(options, scenario))
    for file in files:
        arguments += ['--params-file', str(file)]
    if name == 'gondola_simulator' and options.scenario:
        arguments += ['-p', f'scenario:={options.scenario}']
    return arguments


def _write_parameters(options: argparse.Namespace, scenario: Scenario) -> Path:
    """Write what the scenario asks of the compensator; `-p` would not beat manipulator.yaml."""
    path = options.output / 'compensator.yaml'
    values = {name: list(value) if isinstance(value, tuple) else value
              for name, value in gondola.compensator_parameters(scenario).items()}
    path.write_text(yaml.safe_dump({'/**/compensator': {'ros__parameters': values}}))
    return path


def _options(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='demo', description='Run the whole stack with simulated drives on a swaying gondola.')
    parser.add_argument('--duration', type=_duration, default=30.0, metavar='S',
                        help='how long the strokes last, in s (default 30)')
    parser.add_argument('--scenario', default='',
                        help='wind and wall: a name in config/scenarios, or a file')
    parser.add_argument('--parameters', type=Path, default=config_path('manipulator.yaml'),
                        metavar='YAML', help='parameters of the nodes, such as a calibrated copy')
    parser.add_argument('--output', type=Path, default=Path('demo_report'), metavar='DIR',
                        help='folder of the report (default demo_report)')
    parser.add_argument('--namespace', default='demo', help='namespace of the nodes')
    return parser.parse_args(args)


def _duration(text: str) -> float:
    value = float(text)
    if not 1.0 <= value <= 86400.0:
        raise argparse.ArgumentTypeError(f'{text} s is not between 1 s and 86400 s')
    return value


def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit status."""
    options = _options(args)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return exit_status('demo', lambda: _make(options.output), USAGE_ERROR) or exit_status(
        'demo', lambda: _run(options), interrupted='interrupted: drives stopped, nodes ended')


def _make(folder: Path) -> None:
    with file_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)


def _run(options: argparse.Namespace) -> None:
    interrupted = Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: interrupted.set())
    # rclpy's own handlers would end ROS before the drives are stopped through it
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        Demo(options, Console(highlight=False, soft_wrap=True), interrupted).run()
    finally:
        rclpy.try_shutdown()


if __name__ == '__main__':
    raise SystemExit(main())
