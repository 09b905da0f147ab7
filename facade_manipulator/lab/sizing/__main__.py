"""
Find a machine for a gondola: mechanism, motors, gears and screws, and its parameter file.

The scenarios say how the gondola moves (sines, a spectrum, cable and wind, a recording), where the
strokes on the wall are and how good the estimator is.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
import sys
from typing import Any

from facade_manipulator.errors import exit_status, ParameterError
from facade_manipulator.files import write_table
from facade_manipulator.lab import study
from facade_manipulator.lab.gondola import giving_way, load_scenario, Scenario, scenario_file
from facade_manipulator.lab.sizing import outcome
from facade_manipulator.lab.sizing.axis_drive import AXES, Duty
from facade_manipulator.lab.sizing.candidates import (
    Candidate,
    choice,
    examine,
    Examined,
    front,
    impossible,
    Problem,
    SizeLimits,
)
from facade_manipulator.lab.sizing.catalogue import read_motors, read_screws
from facade_manipulator.lab.sizing.demand import Payload, tasks
from facade_manipulator.lab.sizing.forecast import FORECAST, residual, rows, SETTLED
from facade_manipulator.parameters import parameter_fields, settings_from
from facade_manipulator.resources import config_path

REPORT = Path('design_report')
BAD_INPUT = 2
WIDTH = 140  # columns
RUNS = 8  # of a forecast
SHOWN = 12  # machines in the terminal; all are in the file
SIZES = ('link_range', 'platform_range', 'length_sum', 'stroke_length', 'carriage_gap',
         'min_y_travel', 'min_theta', 'min_difference', 'threshold', 'characteristic_length',
         'designs', 'seed')
EXAMPLES = """
examples:
  design breeze gusty --wall-force 10          one machine for two of config/scenarios
  design my_gondola.yaml --longest-stroke 0.9 --motors my_motors.csv --screws my_screws.csv
  design gusty --forecast my_machine.yaml      is the gondola compensable with this machine?
  demo --parameters design_report/machine.yaml --scenario design_report/breeze.yaml

