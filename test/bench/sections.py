"""What the bench measures, section by section: each returns rows and the growth it found."""

from __future__ import annotations

from dataclasses import replace
import os

from rounds import Contender, time_in_turns, time_one_by_one
from table import alone, compare, Row

BATCH_COUNTS = (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000)
FAST_ROUNDS = 9
QUICK_ROUNDS = 2  # of what takes seconds
GRIDS_MM = (4, 2, 1, 0.5, 0.25)
WIRE_LIMIT = 1340.0  # Hz: SYNC, three RPDO and three TPDO at 1 Mbit/s
OURS_HERE = (
    'math', 'loop', 'bare passes', 'meshgrid', 'part', 'blocks', 'grids', 'numpy', 'canopen')

Growth = dict[str, dict]
Found = tuple[list[Row], Growth]

# name, contender, competitor, unit, goal id, goal
SCALAR = (
    ('inverse of one pose, beside inline math', 'inverse: ours', 'inverse: math', 'us',
     'K1', '<= 2.5'),
    ('inverse of one pose, beside scipy root', 'inverse: ours', 'inverse: scipy root', 'us',
     'K1', '>= 50'),
    ('forward of one pose, beside scipy root', 'forward: ours', 'forward: scipy root', 'us',
     'K1', '>= 15'),
    ('Jacobian of one pose, beside numpy', 'jacobian: ours', 'jacobian: numpy', 'us',
     'K1', '>= 12'),
    ('inverse with all limits, beside inline math', 'inverse: ours, all limits',
     'inverse: math', 'us', '', ''),
    ('inverse of one pose, beside numpy', 'inverse: ours', 'inverse: numpy', 'us', '', ''),
    ('inverse of one pose, beside casadi', 'inverse: ours', 'inverse: casadi', 'us', '', ''),
    ('inverse of one pose, beside pinocchio', 'inverse: ours', 'inverse: pinocchio', 'us',
     '', ''),
    ('inverse of one pose, beside mink', 'inverse: ours', 'inverse: mink', 'us', '', ''),
    ('forward of one pose, beside casadi', 'forward: ours', 'forward: casadi', 'us', '', ''),
)
BATCH = (
    ('inverse of 1e5 poses, beside a loop', 'inverse: ours', 'inverse: loop', 'ns',
     'K2', '>= 25'),
    ('inverse of 1e5 poses, beside sin + cos + 2 sqrt', 'inverse: ours', 'inverse: bare passes',
     'ns', 'K2', '>= 0.65'),
    ('the same, stretch', 'inverse: ours', 'inverse: bare passes', 'ns', 'K2', '>= 1.0'),
    ('inverse of 1e5 poses, beside numba', 'inverse: ours', 'inverse: numba', 'ns', '', ''),
    ('forward of 1e5 poses, beside a loop', 'forward: ours', 'forward: loop', 'ns',
     'K2', '>= 25'),
    ('forward of 1e5 poses, beside numba', 'forward: ours', 'forward: numba', 'ns',
     'K2', '>= 1.0'),
)
MAPS = (
    ('full map, beside numpy meshgrid', 'map: ours', 'map: numpy meshgrid', 'ms',
     'M1', '>= 5000'),
    ('full map, beside numpy angle by angle', 'map: ours', 'map: numpy blocks', 'ms', '', ''),
)
PART = {'map: numpy meshgrid': 'map: numpy meshgrid, part'}
SWEEPS = (
    ('design sweep, numeric y, beside x-y grids', 'sweep: numeric y', 'sweep: x-y grids', 'us',
     'M2', '>= 2000'),
    ('design sweep, closed form, beside x-y grids', 'sweep: closed form', 'sweep: x-y grids',
     'us', 'M2', '>= 50000'),
)
CYCLES = (
    ("exchange with the drives, beside canopen's PDO objects", 'cycle: bus and codecs',
     'cycle: canopen', 'us', 'C1', '<= 0.8'),
    ('whole cycle, beside the bare exchange on canopen', 'cycle: driver', 'cycle: canopen', 'us',
     'C1', '<= 1.0'),
    ('processor time of a whole cycle, beside the wire', 'cycle: driver', 'wire', 'us', '', ''),
    ('cycles one after the other, beside the wire', 'cycle: driver, fastest', 'wire', 'us',
     'C1', '>= 3'),
)
WHY = {  # of goals missed
    'virtual': 'waking and frames take half of what they take on canopen; limits, two checks of '
               'the mechanism, supervision, record and snapshots, which it has not, come on top, '
               'in caches that turn cold between two cycles',
    'socketcan': 'where user-mode Linux carries the bus, a call of the system costs 6 to 10 us, '
                 'and so does each look at a clock, of which supervision takes two a frame',
}
CYCLE_NAMES = (
    'cycle: driver', 'cycle: bus and codecs', 'cycle: canopen', 'cycle: driver, fastest')


