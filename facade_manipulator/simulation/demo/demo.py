"""
The whole stack on one computer: real nodes, simulated drives, a gondola that sways.

The demo is a supervisor as a cleaning robot has one. It configures, homes and activates the
drives through the nodes' services and sends cleaning strokes. It stops the drives first when it
ends, however it ends, and then reports the run.
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

import rclpy
import yaml

from facade_manipulator import config_path
from facade_manipulator.client import ManipulatorClient
from facade_manipulator.errors import exit_status, file_errors, ManipulatorError
from facade_manipulator.files import atomic_write
from facade_manipulator.kinematics import Geometry
from facade_manipulator.messages import millimetres, status_level
from facade_manipulator.nodes.run import initialise, USAGE_ERROR
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.simulation.demo.processes import NodeProcesses
from facade_manipulator.simulation.demo.recording import (
    decibels,
    figures,
    Recorder,
    run_of,
    SCALES,
    UNITS,
)
from facade_manipulator.simulation.gondola_simulator import require_display
from facade_manipulator.simulation.world.scenario import load_scenario, Scenario

OPERATION, BUS = 'driver: operation', 'driver: bus'  # components on /diagnostics
GOAL, CORRECTION = 'ik_service: goal', 'compensator: correction'
NODES = ('gondola_simulator', 'driver', 'manipulator')
ESTIMATOR = 'disturbance_estimator'  # runs beside them where the scenario has raw sensors
SUMMARY, ANIMATION, PARAMETERS = 'summary.json', 'linkage.gif', 'compensator.yaml'
FILES = (SUMMARY, ANIMATION, PARAMETERS, 'time_courses.png', 'spectrum.png', 'path.png',
         'before_after.png', 'force.png', *(f'{name}.log' for name in (*NODES, ESTIMATOR)))
ESTIMATE_TIMEOUT = 15.0  # s; the estimator of raw sensors needs 7 s to start
LINE_PERIOD = 1.0  # s
TURN = 0.1  # s, within which the next goal is sent
LAST_COUNTERS = 1.2  # s: each node publishes its counters once a second
DEFAULT_SCENARIO = 'breeze'
DEFAULT_DURATION = 30.0  # s, without a scenario
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
        self.recorder = Recorder(self.client.node)
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
            self._move()
            lasted = self._elapsed()
            time.sleep(LAST_COUNTERS)
            self.recorder.close()
            counted = {'duration_s': round(lasted, 3), **{
                name: int(self.recorder.value(component, key) or 0) for name, component, key in (
                    ('bus_cycles', BUS, 'cycles'), ('missed_cycles', BUS, 'missed cycles'),
                    ('drive_faults', OPERATION, 'drive faults'),
                    ('rejected_goals', GOAL, 'rejected'))}}
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
            status = self.recorder.component(OPERATION)
            if status is not None and status_level(status) == 'error':
                raise ManipulatorError(f'driver: {status.message}')
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
                  if (status := self.recorder.component(component)) is not None]
        error = self.recorder.error()
        return ' | '.join((
            f' {self._elapsed():.1f} s of {self.duration:g} s: {", ".join(states)}',
            f'error of the head: {millimetres(error) if error else "not measured yet"}',
            f'missed cycles: {self.recorder.value(BUS, "missed cycles") or 0}'))

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
        parameters = self.output / PARAMETERS
        parameters.write_text(yaml.safe_dump(  # `-p` would not overrule manipulator.yaml
            {'/**/compensator': {'ros__parameters': self.scenario.compensator}}))
        for name in self.nodes:
            arguments = ['--ros-args', '-r', f'__ns:=/{self.options.namespace}']
            for file in (*_parameter_files(self.options), parameters):
                arguments += ['--params-file', str(file)]
            if name == 'gondola_simulator':
                arguments += ['-p', f'scenario:={self.options.scenario or DEFAULT_SCENARIO}',
                              '-p', f'viewer:={str(self.options.viewer).lower()}']
            self.processes.start(name, arguments)

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
        status = self.recorder.component(CORRECTION)
        return status is not None and status_level(status) == 'ok'

    def _move(self) -> None:
        self._begin, self._next_line = time.monotonic(), 0.0
        while (elapsed := self._elapsed()) < self.duration:
            if (goal := self.scenario.mission.goal(elapsed)) != self.client.goal:
                self.client.send_goal(goal)
            self._pause(min(TURN, self.duration - elapsed))

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

    def _report(self, counted: dict[str, Any]) -> None:
        """Print and draw the run when the drives have stopped already; Ctrl-C ends it."""
        run = run_of(self.recorder)
        summary = {'axes': figures(run), **counted}
        with atomic_write(self.output / SUMMARY) as draft:
            draft.write_text(json.dumps(summary, indent=2) + '\n')
        say(*summary_lines(summary, self.scenario), sep='\n')
        say(f'drawing the pictures in {self.output}/')
        # matplotlib comes in here, so that the nodes' start does not wait for it
        from facade_manipulator.simulation.demo.linkage import before_and_after, save_animation
        from facade_manipulator.simulation.demo.pictures import (
            force,
            paths,
            save,
            spectrum,
            time_courses,
        )

        yielding, of_linkage = yielding_axes(self.scenario), (run, self.geometry, self.scenario)
        drawings = {
            'time_courses.png': partial(time_courses, run, summary['axes'], yielding),
            'spectrum.png': partial(spectrum, run, yielding), 'path.png': partial(paths, run),
            'before_after.png': partial(before_and_after, *of_linkage)}
        if len(run.forces):
            desired = self.scenario.compensator.get('contact.force')
            drawings['force.png'] = partial(force, run, desired)
        for name, draw in drawings.items():
            self._check_interrupt()
            with atomic_write(self.output / name) as draft:
                save(draw(), draft)
        with atomic_write(self.output / ANIMATION) as draft:
            save_animation(*of_linkage, draft, self._check_interrupt)
        say(f'written in {self.output}/: {", ".join((SUMMARY, *drawings, ANIMATION))}')


def summary_lines(summary: dict[str, Any], scenario: Scenario) -> list[str]:
    """Return the figures of a run, and the axes that yield to the contact force."""
    lines = [f'{"":8}{"uncompensated":>16}{"compensated":>16}{"attenuation":>14}   (RMS)']
    for (axis, result), scale, unit in zip(summary['axes'].items(), SCALES, UNITS, strict=True):
        without, error = (f'{scale * result[key]:.3g} {unit}'
                          for key in ('disturbance_rms', 'residual_rms'))
        lines.append(
            f'{axis:8}{without:>16}{error:>16}{decibels(result["attenuation_db"]):>14}')
    return [
        *lines,
        f'{summary["bus_cycles"]} bus cycles, {summary["missed_cycles"]} missed, '
        f'{summary["drive_faults"]} drive faults, {summary["rejected_goals"]} goals rejected',
        *(f'{axis} yields to the contact force: an offset is intended'
          for axis in yielding_axes(scenario))]


def yielding_axes(scenario: Scenario) -> list[str]:
    """Return the axes that yield to the wall: the head leaves the goal along them on purpose."""
    return [axis for axis, name in (
        ('y', 'contact.enabled'), ('theta', 'contact.yaw_enabled'))
        if scenario.compensator.get(name)]


def _parameter_files(options: argparse.Namespace) -> list[Path]:
    return [options.parameters, config_path('simulation.yaml')]


def _options(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='demo', description='Run the whole stack with simulated drives on a swaying gondola.')
    parser.add_argument('--duration', type=duration, metavar='S',
                        help='how long the strokes last, in s (default: the duration of the '
                        f'scenario, {DEFAULT_DURATION:g} without one)')
    parser.add_argument('--scenario', default='',
                        help='wind and wall: a name in config/scenarios, or a file')
    parser.add_argument('--viewer', action='store_true', help="show the world in MuJoCo's viewer")
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
    return exit_status('demo', lambda: _prepare(options), USAGE_ERROR) or exit_status(
        'demo', lambda: _run(options), interrupted='interrupted: drives stopped, nodes ended')


def _prepare(options: argparse.Namespace) -> None:
    if options.viewer:
        require_display()
    with file_errors(options.output):
        options.output.mkdir(parents=True, exist_ok=True)


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


if __name__ == '__main__':
    raise SystemExit(main())
