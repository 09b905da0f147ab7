"""
A made-up machine to practise `calibrate` on: it is measured, recorded and touches a wall.

    python -m facade_manipulator.lab.gondola.practice poses.csv --folder practice

fills in the poses that ``calibrate geometry --plan poses.csv`` has written, makes what
``calibrate estimator`` and ``calibrate wall`` read, and prints what they should find.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import math
from pathlib import Path

import numpy as np

from facade_manipulator.errors import exit_status
from facade_manipulator.files import write_table
from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of, Pose
from facade_manipulator.lab.gondola.machines import (
    make_machine,
    measure_heads,
    record_estimator,
)
from facade_manipulator.lab.gondola.motion import Sway, SwaySettings
from facade_manipulator.lab.gondola.sensors import EstimatorSettings
from facade_manipulator.tools.calibration import fill, read_measured, Sought

ERRORS = ('link_errors', 'platform_errors', 'carriage_offsets', 'rail_angle', 'tool', 'rail_bow',
          'slide_angle')
TOUCHES, TOUCH_NOISE = (-0.2, -0.1, 0.0, 0.1, 0.2), 5e-4  # m
HEAD = Pose._fields


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(
        prog='practice', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('poses', type=Path, help='what `calibrate geometry --plan` has written')
    parser.add_argument('--folder', type=Path, default=Path('.'), help='of the other files')
    parser.add_argument('--seed', type=int, default=1, help='another seed is another machine')
    options = parser.parse_args(arguments)
    return exit_status(
        'practice', lambda: practise(options.poses, options.folder, options.seed))


def practise(poses: Path, folder: Path, seed: int) -> None:
    """Make a machine, its files and a page about it."""
    random = np.random.default_rng(seed)
    machine = make_machine(Geometry(), random)
    estimator = EstimatorSettings(
        mounting=(*random.uniform(-1.0, 1.0, 2).tolist(), random.normal(0.0, 0.01)),
        stamp_error=random.uniform(-0.03, 0.03), seed=seed)
    distance, angle = random.uniform(0.24, 0.28), random.normal(0.0, 0.01)
    _measure(poses, machine, random)
    folder.mkdir(parents=True, exist_ok=True)
    _record(folder, machine, estimator)
    _touch(folder / 'touches.csv', machine, distance, angle, random)
    for name in ERRORS:
        print(f'geometry.{name}: {np.round(getattr(machine, name), 5).tolist()}')
    print(f'estimate.mounting: {np.round(estimator.mounting, 4).tolist()}\n'
          f'estimate.delay: {estimator.stamp_error:.4f}\n'
          f'wall: {distance:.4f} m away, turned by {math.degrees(angle):.2f} deg')


def _measure(path: Path, machine: Geometry, random: np.random.Generator) -> None:
    carriages = read_measured(path, Sought(machine)).carriages
    for row, head in enumerate(measure_heads(machine, carriages, random)):
        fill(path, row, carriages[row], HEAD, head)


def _record(folder: Path, machine: Geometry, estimator: EstimatorSettings) -> None:
    recording = record_estimator(Sway(SwaySettings()).at, estimator, machine)
    columns = {'disturbance': HEAD, 'joints': Carriages._fields, 'wall': HEAD}
    for name, table in recording._asdict().items():
        write_table(folder / f'{name}.csv', ('time', *columns[name]), table.round(7).tolist())


def _touch(
    path: Path, machine: Geometry, distance: float, angle: float, random: np.random.Generator
) -> None:
    mechanism, errors = mechanism_of(machine), TOUCH_NOISE * random.standard_normal(len(TOUCHES))
    write_table(path, Carriages._fields, [
        [round(q, 7) for q in mechanism.inverse_kinematics(
            Pose(x, distance + x * math.tan(angle) + error, 0.0))]
        for x, error in zip(TOUCHES, errors.tolist(), strict=True)])


if __name__ == '__main__':
    raise SystemExit(main())
