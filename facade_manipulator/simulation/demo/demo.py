"""
The whole stack on one computer: real nodes, simulated drives, a gondola that sways.

The demo is a supervisor as a cleaning robot has one. It configures, homes and activates the
drives through the nodes' services and sends cleaning strokes. It stops the drives first when it
ends, however it ends, and then reports the run.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import suppress
from functools import partial
import json
import math
import os
from pathlib import Path
import signal
import time
from typing import Any, NoReturn

import rclpy
import yaml

from facade_manipulator import config_path
from facade_manipulator.client import ManipulatorClient, NoAnswerError
from facade_manipulator.commands import above_zero, exit_status
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.files import atomic_write, file_errors
from facade_manipulator.kinematics import Geometry
from facade_manipulator.messages import millimetres, status_level
from facade_manipulator.nodes.run import initialise, STOP_SIGNALS, USAGE_ERROR
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.simulation.demo.processes import NodeProcesses
from facade_manipulator.simulation.demo.recording import (
    decibels,
    figures,
    Recorder,
    run_of,
    SCALES,
    UNITS,
    yielding_axes,
)
from facade_manipulator.simulation.gondola_simulator import require_display
from facade_manipulator.simulation.world.scenario import load_scenario, Scenario

OPERATION, CORRECTION = 'driver: operation', 'compensator: correction'  # on /diagnostics
COUNTERS = {  # in the summary: component and key on /diagnostics
    'bus_cycles': ('driver: bus', 'cycles'),
    'missed_cycles': ('driver: bus', 'missed cycles'),
    'drive_faults': (OPERATION, 'drive faults'),
    'rejected_goals': ('ik_service: goal', 'rejected'),
}
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
say = partial(print, flush=True)


class Demo:
    """One run: nodes up, strokes for a while, drives off, report."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.output: Path = options.output
        self.parameter_files = [options.parameters, config_path('simulation.yaml')]
        self.geometry = settings_from(
            Geometry, read_parameters(self.parameter_files, 'driver'), 'geometry')
        self.scenario = load_scenario(options.scenario or DEFAULT_SCENARIO)
        self.duration: float = options.duration or (
            self.scenario.mission.duration if options.scenario else DEFAULT_DURATION)
        self.processes = NodeProcesses(self.output)
        self.client = ManipulatorClient(options.namespace, 'demo_supervisor', self._watch)
        self.recorder = Recorder(self.client.node)
        self._begin = math.inf  # of the strokes [s, monotonic]
        self._next_line = 0.0
        self._is_activated = False

    def run(self) -> None:
        """Run to the end; whatever happens the drives stop first, then the nodes end."""
        try:
            self._start_nodes()
            self._bring_up()
            self._move()
            lasted = self._elapsed()
            time.sleep(LAST_COUNTERS)
        except KeyboardInterrupt:
            say('interrupted: stopping')
            raise
        finally:
            _handle_signals(signal.SIG_IGN)  # nothing interrupts the stopping of the drives
            self.recorder.is_recording = False
            self._stop()
        _handle_signals(_interrupt)
        self._report(lasted)

    def _watch(self) -> None:
        """Look for dead nodes and stopped drives, print the line; called while the demo waits."""
        if time.monotonic() < self._next_line or not self.recorder.is_recording:
            return
        self._next_line = time.monotonic() + LINE_PERIOD
        self.processes.check()
        if self._begin <= time.monotonic() < self._begin + self.duration:
            status = self.recorder.component(OPERATION)
            if status_level(status) == 'error':
                raise ManipulatorError(f'driver: {status.message}')
            say(self._line())

    def _elapsed(self) -> float:
        return time.monotonic() - self._begin

    def _line(self) -> str:
        """Return the state of the run in one line."""
        states = [self.recorder.component(name).message for name in (OPERATION, CORRECTION)]
        error = self.recorder.error()
        return ' | '.join((
            f' {self._elapsed():.1f} s of {self.duration:g} s: {", ".join(filter(None, states))}',
            f'error of the head: {millimetres(error) if error else "not measured yet"}',
            f'missed cycles: {self.recorder.value(*COUNTERS["missed_cycles"])}'))

    def _start_nodes(self) -> None:
        for name in FILES:  # those of an earlier run would mislead
            (self.output / name).unlink(missing_ok=True)
        mission, nodes = self.scenario.mission, [*NODES]
        if self.scenario.raw_sensors:
            nodes.append(ESTIMATOR)
        say(self.scenario.description)
        if self.duration < mission.shown_after:
            say(f'{self.duration:g} s are too short to show {mission.shows}; '
                f'next: set a duration of {mission.shown_after:g} s or more')
        say(f'starting {", ".join(nodes)} in namespace {self.options.namespace} '
            f'(logs in {self.output}/); Ctrl-C stops the drives first')
        parameters = self.output / PARAMETERS
        parameters.write_text(yaml.safe_dump(  # `-p` would not overrule manipulator.yaml
            {'/**/compensator': {'ros__parameters': self.scenario.compensator}}))
        for name in nodes:
            arguments = ['--ros-args', '-r', f'__ns:=/{self.options.namespace}']
            for file in (*self.parameter_files, parameters):
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
        with suppress(NoAnswerError):  # a scenario may have no estimates
            self.client.wait_until(
                lambda: status_level(self.recorder.component(CORRECTION)) == 'ok',
                'an estimate of the disturbance', ESTIMATE_TIMEOUT)

    def _move(self) -> None:
        self._begin, self._next_line = time.monotonic(), 0.0
        while (elapsed := self._elapsed()) < self.duration:
            if (goal := self.scenario.mission.goal(elapsed)) != self.client.goal:
                self.client.send_goal(goal)
            self._watch()
            time.sleep(min(TURN, self.duration - elapsed))

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

    def _report(self, lasted: float) -> None:
        """Print and draw the run when the drives have stopped already; Ctrl-C ends it."""
        run = run_of(self.recorder, self.scenario, self.geometry)
        summary = {'axes': figures(run), 'duration_s': round(lasted, 3), **{
            name: self.recorder.value(*place) for name, place in COUNTERS.items()}}
        with atomic_write(self.output / SUMMARY) as draft:
            draft.write_text(json.dumps(summary, indent=2) + '\n')
        say(*summary_lines(summary, self.scenario), sep='\n')
        say(f'drawing the pictures in {self.output}/')
        # matplotlib comes in here, so that the nodes' start does not wait for it
        from facade_manipulator.simulation.demo import linkage, pictures

        drawings = {'time_courses.png': pictures.time_courses, 'spectrum.png': pictures.spectrum,
                    'path.png': pictures.paths, 'before_after.png': linkage.before_and_after}
        if len(run.forces):
            drawings['force.png'] = pictures.force
        for name, draw in drawings.items():
            with atomic_write(self.output / name) as draft:
                pictures.save(draw(run), draft)
        with atomic_write(self.output / ANIMATION) as draft:
            linkage.save_animation(run, draft)
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


def _options(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='demo', description='Run the whole stack with simulated drives on a swaying gondola.')
    parser.add_argument('--duration', type=above_zero, metavar='S',
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
    _handle_signals(_interrupt)
    # rclpy's own signal handlers would end ROS before the drives are stopped through it
    initialise()
    try:
        Demo(options).run()
    finally:
        rclpy.try_shutdown()


def _handle_signals(action: Callable[..., Any] | signal.Handlers) -> None:
    for number in STOP_SIGNALS:
        signal.signal(number, action)


def _interrupt(*_: object) -> NoReturn:
    """Raise a KeyboardInterrupt, once."""
    _handle_signals(signal.SIG_IGN)
    raise KeyboardInterrupt


if __name__ == '__main__':
    raise SystemExit(main())
