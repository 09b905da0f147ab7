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
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any, NoReturn

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
import yaml

from facade_manipulator import config_path
from facade_manipulator.client import ManipulatorClient, NoAnswerError
from facade_manipulator.commands import above_zero, exit_status
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.files import file_errors
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.messages import status_level, status_values
from facade_manipulator.nodes.run import initialise, STOP_SIGNALS, USAGE_ERROR
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.simulation.demo.recording import Recorder, Run, run_of, SCALES, UNITS
from facade_manipulator.simulation.gondola_simulator import require_display
from facade_manipulator.simulation.world.scenario import load_scenario

NAMESPACE = 'demo'
OPERATION, CORRECTION, BUS = 'driver: operation', 'compensator: correction', 'driver: bus'
COUNTERS = {  # of the summary: component and key on /diagnostics
    'bus_cycles': (BUS, 'cycles'), 'missed_cycles': (BUS, 'missed cycles'),
    'late_cycles': (BUS, 'late commands'), 'drive_faults': (OPERATION, 'drive faults'),
    'rejected_goals': ('ik_service: goal', 'rejected')}
NODES, ESTIMATOR = ('gondola_simulator', 'driver', 'manipulator'), 'disturbance_estimator'
# a node ends with the demo, even if that is killed: 1 is PR_SET_PDEATHSIG
START = ('import ctypes, signal; ctypes.CDLL(None).prctl(1, signal.SIGTERM); '
         'from facade_manipulator.{} import main; raise SystemExit(main())')
PATIENCE = {signal.SIGINT: 5.0, signal.SIGTERM: 3.0, signal.SIGKILL: 3.0}  # s
SUMMARY, PARAMETERS = 'summary.json', 'compensator.yaml'
PICTURES = {  # functions of `pictures`
    'time_courses.png': 'time_courses', 'spectrum.png': 'spectrum', 'path.png': 'path',
    'before_after.png': 'before_and_after', 'force.png': 'force', 'linkage.gif': 'animation'}
ESTIMATE_TIMEOUT = 15.0  # s; the estimator of raw sensors needs 7 s to start
LINE_PERIOD, TURN = 1.0, 0.1  # s, between two lines and between two looks at the goal
LAST_COUNTERS = 1.2  # s: each node publishes its counters once a second
DEFAULT_SCENARIO, DEFAULT_DURATION = 'breeze', 30.0  # s, without a scenario
BUSY_SHARE = 0.005  # of late or missed cycles: the computer was too busy
SHORTEST = 10.0  # s; the correction of a shorter run has not learnt
FIGURES = 'disturbance_rms', 'residual_rms', 'attenuation_db'
say = partial(print, flush=True)


