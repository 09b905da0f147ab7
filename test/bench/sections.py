"""What the bench measures, section by section: each returns rows and the growth it found."""

from __future__ import annotations

from dataclasses import replace
import os

from rounds import Contender, time_in_turns, time_one_by_one
from table import alone, compare, Row

FAST_ROUNDS = 9
QUICK_ROUNDS = 2  # of what takes seconds
WIRE_LIMIT = 1340.0  # Hz: SYNC, three RPDO and three TPDO at 1 Mbit/s

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
    """K1."""
    return _compared('scalar_makers', SCALAR, max(rounds, FAST_ROUNDS), quick), {}


def maps(rounds: int, quick: bool) -> Found:
    """M1 and M2."""
    wanted = MAPS
    if quick:  # an eighth of the grid stands for it, counted as that share
        wanted = [tuple(PART.get(word, word) for word in row) for row in MAPS]
    rows = _compared('map_makers', wanted, rounds, quick)
    peak = map_memory()
    rows.append(alone('full map, memory on top', peak, 'MiB', 'M1', '<= 20'))
    rows += _compared('map_makers', SWEEPS, QUICK_ROUNDS if quick else rounds, quick)
    return rows, {}


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
    return time_in_turns([Contender(name, module) for name in names], rounds, quick)


def _rows(wanted, times: dict[str, float]) -> list[Row]:
    rows = [compare(name, times[ours], times.get(competitor), unit, goal_id, goal)
            for name, ours, competitor, unit, goal_id, goal in wanted if ours in times]
    return [row for row in rows if row is not None]
