"""
Bench of the compensation: every scenario in a closed loop, beside plain and ideal predictions.

Run it by ``python -m facade_manipulator.simulation.bench.__main__``. It prints a table and writes
compensation.json, a picture of each scenario, one of the sweep and one of the force that
a gondola can press with.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
import json
import math
from pathlib import Path
import sys
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.simulation.bench.pictures import (
    draw_forces,
    draw_models,
    draw_scenario,
    draw_sweep,
)
from facade_manipulator.simulation.bench.plain import AccelerationPrediction, HeldPrediction
from facade_manipulator.simulation.closed_loop import ClosedLoop, LoopSettings, LoopStep
from facade_manipulator.simulation.facade import Facade
from facade_manipulator.simulation.oracle import law, OraclePrediction
from facade_manipulator.simulation.scenario import (
    load_scenario,
    Motion,
    Scenario,
    scenario_names,
)
from facade_manipulator.simulation.sway import Sway, SwaySettings
from facade_manipulator.simulation.wall import AXES, SCALES, UNITS

HEAD_START = 1.0
CONTACT_BEGINS = 20.0  # s: approach and ramp are over
CLEARANCE = 0.02  # m, from the wall at the start
SWEEP = (0.05, 0.08, 0.12, 0.2, 0.3, 0.5, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
SWEEP_AMPLITUDE = Pose(0.01, 0.01, math.radians(1.0))
SWEEP_DURATION = 30.0
PLAIN = {
    'ratio_constant_acceleration': AccelerationPrediction,
    'ratio_without_prediction': HeldPrediction,
}
ORACLE = 'ratio_oracle'  # where the law of the disturbance is known


class Run(NamedTuple):
    """One run: the loop after it, and every cycle."""

    loop: ClosedLoop
    steps: list[LoopStep]


def run_scenario(
    scenario: Scenario, motion: Motion | None = None,
    predictor: OraclePrediction | HeldPrediction | None = None,
    geometry: Geometry | None = None, made: Geometry | None = None,
) -> Run:
    """
    Run a scenario in a closed loop, without a clock, by its own predictor or another.

    The machine is what the geometry says, or another that was made.
    """
    mission = scenario.mission
    settings = LoopSettings(
        scenario.compensator, scenario.estimator, scenario.wall, scenario.facade,
        scenario.gondola, scenario.force_sensor)
    loop = ClosedLoop(geometry or Geometry(), settings, motion or scenario.motion(),
                      _begin(scenario), made)
    if predictor is not None:
        loop.compensator.correction.predictor = predictor
    steps = loop.run(HEAD_START)
    for number in range(math.ceil(mission.duration / mission.goal_period)):
        loop.send_goal(mission.goal(number * mission.goal_period))
        steps += loop.run(mission.goal_period)
    return Run(loop, steps)


def _begin(scenario: Scenario) -> Pose:
    """Return where the head begins: at the first goal, but off the wall if there is one."""
    goal, wall = scenario.mission.goal(0.0), scenario.facade
    if not wall.present:
        return goal
    return goal._replace(y=min(goal.y, wall.distance - CLEARANCE))


def with_seed(scenario: Scenario, seed: int) -> Scenario:
    """Return the scenario with another seed of gusts, estimates and forces."""
    return scenario._replace(
        wind=replace(scenario.wind, seed=seed), estimator=replace(scenario.estimator, seed=seed),
        force_sensor=replace(scenario.force_sensor, seed=seed))


def run_models(scenario: Scenario) -> dict[str, Run]:
    """Run a scenario by the prediction, by plainer ones and by the best there is."""
    motion, known = scenario.motion(), law(scenario)
    runs = {'ratio': run_scenario(scenario, motion)}
    for name, plain in PLAIN.items():
        runs[name] = run_scenario(scenario, motion, plain())
    if known is not None:
        estimator = scenario.estimator
        runs[ORACLE] = run_scenario(scenario, motion, OraclePrediction(
            known, 1.0 / estimator.rate, estimator.variances()))
    return runs


def evaluate(scenario: Scenario, seeds: int = 1) -> tuple[dict, Run]:
    """Return what the report says of a scenario, over seeds, and the first run it is about."""
    first = scenario.wind.seed
    trials = [run_models(with_seed(scenario, first + number)) for number in range(seeds)]
    best = trials[0]['ratio']
    reports = {
        name: _together([runs[name].loop.wall.report()['axes'] for runs in trials])
        for name in trials[0]}
    pressing = dict(zip(AXES, (False, *(
        part.enabled for part in (
            scenario.compensator.impedance, scenario.compensator.yaw_impedance))), strict=True))
    result = {
        axis: None if pressing[axis] else _axis(axis, reports) for axis in AXES}
    return {
        **result, 'contact_force': _contact(scenario, best.steps),
        'max_step': largest_step(best.steps), 'rejections': len(best.loop.rejections),
        'brakes': best.loop.follower.brakes,
    }, best


def largest_step(steps: list[LoopStep]) -> dict[str, float]:
    """Return the most by which the head on the wall leaves its velocity in one cycle."""
    heads = np.array([step.sample.head for step in steps])
    most = abs(np.diff(heads, 2, axis=0)).max(axis=0) * SCALES
    return dict(zip(('x_mm', 'y_mm', 'theta_deg'), most.tolist(), strict=True))


def sweep() -> list[dict]:
    """Return the ratio of residual and disturbance of each axis over the frequency."""
    return [_sweep_at(frequency) for frequency in SWEEP]


def _sweep_at(frequency: float) -> dict:
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
    report = run.loop.wall.report()['axes']
    ratios = {axis: _ratio(report[axis]) for axis in AXES}
    return {'frequency_hz': frequency, 'ratio': max(ratios.values()), **ratios}


def _together(reports: list[dict]) -> dict[str, dict]:
    """Return the root mean squares of several reports."""
    return {axis: {
        name: math.sqrt(sum(report[axis][name] ** 2 for report in reports) / len(reports))
        for name in ('residual_rms', 'disturbance_rms')} for axis in AXES}


def _axis(axis: str, reports: dict[str, dict]) -> dict:
    report = reports['ratio'][axis]
    return {
        'disturbance_rms': report['disturbance_rms'], 'residual_rms': report['residual_rms'],
        **{name: _ratio(each[axis]) for name, each in reports.items()}}


def _ratio(report: dict) -> float:
    return report['residual_rms'] / report['disturbance_rms']


def _contact(scenario: Scenario, steps: list[LoopStep]) -> dict | None:
    """Return the force on the wall and what it does to the gondola, from the first touch on."""
    if not scenario.facade.present:
        return None
    desired = scenario.compensator.impedance.force
    begin = steps[0].sample.time + CONTACT_BEGINS
    pressing = [step for step in steps if step.sample.time >= begin]
    forces = np.array([
        Facade.force_on_wall(step.sample.head, step.wrench) for step in pressing])
    every = [Facade.force_on_wall(step.sample.head, step.wrench) for step in steps]
    rails = np.array([step.rail for step in pressing])
    error = math.sqrt(((forces - desired) ** 2).mean())
    return {'desired': desired, 'mean': float(forces.mean()), 'rms_error': error,
            'rms_error_ratio': error / desired, 'least': float(forces.min()),
            'most': float(forces.max()), 'most_ever': max(every),
            'share_off_the_wall': float((forces <= 0.0).mean()),
            'push_back_mm': float(-1e3 * rails[:, 1].mean()),
            'most_yaw_deg': math.degrees(abs(rails[:, 2]).max())}


def table(results: dict) -> Iterator[str]:
    """Yield the lines that a person reads."""
    yield (f'{"scenario":26}{"axis":7}{"disturbance":>13}{"residual":>10}{"ratio":>8}'
           f'{"acceleration":>14}{"none":>8}{"oracle":>9}   (RMS, ratios by prediction)')
    for name, result in results['scenarios'].items():
        for axis in AXES:
            if result[axis] is not None:
                yield f'{name:26}{axis:7}' + _cells(axis, result[axis])
        if result['contact_force']:
            force = result['contact_force']
            yield (f'{name:26}force  {force["desired"]:9.1f} N {force["rms_error"]:8.2f} N'
                   f'{100 * force["rms_error_ratio"]:7.2f}%  {force["least"]:.1f} to '
                   f'{force["most"]:.1f} N, off the wall '
                   f'{100 * force["share_off_the_wall"]:.2g} %')
            yield (f'{name:26}gondola  pushed back {force["push_back_mm"]:.1f} mm, yaw '
                   f'{force["most_yaw_deg"]:.2f}° at most')
        step = result['max_step']
        yield (f'{name:26}step   {step["x_mm"]:.2f} mm, {step["y_mm"]:.2f} mm, '
               f'{step["theta_deg"]:.3f}° in one cycle at most')
    yield 'sweep: ' + '  '.join(
        f'{item["frequency_hz"]:g} Hz {100 * item["ratio"]:.0f}%' for item in results['sweep'])


def _cells(axis: str, result: dict) -> str:
    scale, unit = getattr(SCALES, axis), getattr(UNITS, axis)
    return (f'{scale * result["disturbance_rms"]:9.3f} {unit:3}'
            f'{scale * result["residual_rms"]:7.3f} {unit:3}' + ''.join(
                f'{100 * result[name]:{width}.2f}%' if name in result else ''
                for name, width in zip(('ratio', *PLAIN, ORACLE), (6, 13, 7, 8), strict=True)))


def _report(output: Path, name: str, scenario: Scenario, seeds: int) -> dict:
    """Evaluate a scenario and draw it."""
    result, run = evaluate(scenario, seeds)
    force = result['contact_force']
    title = f'{name}: {scenario.mission.description}'
    draw_scenario(output / f'{name}.png', title, run.steps, force and force['desired'])
    return result


def main(args: list[str] | None = None) -> int:
    """Run the bench; return the exit status."""
    parser = argparse.ArgumentParser(prog='bench', description=__doc__.splitlines()[1])
    parser.add_argument('--scenario', action='append', help='a name or a file; all without it')
    parser.add_argument('--seeds', type=int, default=1, help='of gusts and noise, together')
    parser.add_argument('--output', default='bench_report', help='folder of the report')
    options = parser.parse_args(args)
    try:
        scenarios = {
            name: load_scenario(name) for name in options.scenario or scenario_names()}
        output = Path(options.output)
        output.mkdir(parents=True, exist_ok=True)
        results = {'scenarios': {
            name: _report(output, Path(name).stem, scenario, options.seeds)
            for name, scenario in scenarios.items()}, 'sweep': sweep()}
    except ManipulatorError as error:
        print(error, file=sys.stderr)
        return 2
    draw_sweep(output / 'sweep.png', results['sweep'])
    draw_forces(output / 'forces.png')
    draw_models(output / 'models.png', results['scenarios'], {
        'learnt continuation': 'ratio', 'constant acceleration': 'ratio_constant_acceleration',
        'oracle': ORACLE})
    (output / 'compensation.json').write_text(json.dumps(results, indent=2) + '\n')
    print(*table(results), sep='\n')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
