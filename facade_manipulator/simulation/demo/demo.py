"""
The whole stack on one computer: real nodes, simulated drives, a gondola that sways.

The demo is a supervisor as a cleaning robot has one. It configures, homes and activates the
drives through the nodes' services and sends cleaning strokes. It stops the drives first when it
ends, however it ends, and then reports the run.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
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

from facade_manipulator.client import ManipulatorClient, NoAnswerError
from facade_manipulator.commands import above_zero, exit_status
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes.messages import status_level, status_values
from facade_manipulator.nodes.run import initialise, STOP_SIGNALS
from facade_manipulator.parameters import read_parameters, settings_from
from facade_manipulator.resources import config_path
from facade_manipulator.simulation.demo.recording import Recorder, Run, run_of
from facade_manipulator.simulation.gondola_simulator import require_display
from facade_manipulator.simulation.world.scenario import load_scenario

NAMESPACE = 'demo'
OPERATION, CORRECTION, BUS = 'driver: operation', 'compensator: correction', 'driver: bus'
COUNTERS = {  # of the summary: component and key on /diagnostics
    'bus_cycles': (BUS, 'cycles'), 'missed_cycles': (BUS, 'missed cycles'),
    'late_cycles': (BUS, 'late commands'), 'drive_faults': (OPERATION, 'drive faults'),
    'rejected_goals': ('ik_service: goal', 'rejected')}
MODULES = 'simulation.gondola_simulator', 'nodes.driver', 'nodes.manipulator'
ESTIMATOR = 'nodes.disturbance_estimator'  # only with raw sensors
# a node ends with the demo, even if that is killed: 1 is PR_SET_PDEATHSIG
START = ('import ctypes, signal; ctypes.CDLL(None).prctl(1, signal.SIGTERM); '
         'from facade_manipulator.{} import main; raise SystemExit(main())')
PATIENCE = {signal.SIGINT: 5.0, signal.SIGKILL: 3.0}  # s
PARAMETER_FILES = config_path('manipulator.yaml'), config_path('simulation.yaml')
SUMMARY, PARAMETERS, FORCE = 'summary.json', 'scenario.yaml', 'force.png'
PICTURES = (  # named after the functions of `pictures`
    'time_courses.png', 'spectrum.png', 'path.png', 'before_after.png', FORCE, 'linkage.gif')
ESTIMATE_TIMEOUT = 15.0  # s; the estimator of raw sensors needs 7 s to start
LINE_PERIOD, TURN = 1.0, 0.1  # s, between two lines and between two looks at the goal
LINE_SAMPLES = 200  # at 100 Hz; the line counts the second half, the last second
LAST_COUNTERS = 1.2  # s: each node publishes its counters once a second
BUSY_SHARE = 0.005  # of late or missed cycles: the computer was too busy
SHORTEST = 10.0  # s; the correction of a shorter run has not learnt
FIGURES = 'disturbance_rms', 'residual_rms', 'attenuation_db'
say = partial(print, flush=True)


class Demo:
    """One run: nodes up, strokes for a while, drives off, report."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options, self.output = options, Path(options.output)
        self.scenario = load_scenario(options.scenario)
        self.duration: float = options.duration or self.scenario.mission.duration
        self.geometry = settings_from(
            Geometry, read_parameters(PARAMETER_FILES, 'driver'), 'geometry')
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
            run, counters = self._run(), self._counters()  # without the messages of the stop
        except KeyboardInterrupt:
            say('interrupted: stopping')
            raise
        finally:
            _handle_signals(signal.SIG_IGN)  # nothing interrupts the stopping of the drives
            self._stop()
        _handle_signals(_interrupt)
        self._report(run, counters)

    def _start_nodes(self) -> None:
        for name in (SUMMARY, *PICTURES, f'{ESTIMATOR.split(".")[1]}.log'):
            (self.output / name).unlink(missing_ok=True)  # those of an earlier run would mislead
        mission = self.scenario.mission
        say(self.scenario.description)
        if self.duration < mission.shown_after:
            say(f'{self.duration:g} s are too short to show {mission.shows}; '
                f'next: set a duration of {mission.shown_after:g} s or more')
        parameters = self.output / PARAMETERS
        parameters.write_text(yaml.safe_dump({  # `-p` would not overrule manipulator.yaml
            f'/**/{node}': {'ros__parameters': values} for node, values in {
                'compensator': self.scenario.compensator,
                'gondola_simulator': {
                    'scenario': self.options.scenario, 'viewer': self.options.viewer},
            }.items()}))
        arguments = ['--ros-args', '-r', f'__ns:=/{NAMESPACE}']
        for file in (*PARAMETER_FILES, parameters):
            arguments += ['--params-file', str(file)]
        say(f'starting the nodes (logs in {self.output}/); Ctrl-C stops the drives first')
        for module in (*MODULES, *([ESTIMATOR] if self.scenario.raw_sensors else [])):
            name = module.split('.')[1]
            with signals_deferred():
                self.processes[name] = start_node(module, arguments, self.output / f'{name}.log')

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
        if now < self._next_line:
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
            cycles, figures = cycles_text(self._counters()), 'error not measured yet'
            if status_level(operation) == 'error':
                raise ManipulatorError(f'driver: {operation.message}; {cycles}')
            with suppress(ManipulatorError):
                figures = ', '.join(self._run(LINE_SAMPLES).figures())
            say(f'{now - self._begin:5.1f} s of {self.duration:g} s | {operation.message}, '
                f'{correction.message} | RMS of 1 s: {figures} | {cycles}')

    def _run(self, *count: int) -> Run:
        return run_of(self.recorder.latest(*count), self.scenario, self.geometry)

    def _component(self, name: str) -> DiagnosticStatus:
        return self.recorder.components.get(f'{NAMESPACE}/{name}', DiagnosticStatus())

    def _counters(self) -> dict[str, int]:
        return {name: int(status_values(self._component(component)).get(key, 0))
                for name, (component, key) in COUNTERS.items()}

    def _stop(self) -> None:
        self._next_line = math.inf
        try:
            # no driver answers before its node has started
            if self._component(OPERATION).message and self.client.driver_state() == 'active':
                say('driver: deactivate: ramp down, power off')
                self.client.deactivate()
        except ManipulatorError as error:
            say(error)  # the driver stops its drives when it ends
        self.client.close()
        end_processes(list(self.processes.values()))

    def _report(self, run: Run, counters: dict[str, int]) -> None:
        """Print and draw the run; raise a ManipulatorError where it is below its bound."""
        axes = {axis: dict(zip(FIGURES, figures, strict=True)) for axis, figures in zip(
            Pose._fields, run.attenuation().T.tolist(), strict=True)}
        (self.output / SUMMARY).write_text(json.dumps(
            {'axes': axes, 'duration_s': self.duration, **counters}, indent=2) + '\n')
        say('RMS error on the wall without → with compensation (attenuation)', *run.figures(),
            cycles_text(counters), sep='\n')
        say(f'drawing the pictures in {self.output}/')
        # matplotlib is imported here, so that the nodes' start does not wait for it
        from facade_manipulator.simulation.demo import pictures

        with TemporaryDirectory(dir=self.output, prefix='.drafts_') as drafts:
            for draft in (Path(drafts) / name for name in PICTURES):
                if draft.name != FORCE or len(run.forces):
                    picture = getattr(pictures, draft.stem)(run)
                    (picture.savefig if draft.suffix == '.png' else picture.save)(draft)
                    draft.replace(self.output / draft.name)
        say(f'written in {self.output}/: {SUMMARY}, pictures, animation, logs')
        if self.duration >= max(SHORTEST, self.scenario.mission.shown_after):
            require_attenuation(run, counters)


