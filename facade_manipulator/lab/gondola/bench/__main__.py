"""
Bench of the compensation: every scenario in a closed loop, beside plain and ideal predictions.

Run it by ``python -m facade_manipulator.lab.gondola.bench``. It prints tables and writes
compensation.json, a picture of what each prediction leaves and one of the force that a gondola can
press with; ``make demo`` draws a scenario.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
import json
import math
from pathlib import Path
import sys
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.lab.gondola.bench import comparison, plain
from facade_manipulator.lab.gondola.bench.pictures import draw_forces
from facade_manipulator.lab.gondola.closed_loop import ClosedLoop, LoopStep
from facade_manipulator.lab.gondola.course import between, giving_way
from facade_manipulator.lab.gondola.facade import Facade
from facade_manipulator.lab.gondola.motion import Motion, Sway, SwaySettings
from facade_manipulator.lab.gondola.oracle import limits
from facade_manipulator.lab.gondola.pictures import TITLES
from facade_manipulator.lab.gondola.scenario import load_scenario, Scenario, scenario_names
from facade_manipulator.lab.gondola.wall import AXES, SCALES
from facade_manipulator.prediction import DisturbancePredictor

CONTACT_BEGINS = 20.0  # s: approach and ramp are over
SWEEP = (0.05, 0.08, 0.12, 0.2, 0.3, 0.5, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
SWEEP_AMPLITUDE = Pose(0.01, 0.01, math.radians(1.0))
SWEEP_DURATION = 30.0
PLAIN = {'acceleration': plain.AccelerationPrediction, 'held': plain.HeldPrediction}


class Run(NamedTuple):
    """One run: the loop after it, every cycle, and what was expected one horizon ahead."""

    loop: ClosedLoop
    steps: list[LoopStep]
    expected: dict[float, tuple[float, ...]]  #: pose and its deviations, by the time of both

    def within(self) -> list[float]:
        """Return the share of the prediction's errors within two of its standard deviations."""
        times, expected = np.array(list(self.expected)), np.array(list(self.expected.values()))
        came = [step.sample.time for step in self.steps]
        settled = np.interp(times, came, [step.sample.settled for step in self.steps]) == 1.0
        errors = expected[:, :3] - between(
            times, [(step.sample.time, *step.sample.rail) for step in self.steps])
        return (np.abs(errors) < 2.0 * expected[:, 3:])[settled].mean(axis=0).tolist()


def run_scenario(
    scenario: Scenario, motion: Motion | None = None, predictor: Any = None
) -> Run:
    """Run a scenario in a closed loop, without a clock, by its own predictor or another."""
    loop = ClosedLoop(Geometry(), scenario, motion or scenario.motion())
    if predictor is not None:
        loop.compensator.correction.predictor = predictor
    run, own = Run(loop, [], {}), loop.compensator.correction.predictor
    for step in loop.mission(scenario.mission.duration):
        run.steps.append(step)
        if isinstance(own, DisturbancePredictor) and own.stamp > -math.inf:
            time = own.stamp + plain.HORIZON
            run.expected[time] = (*own.predict(time).position, *own.deviations(time))
    return run


def run_predictions(scenario: Scenario) -> dict[str, Run]:
    """Run a scenario by the prediction, by plainer ones and by the best there are."""
    motion = scenario.motion()
    others = {name: make() for name, make in PLAIN.items()} | limits(scenario, motion)
    return {name: run_scenario(scenario, motion, predictor)
            for name, predictor in ({comparison.LEARNT: None} | others).items()}


def evaluate(scenario: Scenario, seeds: int = 1) -> dict[str, Any]:
    """
    Return what the report says of a scenario, over seeds; of force and rejections the first run.

    ``rms`` is what is left of the disturbance by prediction and axis [m, m, rad]; an axis along
    which the head presses has none.
    """
    first = scenario.wind.seed
    trials = [run_predictions(scenario.with_seed(first + number)) for number in range(seeds)]
    run, pressed = trials[0][comparison.LEARNT], giving_way(scenario)
    free = [axis not in pressed for axis in AXES]
    reports = {name: [runs[name].loop.wall.report()['axes'] for runs in trials]
               for name in trials[0]}
    rms = {comparison.WITHOUT_ANY: _together(reports[comparison.LEARNT], 'disturbance_rms', free)}
    rms |= {name: _together(axes, 'residual_rms', free) for name, axes in reports.items()}
    return {
        'rms': rms, 'within_two_deviations': np.mean(
            [runs[comparison.LEARNT].within() for runs in trials], axis=0).tolist(),
        'contact_force': _contact(scenario, run.steps),
        'rejections': len(run.loop.rejections), 'brakes': run.loop.follower.brakes,
    }


