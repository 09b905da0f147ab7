"""
The whole stack on one machine: real nodes, simulated drives, a gondola that sways.

The demo is a supervisor as a cleaning robot has one: it configures, homes and activates the
drives through the nodes' services, sends cleaning strokes, and stops the drives first when it
ends, however it ends.
"""

from __future__ import annotations

import argparse
from functools import partial
import json
import math
import os
from pathlib import Path
import signal
from threading import Event
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
import yaml

from facade_manipulator import config_path
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.diagnostics import BUS, CORRECTION, OPERATION
from facade_manipulator.errors import exit_status, file_errors, ManipulatorError
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.demo.collector import Collector
from facade_manipulator.lab.demo.course import course_of
from facade_manipulator.lab.demo.processes import NodeProcesses
from facade_manipulator.lab.demo.report import counters, draw, PICTURES, SUMMARY, summary_lines
from facade_manipulator.lab.gondola.course import figures
from facade_manipulator.messages import millimetres, status_level
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.ros.runtime import initialise, USAGE_ERROR
from facade_manipulator.simulation.world.scenario import load_scenario, Scenario

NODES = ('gondola_simulator', 'driver', 'manipulator')
ESTIMATOR = 'disturbance_estimator'  # runs beside them where the scenario has raw sensors
COMPENSATOR_PARAMETERS = 'compensator.yaml'
FILES = (SUMMARY, *PICTURES, COMPENSATOR_PARAMETERS,
         *(f'{name}.log' for name in (*NODES, ESTIMATOR)))
ESTIMATE_TIMEOUT = 15.0  # s; the estimator of raw sensors needs 7 s to start
LINE_PERIOD = 1.0  # s
TURN = 0.1  # s, within which the next goal is sent
LAST_COUNTERS = 1.2  # s: each node publishes its counters once a second
DEFAULT_SCENARIO = 'breeze'
DEFAULT_DURATION = 30.0  # s, without a scenario
SETTLING_TIME = 2.5  # s, for which a goal must have stood before errors count
SHORTEST, LONGEST = 1.0, 86400.0  # s
say = partial(print, flush=True)


class Demo:
    """One run: nodes up, strokes for a while, drives off, report."""

    def __init__(self, options: argparse.Namespace, interrupted: Event) -> None:
        self.options = options
        self.output: Path = options.output
        self.geometry = settings_from(
            Geometry, read_parameters(_parameter_files(options), 'driver'), 'geometry')
        self.scenario = load_scenario(options.scenario or DEFAULT_SCENARIO)
        self.duration: float = options.duration or (
            self.scenario.mission.duration if options.scenario else DEFAULT_DURATION)
        self.nodes = (*NODES, ESTIMATOR) if self.scenario.raw_sensors else NODES
        self.processes = NodeProcesses(self.output)
        self.client = ManipulatorClient(options.namespace, 'demo_supervisor', self._watch)
        self.collector = Collector(self.client.node)
        self._interrupted = interrupted
        self._begin: float | None = None  # of the strokes
        self._next_line = 0.0
        self._is_activated = False
        self._is_stopping = False

    def run(self) -> None:
        """Run to the end; whatever happens the drives stop first, then the nodes end."""
        try:
            self._start_nodes()
            self._bring_up()
            self._strokes()
            lasted = self._elapsed()
            self.collector.close()
            time.sleep(LAST_COUNTERS)
            counted = counters(self.collector, lasted)
        finally:
            self._is_stopping = True  # nothing interrupts the stopping of the drives
            self._stop()
        self._report(counted)

    def _watch(self) -> None:
        """Look for Ctrl-C, for dead nodes and stopped drives; called while the client waits."""
        if self._is_stopping:
            return
        self._check_interrupt()
        if time.monotonic() < self._next_line:
            return
        self._next_line = time.monotonic() + LINE_PERIOD
        self.processes.check()
        if self._begin is not None and self._elapsed() < self.duration:
            self._require_moving_drives()
            say(self._line())

    def _pause(self, duration: float) -> None:
        self._watch()
        time.sleep(duration)

    def _check_interrupt(self) -> None:
        if self._interrupted.is_set():
            say('interrupted: stopping')
            raise KeyboardInterrupt

    def _elapsed(self) -> float:
        return 0.0 if self._begin is None else time.monotonic() - self._begin

    def _line(self) -> str:
        """Return the state of the run in one line."""
        states = [status.message for component in (OPERATION, CORRECTION)
                  if (status := self.collector.component(component)) is not None]
        error = self.collector.error()
        return ' | '.join((
            f' {self._elapsed():.1f} s of {self.duration:g} s: {", ".join(states)}',
            f'error of the head: {millimetres(error) if error else "not measured yet"}',
            f'missed cycles: {self.collector.value(BUS, "missed cycles") or 0}'))

    def _start_nodes(self) -> None:
        for name in FILES:  # those of an earlier run would mislead
            (self.output / name).unlink(missing_ok=True)
        mission = self.scenario.mission
        say(self.scenario.description)
        if self.duration < mission.shown_after:
            say(f'{self.duration:g} s are too short to show {mission.shows}; '
                f'next: set a duration of {mission.shown_after:g} s or more')
        say(f'starting {", ".join(self.nodes)} in namespace {self.options.namespace} '
            f'(logs in {self.output}/); Ctrl-C stops the drives first')
        for name in self.nodes:
            self.processes.start(name, _ros_arguments(name, self.options, self.scenario))

    def _bring_up(self) -> None:
        say('driver: configure: bus up, drives checked')
        self.client.configure()
        say('driver: home')
        self.client.home()
        say('driver: activate: power on')
        self._is_activated = True
        self.client.activate()
        say('compensator: wait for an estimate of the disturbance')
        deadline = time.monotonic() + ESTIMATE_TIMEOUT  # a scenario may have no estimates
        while not self._has_estimate() and time.monotonic() < deadline:
            self._pause(TURN)

    def _has_estimate(self) -> bool:
        status = self.collector.component(CORRECTION)
        return status is not None and status_level(status) == 'ok'

    def _strokes(self) -> None:
        self._begin, self._next_line = time.monotonic(), 0.0
        while (elapsed := self._elapsed()) < self.duration:
            if (goal := self.scenario.mission.goal(elapsed)) != self.client.goal:
                self.client.send_goal(goal)
            self._pause(min(TURN, self.duration - elapsed))

    def _require_moving_drives(self) -> None:
        """End the demo with the driver's own reason once the drives have stopped."""
        status = self.collector.component(OPERATION)
        if status is not None and status.level == DiagnosticStatus.ERROR:
            raise ManipulatorError(f'driver: {status.message}')

    def _report(self, counted: dict[str, Any]) -> None:
        """Print and draw the run when the drives have stopped already; Ctrl-C ends it."""
        course = course_of(self.collector, SETTLING_TIME)
        summary = {'axes': figures(course), **counted}
        with atomic_write(self.output / SUMMARY) as draft:
            draft.write_text(json.dumps(summary, indent=2) + '\n')
        say(*summary_lines(summary, self.scenario), sep='\n')
        say(f'drawing the pictures in {self.output}/')
        draw(self.output, self.collector, course, summary, self.scenario, self.geometry,
             self._check_interrupt)
        written = (name for name in (SUMMARY, *PICTURES) if (self.output / name).exists())
        say(f'written in {self.output}/: {", ".join(written)}')

    def _stop(self) -> None:
        try:
            if self._is_activated and rclpy.ok() and self.client.driver_state() == 'active':
                say('driver: deactivate: ramp down, power off')
                self.client.deactivate()
        except ManipulatorError as error:
            say(error)  # the driver stops its drives when it ends
        finally:
            self.processes.end()
            self.client.close()


