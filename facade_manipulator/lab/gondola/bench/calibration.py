"""
Bench of the calibration: made-up machines, estimators and what is left of a disturbance.

Run it by ``python -m facade_manipulator.lab.gondola.bench.calibration``. It prints how often the
truth is within three standard deviations, how well the head is known at poses held out, how well
an estimator is found, and the compensation's residual on a machine that nobody calibrated, on the
same one calibrated, and without any error.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
import math
from typing import NamedTuple

import numpy as np

from facade_manipulator.kinematics import Geometry
from facade_manipulator.lab.gondola.bench.__main__ import run_scenario
from facade_manipulator.lab.gondola.course import rms
from facade_manipulator.lab.gondola.machines import (
    make_machine,
    measure_heads,
    record_estimator,
)
from facade_manipulator.lab.gondola.motion import Sway
from facade_manipulator.lab.gondola.scenario import load_scenario
from facade_manipulator.lab.gondola.wall import AXES, SCALES, UNITS
from facade_manipulator.tools.calibration import (
    candidates,
    fit_estimator,
    heads,
    identify,
    Measurements,
    plan,
    spread,
    UNKNOWNS,
    values_of,
)

DRAWING = Geometry()
SEED = 1
POSES = 24
HELD_OUT = 60
# errors as large as a machine has, all at once
MADE = Geometry(link_errors=(5e-4, -5e-4), carriage_offsets=(1e-3, -1e-3, 0.0),
                rail_angle=math.radians(0.2))
MOUNTING, STAMP_ERROR = (0.5, 0.3, math.radians(0.5)), 0.02  # m, m, rad; s


class Trial(NamedTuple):
    """What calibrating many machines came to; heads at poses held out."""

    deviations: np.ndarray  #: found less true, in standard deviations, (machines, unknowns)
    before: np.ndarray  #: RMS of the head's error, (machines, 3)
    after: np.ndarray
    share: np.ndarray  #: what the noise alone is expected to leave of it
    blamed: int  #: good measurements taken for outliers

    @property
    def within(self) -> float:
        """Share of parameters within three deviations of the truth."""
        return float((np.abs(self.deviations) < 3.0).mean())


def try_machines(machines: int) -> Trial:
    """Make, measure and calibrate machines."""
    random = np.random.default_rng(SEED)
    poses, permitted = plan(DRAWING, UNKNOWNS, POSES), candidates(DRAWING)
    rows, blamed = [], 0
    for _ in range(machines):
        made = make_machine(DRAWING, random)
        held = permitted[random.choice(len(permitted), HELD_OUT, replace=False)]
        found = identify(
            DRAWING, UNKNOWNS, Measurements(poses, measure_heads(made, poses, random)))
        blamed += len(found.outliers)
        truth = heads(made, held)
        rows.append((
            (found.values - values_of(made, UNKNOWNS)) / np.sqrt(np.diag(found.covariance)),
            rms(truth - heads(DRAWING, held)), rms(truth - heads(found.geometry, held)),
            rms(spread(found.geometry, UNKNOWNS, found.covariance, held))))
    deviations, before, after, share = (np.array(column) for column in zip(*rows, strict=True))
    return Trial(deviations, before, after, share, blamed)


def trial_table(trial: Trial) -> list[str]:
    """Return the lines that a person reads."""
    lines = [f'machines {len(trial.deviations)}, parameters within 3 sigma {trial.within:.2%}, '
             f'good measurements blamed {trial.blamed}',
             f'{"":8s}{"before":>10s}{"after":>10s}{"noise share":>13s}{"ratio":>8s}']
    for k, axis in enumerate(AXES):
        before, after, share = (SCALES[k] * rms(column[:, k]) for column in (
            trial.before, trial.after, trial.share))
        lines.append(f'{axis:8s}{before:10.3f}{after:10.3f}{share:13.3f}{after / share:8.2f} '
                     f'{UNITS[k]}')
    return lines


def try_estimators(count: int) -> np.ndarray:
    """
    Mount estimators somewhere and find them by two minutes of a breeze and a late camera.

    Returns
    -------
    ndarray, shape (2, count, 4)
        Found less true, and the deviations published: x, y, yaw and delay [m, m, rad, s].

    """
    scenario, random, rows = load_scenario('breeze'), np.random.default_rng(SEED), []
    for number in range(count):
        mounting = (*random.uniform(-1.0, 1.0, 2).tolist(), random.normal(0.0, 0.02))
        delay, late = random.uniform(-0.05, 0.05), random.uniform(0.0, 0.05)
        found = fit_estimator(DRAWING, record_estimator(Sway(scenario.sway).at, replace(
            scenario.estimator, mounting=mounting, stamp_error=delay, seed=SEED + number,
        ), DRAWING, late=late))
        rows.append((np.subtract((*found.settings.mounting, found.settings.delay),
                                 (*mounting, delay)), [*found.deviations.values()]))
    return np.array(rows).transpose(1, 0, 2)


def estimator_table(errors: np.ndarray) -> list[str]:
    """Return the lines that a person reads."""
    off, published = errors
    most, ratios = np.abs(off).max(axis=0), off / published
    return [f'estimators {len(off)}, camera 0 to 50 ms late: off by at most '
            f'{1e3 * most[:2].max():.2f} mm, {math.degrees(most[2]):.3f} deg, '
            f'{1e3 * most[3]:.2f} ms; {np.sqrt((ratios ** 2).mean()):.2f} RMS of the deviations '
            f'published, {(np.abs(ratios) < 3.0).mean():.2%} within 3']


def residuals() -> dict[str, list[float]]:
    """Return the RMS of the head on the wall in a breeze [m, m, rad], by what is known."""
    scenario, random = load_scenario('breeze'), np.random.default_rng(SEED)
    mounted = scenario._replace(estimator=replace(
        scenario.estimator, mounting=MOUNTING, stamp_error=STAMP_ERROR))
    poses = plan(DRAWING, UNKNOWNS, POSES)
    known = identify(DRAWING, UNKNOWNS, Measurements(
        poses, measure_heads(MADE, poses, random))).geometry
    estimate = fit_estimator(
        known, record_estimator(Sway(scenario.sway).at, mounted.estimator, MADE)).settings
    calibrated = mounted._replace(compensator=mounted.compensator._replace(estimate=estimate))
    runs = {'not calibrated': (mounted, DRAWING, MADE), 'calibrated': (calibrated, known, MADE),
            'ideal': (scenario, DRAWING, DRAWING)}
    return {name: [axis['residual_rms'] for axis in run_scenario(
        scenario, geometry=geometry, made=made).loop.wall.report()['axes'].values()]
            for name, (scenario, geometry, made) in runs.items()}


def residual_table(found: dict[str, list[float]]) -> list[str]:
    """Return the lines that a person reads."""
    lines = [f'{"breeze":16s}' + ''.join(f'{axis:>10s}' for axis in AXES) + '   (RMS)']
    return lines + [f'{name:16s}' + ''.join(
        f'{scale * value:7.3f} {unit:2s}' for value, scale, unit in zip(
            values, SCALES, UNITS, strict=True)) for name, values in found.items()]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the bench; return the exit status."""
    parser = argparse.ArgumentParser(prog='bench-calibration', description=__doc__.splitlines()[1])
    parser.add_argument('--machines', type=int, default=200)
    parser.add_argument('--estimators', type=int, default=40)
    options = parser.parse_args(arguments)
    print(*trial_table(try_machines(options.machines)), sep='\n')
    print(*estimator_table(try_estimators(options.estimators)), sep='\n')
    print(*residual_table(residuals()), sep='\n')
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