class Demo:
    """One run: nodes up, strokes for a while, drives off, report."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self.output = options, Path(options.output)
        self.parameter_files = [options.parameters, config_path('simulation.yaml')]
        self.scenario = load_scenario(options.scenario or DEFAULT_SCENARIO)
        self.duration: float = options.duration or (
            self.scenario.mission.duration if options.scenario else DEFAULT_DURATION)
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.client = ManipulatorClient(NAMESPACE, 'demo_supervisor', self._watch)
        self.recorder = Recorder(self.client.node)
        self._begin, self._next_line = math.inf, 0.0  # of strokes and line [s, monotonic]

    def run(self) -> None:
        """Run to the end; whatever happens the drives stop first, then the nodes end."""
        try:
            self._start_nodes()
            self._bring_up()
            self._move()
            time.sleep(LAST_COUNTERS)
        except KeyboardInterrupt:
            say('interrupted: stopping')
            raise
        finally:
            _handle_signals(signal.SIG_IGN)  # nothing interrupts the stopping of the drives
            self.recorder.is_recording = False
            self._stop()
        _handle_signals(_interrupt)
        self._report()

    def _start_nodes(self) -> None:
        nodes = [*NODES, ESTIMATOR] if self.scenario.raw_sensors else NODES
        for name in (SUMMARY, *PICTURES, *(f'{node}.log' for node in (*NODES, ESTIMATOR))):
            (self.output / name).unlink(missing_ok=True)  # those of an earlier run would mislead
        say(self.scenario.description)
        mission = self.scenario.mission
        if self.duration < mission.shown_after:
            say(f'{self.duration:g} s are too short to show {mission.shows}; '
                f'next: set a duration of {mission.shown_after:g} s or more')
        say(f'starting {", ".join(nodes)} (logs in {self.output}/); Ctrl-C stops the drives first')
        parameters = self.output / PARAMETERS
        parameters.write_text(yaml.safe_dump(  # `-p` would not overrule manipulator.yaml
            {'/**/compensator': {'ros__parameters': self.scenario.compensator}}))
        arguments = ['--ros-args', '-r', f'__ns:=/{NAMESPACE}']
        for file in (*self.parameter_files, parameters):
            arguments += ['--params-file', str(file)]
        simulated = ['-p', f'scenario:={self.options.scenario or DEFAULT_SCENARIO}',
                     '-p', f'viewer:={str(self.options.viewer).lower()}']
        for name in nodes:
            folder, own = ('nodes', []) if name != 'gondola_simulator' else (
                'simulation', simulated)
            with (self.output / f'{name}.log').open('w') as log:
                self.processes[name] = subprocess.Popen(
                    [sys.executable, '-P', '-c', START.format(f'{folder}.{name}'),
                     *arguments, *own],
                    stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
                    process_group=0,  # Ctrl-C in the terminal reaches only the demo
                    env={**os.environ, 'PYTHONUNBUFFERED': '1'})

    def _bring_up(self) -> None:
        say('driver: configure: bus up, drives checked')
        self.client.configure()
        say('driver: home')
        self.client.home()
        say('driver: activate: power on')
        self.client.activate()
        say('compensator: wait for an estimate of the disturbance')
        with suppress(NoAnswerError):  # a scenario may have no estimates
            self.client.wait_until(
                lambda: status_level(self._component(CORRECTION)) == 'ok',
                'an estimate of the disturbance', ESTIMATE_TIMEOUT)

    def _move(self) -> None:
        self._begin, self._next_line = time.monotonic(), 0.0
        while (elapsed := time.monotonic() - self._begin) < self.duration:
            if (goal := self.scenario.mission.goal(elapsed)) != self.client.goal:
                self.client.send_goal(goal)
            self._watch()
            time.sleep(min(TURN, self.duration - elapsed))

    def _watch(self) -> None:
        """Look for dead nodes and stopped drives, print the line; called while the demo waits."""
        now = time.monotonic()
        if now < self._next_line or not self.recorder.is_recording:
            return
        self._next_line = now + LINE_PERIOD
        for name, process in self.processes.items():
            if process.poll() is not None:
                log = self.output / f'{name}.log'
                last = (['no output'] + log.read_text('utf-8', 'replace').split('\n'))[-2]
                raise ManipulatorError(
                    f'{name} ended with exit status {process.returncode}: {last} (see {log})')
        if self._begin <= now:
            operation, correction = map(self._component, (OPERATION, CORRECTION))
            counters = self._counters()
            if status_level(operation) == 'error':
                raise ManipulatorError(
                    '; '.join(filter(None, (f'driver: {operation.message}', busy(counters)))))
            say(f'{now - self._begin:5.1f} s of {self.duration:g} s | {operation.message}, '
                f'{correction.message} | {self.recorder.error()} | '
                f'{counters["late_cycles"]} cycles late, {counters["missed_cycles"]} missed')

    def _component(self, name: str) -> DiagnosticStatus:
        return self.recorder.components.get(f'{NAMESPACE}/{name}', DiagnosticStatus())

    def _counters(self) -> dict[str, int]:
        return {name: int(status_values(self._component(component)).get(key, 0))
                for name, (component, key) in COUNTERS.items()}

    def _stop(self) -> None:
        try:
            # no driver answers before its node has started
            if self._component(OPERATION).message and self.client.driver_state() == 'active':
                say('driver: deactivate: ramp down, power off')
                self.client.deactivate()
        except ManipulatorError as error:
            say(error)  # the driver stops its drives when it ends
        self.client.close()
        for sign, patience in PATIENCE.items():
            deadline = time.monotonic() + patience
            running = [one for one in self.processes.values() if one.poll() is None]
            for process in running:
                process.send_signal(sign)
            for process in running:
                with suppress(subprocess.TimeoutExpired):
                    process.wait(max(deadline - time.monotonic(), 0.0))

    def _report(self) -> None:
        """Print and draw the run; raise a ManipulatorError where it is below its bound."""
        geometry = settings_from(
            Geometry, read_parameters(self.parameter_files, 'driver'), 'geometry')
        run, counters = run_of(self.recorder.rows, self.scenario, geometry), self._counters()
        axes = {axis: dict(zip(FIGURES, figures, strict=True)) for axis, figures in zip(
            Pose._fields, run.attenuation().T.tolist(), strict=True)}
        (self.output / SUMMARY).write_text(json.dumps(
            {'axes': axes, 'duration_s': self.duration, **counters}, indent=2) + '\n')
        say(*summary_lines(run, counters), sep='\n')
        say(f'drawing the pictures in {self.output}/')
        # matplotlib is imported here, so that the nodes' start does not wait for it
        from facade_manipulator.simulation.demo import pictures

        with TemporaryDirectory(dir=self.output, prefix='.drafts_') as drafts:
            for name, function in PICTURES.items():
                if name != 'force.png' or len(run.forces):
                    draft, picture = Path(drafts) / name, getattr(pictures, function)(run)
                    (picture.savefig if name.endswith('.png') else picture.save)(draft)
                    draft.replace(self.output / name)
        say(f'written in {self.output}/: {SUMMARY}, pictures, animation, logs')
        if self.duration >= max(SHORTEST, self.scenario.mission.shown_after):
            require_attenuation(run, counters)


def summary_lines(run: Run, counters: dict[str, int]) -> list[str]:
    """Return the figures of a run, and the axes that yield to the contact force."""
    lines = [f'{"":8}{"uncompensated":>16}{"compensated":>16}{"attenuation":>14}   (RMS)']
    for axis, (without, error, attenuation), scale, unit in zip(
            Pose._fields, run.attenuation().T, SCALES, UNITS, strict=True):
        lines.append(f'{axis:8}{scale * without:>13.3g} {unit:2}{scale * error:>13.3g} {unit:2}'
                     f'{attenuation:>11.3g} dB')
    return [*lines, '{bus_cycles} bus cycles, {late_cycles} late, {missed_cycles} missed, '
            '{drive_faults} drive faults, {rejected_goals} goals rejected'.format(**counters),
            *(f'{axis} yields to the contact force: an offset is intended'
              for i, axis in enumerate(Pose._fields) if run.yields(i)),
            *filter(None, [busy(counters)])]


def busy(counters: dict[str, int]) -> str:
    """Return whether the computer was too busy for the bus cycles, else ``''``."""
    late, missed, cycles = (counters[f'{name}_cycles'] for name in ('late', 'missed', 'bus'))
    return '' if late + missed <= BUSY_SHARE * cycles else (
        f'this computer was too busy: of {cycles} bus cycles {late} were late and {missed} '
        'missed an answer; next: end other programs, then run the demo again')


def require_attenuation(run: Run, counters: dict[str, int]) -> None:
    """Raise a ManipulatorError where an axis that does not yield is below its bound."""
    bounds = run.scenario.mission.attenuation
    low = [f'{axis} {attenuation:.3g} dB, bound {bound:g} dB' for i, (axis, attenuation, bound)
           in enumerate(zip(Pose._fields, run.attenuation()[2], bounds, strict=True))
           if attenuation < bound and not run.yields(i)]
    if low:
        raise ManipulatorError(
            f'attenuation too low: {"; ".join(low)}; '
            + (busy(counters) or 'next: read the logs of the nodes'))


def _options(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog='demo', description='Run the whole stack with simulated drives on a swaying gondola.')
    add = parser.add_argument
    add('--duration', type=above_zero, metavar='S', help='duration of the strokes [s] (default: '
        f'that of the scenario, {DEFAULT_DURATION:g} without one)')
    add('--scenario', default='', help='wind and wall: a name in config/scenarios, or a file')
    add('--viewer', action='store_true', help="show the world in MuJoCo's viewer")
    add('--parameters', type=Path, default=config_path('manipulator.yaml'), metavar='YAML',
        help='parameters of the nodes, such as a calibrated copy')
    add('--output', type=Path, default=Path('demo_report'), metavar='DIR',
        help='folder of the report (default demo_report)')
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