def _parameter_files(options: argparse.Namespace) -> list[Path]:
    return [options.parameters, config_path('simulation.yaml')]


def _ros_arguments(name: str, options: argparse.Namespace, scenario: Scenario) -> list[str]:
    arguments = ['--ros-args', '-r', f'__ns:=/{options.namespace}']
    files = _parameter_files(options)
    if name == 'manipulator':
        files.append(_write_parameters(options, scenario))
    for file in files:
        arguments += ['--params-file', str(file)]
    if name == 'gondola_simulator' and options.scenario:
        arguments += ['-p', f'scenario:={options.scenario}']
    return arguments


def _write_parameters(options: argparse.Namespace, scenario: Scenario) -> Path:
    """Write the scenario's parameters of the compensator; `-p` would not beat manipulator.yaml."""
    path: Path = options.output / COMPENSATOR_PARAMETERS
    path.write_text(yaml.safe_dump(
        {'/**/compensator': {'ros__parameters': scenario.compensator}}))
    return path


def _options(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='demo', description='Run the whole stack with simulated drives on a swaying gondola.')
    parser.add_argument('--duration', type=duration, metavar='S',
                        help='how long the strokes last, in s (default: the duration of the '
                        f'scenario, {DEFAULT_DURATION:g} without one)')
    parser.add_argument('--scenario', default='',
                        help='wind and wall: a name in config/world/scenarios, or a file')
    parser.add_argument('--parameters', type=Path, default=config_path('manipulator.yaml'),
                        metavar='YAML', help='parameters of the nodes, such as a calibrated copy')
    parser.add_argument('--output', type=Path, default=Path('demo_report'), metavar='DIR',
                        help='folder of the report (default demo_report)')
    parser.add_argument('--namespace', default='demo', help='namespace of the nodes')
    return parser.parse_args(args)


def duration(text: str) -> float:
    """Return the duration [s] that a user has written; the type of an option for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not SHORTEST <= value <= LONGEST:
        raise argparse.ArgumentTypeError(
            f"'{text}' is not a number of seconds between {SHORTEST:g} and {LONGEST:g}")
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
    # rclpy's own signal handlers would end ROS before the drives are stopped through it
    initialise()
    try:
        Demo(options, interrupted).run()
    finally:
        rclpy.try_shutdown()