Wrong input ends with exit status 2 and writes nothing.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Find a machine; return the exit status."""
    options = _parser().parse_args(argv)
    return exit_status('design', lambda: _run(options), BAD_INPUT)


def _run(options: argparse.Namespace) -> None:
    """Read every input, then compute, write and show."""
    scenarios = {name: load_scenario(name) for name in options.scenario}
    if options.forecast:
        _forecast(options, scenarios)
        return
    problem = _problem(options, scenarios.values())
    with study.folder(options.output) as draft:
        examined = _examine(problem)
        candidates = front(found for one in examined for found in one.candidates)
        if not candidates:
            raise impossible(examined, problem)
        chosen = choice(candidates)
        _write(draft, candidates, chosen, problem.duty)
        for name, scenario in scenarios.items():
            source = scenario_file(name)
            outcome.write_scenario(
                draft / f'{source.stem}.yaml', source, scenario, chosen.design.offset)
    _show(candidates, chosen, problem.duty)
    print(f'written in {options.output}/: machine.yaml, axes.csv, front.csv, design.png and the '
          'scenarios at the distance of this machine')


def _forecast(options: argparse.Namespace, scenarios: dict[str, Scenario]) -> None:
    """
    Say what a machine leaves of each scenario's motion, and how long it can.

    Raises a ParameterError for fewer runs than one.
    """
    if options.runs < 1:
        raise ParameterError(f'--runs {options.runs} is below 1')
    seeds = range(1, options.runs + 1)
    runs = [one.with_seed(seed) for one in scenarios.values() for seed in seeds]
    found = _mapped('runs', partial(residual, path=options.forecast), runs)
    table: list[tuple[Any, ...]] = [
        (name, axis, *values) for number, name in enumerate(scenarios)
        for axis, values in rows(found[number * options.runs:][:options.runs])]
    with study.folder(options.output) as draft:
        write_table(draft / 'forecast.csv', FORECAST, table)
    study.console(WIDTH).print(study.table(
        f'Expected of {options.forecast.name}, root mean squares of {options.runs} runs from '
        f'{SETTLED:g} s on', FORECAST,
        ((*row[:2], *(f'{value:.3g}' for value in row[2:])) for row in table)))
    for name, scenario in scenarios.items():
        for axis in giving_way(scenario):
            print(f'{name}: {axis} gives way to the wall: its shift is meant')
    print(f'written in {options.output}/: forecast.csv')


def _problem(options: argparse.Namespace, scenarios: Iterable[Scenario]) -> Problem:
    given = vars(options)
    payload = settings_from(Payload, given)
    return Problem(
        tuple(one for scenario in scenarios for one in tasks(scenario, payload)), payload,
        settings_from(SizeLimits, given),
        settings_from(Duty, given), tuple(read_motors(options.motors)),
        tuple(read_screws(options.screws)))


def _examine(problem: Problem) -> list[Examined]:
    """Examine all designs of the box that the requirements allow."""
    designs = study.designs_of(problem.need)
    allowed = designs[:, study.feasible(designs, problem.need)]
    return _mapped('designs', partial(examine, problem=problem), allowed.T.tolist())


def _mapped(title: str, function: Callable[[Any], Any], items: Sequence[Any]) -> list[Any]:
    """Return what a function makes of each item, on all processors."""
    found = []
    with study.executor_of(None) as executor, study.progress_bar(title, len(items)) as tick:
        for one in executor.map(function, items):
            found.append(one)
            tick()
    return found


def _write(draft: Path, candidates: list[Candidate], chosen: Candidate, duty: Duty) -> None:
    from facade_manipulator.lab.gondola.pictures import save
    from facade_manipulator.lab.sizing.picture import draw

    write_table(draft / 'front.csv', outcome.FRONT, outcome.front_rows(candidates))
    write_table(draft / 'axes.csv', ('quantity', *AXES), outcome.axis_rows(chosen, duty))
    outcome.write_machine(draft / 'machine.yaml', chosen)
    save(draw(candidates, chosen, duty), draft / 'design.png')


def _show(candidates: list[Candidate], chosen: Candidate, duty: Duty) -> None:
    shown = study.console(WIDTH)
    near = sorted(candidates, key=lambda one: (one.power, one.rail))[:SHOWN]
    shown.print(study.table(
        f'{len(candidates)} machines of which none other is better in all respects; those with '
        'the weakest motors', outcome.FRONT, outcome.front_rows(near)))
    shown.print(study.table(f'The first of them: {chosen.drive.name}', ('quantity', *AXES), (
        (name, *(f'{value:.4g}' for value in values))
        for name, *values in outcome.axis_rows(chosen, duty))))
    shown.print(f'What binds is {chosen.binds}: it exceeds what is asked {chosen.margin:.3g} '
                'times.')


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='design', description=__doc__.strip().splitlines()[0], epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('scenario', nargs='+',
                        help='a name in config/scenarios, or a file: the machine does them all')
    parser.add_argument('--output', type=Path, default=REPORT, metavar='DIR',
                        help=f'folder of the results (default {REPORT}/)')
    reverse = parser.add_argument_group('is the gondola compensable?')
    reverse.add_argument('--forecast', type=Path, metavar='YAML', nargs='?',
                         const=config_path('manipulator.yaml'),
                         help='forecast what the machine of a parameter file (default: that of '
                              'config/) will leave, in place of looking for one')
    reverse.add_argument('--runs', type=int, default=RUNS, metavar='N',
                         help=f'how often, each with other gusts and noise (default {RUNS})')
    choose = parser.add_argument_group('of what to choose')
    for name in ('motors', 'screws'):
        path = config_path('sizing') / f'{name}.csv'
        choose.add_argument(f'--{name}', type=Path, default=path, metavar='CSV',
                            help=f'table of {name} (default: an example, config/sizing)')
    for title, settings, names in (
            ('how large', SizeLimits, SIZES),
            ('what is moved', Payload, parameter_fields(Payload)),
            ('how it is built and used', Duty, parameter_fields(Duty))):
        study.add_settings(parser.add_argument_group(title), settings, *names)
    return parser


if __name__ == '__main__':
    sys.exit(main())