def _together(
    reports: list[dict[str, Any]], name: str, free: Iterable[bool]
) -> list[float | None]:
    """Return the root mean squares of several reports along the axes that are free."""
    return [
        math.sqrt(sum(report[axis][name] ** 2 for report in reports) / len(reports))
        if counts else None for axis, counts in zip(AXES, free, strict=True)]


def ratios_at(frequency: float) -> dict[str, Any]:
    """Return the ratio of residual and disturbance of each axis at a frequency [Hz]."""
    sines = {}
    for name, amplitude, phase in zip(
            ('x', 'y', 'yaw'), SWEEP_AMPLITUDE, (0.0, 1.0, 2.0), strict=True):
        sines.update({f'{name}_amplitude': (amplitude,), f'{name}_frequency': (frequency,),
                      f'{name}_phase': (phase,)})
    base = Scenario()
    mission = replace(base.mission, duration=SWEEP_DURATION, goals=(0.0, 0.25, 0.0))
    wall = replace(base.wall, settling_time=10.0)
    run = run_scenario(
        base._replace(mission=mission, wall=wall), Sway(SwaySettings(**sines)).at)
    ratios = {axis: report['residual_rms'] / report['disturbance_rms']
              for axis, report in run.loop.wall.report()['axes'].items()}
    return {'frequency_hz': frequency, 'ratio': max(ratios.values()), **ratios}


def _contact(scenario: Scenario, steps: list[LoopStep]) -> dict[str, Any] | None:
    """Return the force on the wall and what it does to the gondola, from the first touch on."""
    if not scenario.facade.present:
        return None
    desired = scenario.compensator.impedance.force
    pressing = np.array([
        step.sample.time >= steps[0].sample.time + CONTACT_BEGINS for step in steps])
    every = np.array([Facade.force_on_wall(step.sample.head, step.wrench) for step in steps])
    forces, rails = every[pressing], np.array([step.sample.rail for step in steps])[pressing]
    error = math.sqrt(((forces - desired) ** 2).mean())
    return {'desired': desired, 'mean': float(forces.mean()), 'rms_error': error,
            'rms_error_ratio': error / desired, 'least': float(forces.min()),
            'most': float(forces.max()), 'most_ever': float(every.max()),
            'share_off_the_wall': float((forces <= 0.0).mean()),
            'push_back_mm': float(-1e3 * rails[:, 1].mean()),
            'most_yaw_deg': math.degrees(abs(rails[:, 2]).max())}


def table(results: dict[str, Any]) -> Iterator[str]:
    """Yield the lines that a person reads."""
    yield f'Left of the disturbance in %, {" / ".join(AXES)}, RMS; errors within two deviations'
    yield from comparison.comparison(results['scenarios'], SCALES, in_percent=True)
    for name, result in results['scenarios'].items():
        force = result['contact_force']
        if force:
            yield (f'{name:26}force  {force["desired"]:9.1f} N {force["rms_error"]:8.2f} N'
                   f'{100 * force["rms_error_ratio"]:7.2f}%  {force["least"]:.1f} to '
                   f'{force["most"]:.1f} N, off the wall '
                   f'{100 * force["share_off_the_wall"]:.2g} %')
            yield (f'{name:26}gondola  pushed back {force["push_back_mm"]:.1f} mm, yaw '
                   f'{force["most_yaw_deg"]:.2f}° at most')
    yield 'sweep: ' + '  '.join(
        f'{item["frequency_hz"]:g} Hz {100 * item["ratio"]:.0f}%' for item in results['sweep'])


def main(args: list[str] | None = None) -> int:
    """Run the bench; return the exit status."""
    parser = argparse.ArgumentParser(prog='bench', description=__doc__.splitlines()[1])
    parser.add_argument('--scenario', action='append', help='a name or a file; all without it')
    parser.add_argument('--seeds', type=int, default=1, help='of gusts and noise, together')
    parser.add_argument('--before', type=Path, help='a compensation.json to be put beside')
    parser.add_argument('--output', type=Path, default=Path('bench_report'),
                        help='folder of the report')
    options = parser.parse_args(args)
    try:
        scenarios = {
            name: load_scenario(name) for name in options.scenario or scenario_names()}
        output = options.output
        output.mkdir(parents=True, exist_ok=True)
        results: dict[str, Any] = {'scenarios': {
            name: evaluate(scenario, options.seeds) for name, scenario in scenarios.items()},
            'sweep': [ratios_at(frequency) for frequency in SWEEP]}
        if options.before:
            comparison.put_beside(results['scenarios'], json.loads(
                options.before.read_text())['scenarios'])
    except (ManipulatorError, OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    draw_forces(output / 'forces.png')
    comparison.draw_comparison(output / 'predictions.png', results['scenarios'], SCALES, TITLES,
                    'Error of the head on the wall by prediction (RMS)')
    (output / 'compensation.json').write_text(json.dumps(results, indent=2) + '\n')
    print(*table(results), sep='\n')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
