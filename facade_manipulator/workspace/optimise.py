"""
The best link lengths for stated requirements: a dense exact sweep, then a local refinement.

The paper keeps l + b = 700 mm without saying so and gives 352/348; along that line the areas peak
where l = b, and the ratio 1 mm before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.workspace.objectives import Objective, OBJECTIVES, Requirements, Tick
from facade_manipulator.workspace.requirements import (
    conflict,
    feasible,
    margins,
    REQUIREMENTS,
)

FINE_STEP = 0.001  # of the sweep, as the paper's
COARSE_STEP = 0.005  # where a plane of designs is integrated one by one
_ACTIVE = 2e-4  # a bound nearer than this is active [m]
_WINDOW = 3  # steps about the sweep's best in which to refine


@dataclass(frozen=True)
class Optimum:
    """The best design found: lengths [m], every figure of merit, what holds it there."""

    objective: str
    link_length: float
    platform_half_length: float
    value: float
    merits: dict[str, float]
    active: tuple[str, ...]
    designs: int


def sweep_size(objective: str, need: Requirements) -> int:
    """Return how many designs the sweep for an objective evaluates."""
    return _designs(_objective(objective), need)[0].size


def optimise(
    objective: str, need: Requirements | None = None, tick: Tick = lambda count: None
) -> Optimum:
    """
    Find the link lengths with the greatest of `OBJECTIVES`.

    Raises a ParameterError if the objective is unknown, or if no design satisfies the
    requirements; the message names the conflict.
    """
    need = need or Requirements()
    merit = _objective(objective)
    length, half = _designs(merit, need)
    of = margins(length, half, need)
    allowed = feasible(of, length)
    if not allowed.any():
        raise conflict(of, length, half, need)
    values = np.full(length.shape, -np.inf)
    values[allowed] = merit.evaluate(length[allowed], half[allowed], need, tick)
    best = int(np.argmax(values))
    found = _refine(merit, need, float(length[best]), float(half[best]), float(values[best]))
    return Optimum(
        objective, *found, {name: _evaluate(OBJECTIVES[name], need, *found[:2])
                            for name in OBJECTIVES},
        _active(need, *found[:2]), length.size)


def _objective(name: str) -> Objective:
    if name not in OBJECTIVES:
        raise ParameterError(f'objective = {name!r} is none of {", ".join(OBJECTIVES)}')
    return OBJECTIVES[name]


def _designs(merit: Objective, need: Requirements) -> tuple[np.ndarray, np.ndarray]:
    """Return the designs of the sweep: a line where the sum is given, else the box."""
    if need.length_sum:
        lower = max(need.link_range[0], need.length_sum - need.platform_range[1])
        upper = min(need.link_range[1], need.length_sum - need.platform_range[0])
        length = _steps(lower, upper, FINE_STEP)
        return length, need.length_sum - length
    step = _step(merit, need)
    length, half = np.meshgrid(
        _steps(*need.link_range, step), _steps(*need.platform_range, step), indexing='ij')
    return length.ravel(), half.ravel()


def _step(merit: Objective, need: Requirements) -> float:
    closed_form = merit.closed_form and not need.min_theta
    return FINE_STEP if need.length_sum or closed_form else COARSE_STEP


def _steps(lower: float, upper: float, step: float) -> np.ndarray:
    """Return lengths from `lower` to `upper`, both included."""
    count = max(1, round((upper - lower) / step))
    return np.unique(np.round(np.linspace(lower, upper, count + 1), 9))


def _evaluate(merit: Objective, need: Requirements, length: float, half: float) -> float:
    return float(merit.evaluate(np.array([length]), np.array([half]), need)[0])


def _refine(
    merit: Objective, need: Requirements, length: float, half: float, value: float
) -> tuple[float, float, float]:
    """Improve the sweep's best within a few steps of it; keep it where nothing is better."""
    from scipy.optimize import minimize, minimize_scalar

    def cost(design: np.ndarray) -> float:
        one, other = np.array([design[0]]), np.array([design[1]])
        lacking = sum(max(0.0, -float(margin[0])) for margin in margins(one, other, need).values())
        return lacking / 1e-3 * value - _evaluate(merit, need, *design)

    window = _WINDOW * _step(merit, need)
    box = [(max(bound[0], at - window), min(bound[1], at + window))
           for bound, at in ((need.link_range, length), (need.platform_range, half))]
    if need.length_sum:
        total = need.length_sum
        ends = max(box[0][0], total - box[1][1]), min(box[0][1], total - box[1][0])
        found = minimize_scalar(
            lambda one: cost((one, total - one)), bounds=ends, method='bounded',
            options={'xatol': 1e-6})
        design = (float(found.x), total - float(found.x))
    else:
        found = minimize(cost, (length, half), bounds=box, method='Nelder-Mead',
                         options={'xatol': 1e-6, 'fatol': 1e-12})
        design = tuple(found.x.tolist())
    one, other = np.array([design[0]]), np.array([design[1]])
    improved = -found.fun > value and feasible(margins(one, other, need), one).all()
    return (*design, _evaluate(merit, need, *design)) if improved else (length, half, value)


def _active(need: Requirements, length: float, half: float) -> tuple[str, ...]:
    """Name what the optimum leans on."""
    edges = {
        f'l >= {need.link_range[0]:g} m': length - need.link_range[0],
        f'l <= {need.link_range[1]:g} m': need.link_range[1] - length,
        f'b >= {need.platform_range[0]:g} m': half - need.platform_range[0],
        f'b <= {need.platform_range[1]:g} m': need.platform_range[1] - half,
        'order of the carriages, l = b - gap': abs(length - half + need.carriage_gap),
        'stroke, Q = 2 b': abs(need.stroke_length - 2.0 * half),
    }
    names = [name for name, distance in edges.items() if distance <= _ACTIVE]
    if need.length_sum:
        names.insert(0, f'l + b = {need.length_sum:g} m')
    of = margins(np.array([length]), np.array([half]), need)
    return (*names, *(
        f'{requirement.name} = {requirement.asked(need):.4g} {requirement.unit}'
        for requirement in REQUIREMENTS
        if requirement.name in of and of[requirement.name][0] <= requirement.tolerance))