def start_node(module: str, arguments: Sequence[str], log: Path) -> subprocess.Popen[bytes]:
    """Start the node of a module of the package; it ends with this process."""
    with log.open('w') as file:
        return subprocess.Popen(
            [sys.executable, '-P', '-c', START.format(module), *arguments],
            stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT,
            process_group=0,  # Ctrl-C in the terminal reaches only the demo
            env={**os.environ, 'PYTHONUNBUFFERED': '1'})


@contextmanager
def signals_deferred() -> Iterator[None]:
    """
    Let a stop signal wait for the end of a block.

    Python ignores an exception raised in its callbacks of a fork, and a node that has started but
    is not yet in the table of processes would be left behind.
    """
    received: list[int] = []
    _handle_signals(lambda number, _: received.append(number))
    try:
        yield
    finally:
        _handle_signals(_interrupt)
    if received:
        signal.raise_signal(received[0])


def end_processes(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End processes, those that take too long by force."""
    for number, patience in PATIENCE.items():
        deadline = time.monotonic() + patience
        for process in processes:
            process.send_signal(number)  # nothing if it has ended
        for process in processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(max(deadline - time.monotonic(), 0.0))


def cycles_text(counters: dict[str, int]) -> str:
    """Return the counters as text, and whether the computer was too busy for the bus cycles."""
    text = ('{bus_cycles} bus cycles, {late_cycles} late, {missed_cycles} missed, '
            '{drive_faults} drive faults, {rejected_goals} goals rejected').format(**counters)
    is_busy = (counters['late_cycles'] + counters['missed_cycles']
               > BUSY_SHARE * counters['bus_cycles'])
    return text + '; this computer is too busy' * is_busy


def require_attenuation(run: Run, counters: dict[str, int]) -> None:
    """Raise a ManipulatorError where an axis that does not yield is below its bound."""
    bounds = run.scenario.mission.attenuation
    low = [f'{text}, bound {bound:g} dB' for i, (text, attenuation, bound) in enumerate(
        zip(run.figures(), run.attenuation()[2], bounds, strict=True))
        if attenuation < bound and not run.yields(i)]
    if low:
        raise ManipulatorError(
            f'attenuation too low: {"; ".join(low)}; {cycles_text(counters)}; '
            'next: end other programs and run it again, then read the logs of the nodes')


def _options(args: list[str] | None) -> argparse.Namespace:
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
    try:
        if options.viewer:
            require_display()
        options.output.mkdir(parents=True, exist_ok=True)
    except (ManipulatorError, OSError) as error:
        parser.error(str(error))
    return options


def main(args: list[str] | None = None) -> int:
    """Run the demo; return its exit status."""
    options = _options(args)
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return exit_status(
        'demo', lambda: _run(options), interrupted='interrupted: drives stopped, nodes ended')


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
