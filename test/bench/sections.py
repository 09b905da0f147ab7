"""What the bench measures, section by section."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import os

from rounds import Contender, time_in_turns, time_one_by_one
from table import compare, Row

FAST_ROUNDS = 9

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
)
PREDICTION = (
    ('estimate learnt and forecast twice, beside its continuation alone',
     'prediction: with tones', 'prediction: continuation', 'us', 'P1', '<= 1.2'),
)
CYCLES = (
    ("exchange with the drives, beside canopen's PDO objects", 'cycle: bus and codecs',
     'cycle: canopen', 'us', 'C1', '<= 0.8'),
    ('whole cycle, beside the bare exchange on canopen', 'cycle: driver', 'cycle: canopen', 'us',
     'C1', '<= 1.0'),
)

def kinematics(rounds: int, quick: bool) -> list[Row]:
    """K1."""
    return _compared('scalar_makers', SCALAR, rounds if quick else max(rounds, FAST_ROUNDS), quick)


def prediction(rounds: int, quick: bool) -> list[Row]:
    """P1."""
    return _compared('prediction_makers', PREDICTION, rounds, quick)


def bus(rounds: int, quick: bool) -> list[Row]:
    """C1."""
    rows = _compared('cycle_makers', CYCLES, 1 if quick else rounds, quick, time_one_by_one)
    interface = os.environ['BENCH_CAN'].partition(':')[0]
    place = f'{interface}, {os.environ["BENCH_CAN_RATE"]} Hz'
    return [replace(row, name=f'{row.name} ({place})') for row in rows]


def _compared(
    module: str, wanted, rounds: int, quick: bool, measure: Callable = time_in_turns
) -> list[Row]:
    names = dict.fromkeys(name for row in wanted for name in row[1:3])
    times = measure([Contender(name, module) for name in names], rounds, quick)
    rows = [compare(name, times[ours], times.get(competitor), unit, goal_id, goal)
            for name, ours, competitor, unit, goal_id, goal in wanted if ours in times]
    return [row for row in rows if row is not None]