def kinematics(rounds: int, quick: bool) -> Found:
    """K1 and K2, and the growth with the number of poses."""
    rounds = max(rounds, FAST_ROUNDS)
    rows = _compared('scalar_makers', SCALAR, rounds, quick)
    rows += _compared('batch_makers', BATCH, rounds, quick)
    position, angle = round_trip()
    rows.append(alone('round trip of 1e5 poses, length', position, 'mm', 'K2', '<= 1e-9'))
    rows.append(alone('round trip of 1e5 poses, angle', angle, 'rad', 'K2', '<= 1e-12'))
    return rows, {} if quick else _growth_of_poses(rounds)


def round_trip() -> tuple[float, float]:
    """Return the greatest errors of FK(IK) [mm, rad] over the batch's poses."""
    from batch_makers import poses
    import numpy as np

    from facade_manipulator.kinematics import (
        forward_kinematics_batch,
        Geometry,
        inverse_kinematics_batch,
    )

    wanted = poses()
    carriages, valid = inverse_kinematics_batch(Geometry(), wanted)
    found, _ = forward_kinematics_batch(Geometry(), carriages[valid])
    error = np.abs(found - wanted[valid]).max(axis=0)
    return 1e3 * float(error[:2].max()), float(error[2])


def _growth_of_poses(rounds: int) -> Growth:
    lines = {}
    for what in ('inverse', 'forward'):
        names = [f'{what}: ours' + (f', {n}' if n != 100_000 else '') for n in BATCH_COUNTS]
        times = time_in_turns(
            [Contender(name, 'batch_makers') for name in names], min(rounds, 3), False)
        lines[what] = [1e9 * times[name] for name in names]
    return {'Batch kinematics': {
        'at': list(BATCH_COUNTS), 'x': 'poses', 'y': 'ns a pose', 'lines': lines}}


def maps(rounds: int, quick: bool) -> Found:
    """M1 and M2, and the growth with the grid."""
    wanted = MAPS
    if quick:  # an eighth of the grid stands for it, counted as that share
        wanted = [tuple(PART.get(word, word) for word in row) for row in MAPS]
    rows = _compared('map_makers', wanted, rounds, quick)
    peak = map_memory()
    rows.append(alone('full map, memory on top', peak, 'MiB', 'M1', '<= 20'))
    rows += _compared('map_makers', SWEEPS, QUICK_ROUNDS if quick else rounds, quick)
    if quick:
        return rows, {}
    names = ['map: ours' + ('' if step == 1 else f', {step:g} mm') for step in GRIDS_MM]
    times = time_in_turns([Contender(name, 'map_makers') for name in names], 3, False)
    return rows, {'Workspace map': {
        'at': list(GRIDS_MM), 'x': 'grid of x and y [mm]', 'y': 'ms',
        'lines': {'count_poses': [1e3 * times[name] for name in names]}}}


def map_memory() -> float:
    """Return the memory that a map takes on top [MiB]."""
    from map_makers import MAKERS

    return MAKERS['map: ours, memory']()[2][0]


def bus(rounds: int, quick: bool) -> Found:
    """C1."""
    times = time_one_by_one(
        [Contender(name, 'cycle_makers') for name in CYCLE_NAMES],
        QUICK_ROUNDS if quick else rounds, quick)
    rows = _rows(CYCLES, {**times, 'wire': 1.0 / WIRE_LIMIT})
    interface = os.environ['BENCH_CAN'].partition(':')[0]
    if any(row.met is False for row in rows):
        print(f'  missed C1: {WHY[interface]}')
    place = f'{interface}, {os.environ["BENCH_CAN_RATE"]} Hz'
    return [replace(row, name=f'{row.name} ({place})') for row in rows], {}


def _compared(module: str, wanted, rounds: int, quick: bool) -> list[Row]:
    return _rows(wanted, _times(module, wanted, rounds, quick))


def _times(module: str, wanted, rounds: int, quick: bool) -> dict[str, float]:
    names = dict.fromkeys(name for row in wanted for name in row[1:3])
    return time_in_turns(
        [Contender(name, module, _is_here(name)) for name in names], rounds, quick)


def _is_here(name: str) -> bool:
    """Tell whether a contender needs nothing that the package does not bring."""
    return 'ours' in name or name.startswith(('sweep', 'cycle')) or name.endswith(OURS_HERE)


def _rows(wanted, times: dict[str, float]) -> list[Row]:
    rows = [compare(name, times[ours], times.get(competitor), unit, goal_id, goal)
            for name, ours, competitor, unit, goal_id, goal in wanted if ours in times]
    return [row for row in rows if row is not None]
