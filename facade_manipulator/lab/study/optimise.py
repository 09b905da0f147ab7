"""
What a design is worth, and the link lengths worth most: a dense exact sweep, then a refinement.

Designs are arrays of equal shape. Areas are closed forms; volume and ratio are integrals, done
design by design.

The paper keeps l + b = 700 mm without saying so and gives 352/348; along that line the areas peak
where l = b, and the ratio 1 mm before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import ParameterError
from facade_manipulator.lab.study.requirements import (
    conflict,
    feasible,
    margins,
    REQUIREMENTS,
    Requirements,
)
from facade_manipulator.lab.study.section import section_area
from facade_manipulator.lab.study.volume import measure, Workspace

THETA_NODES, Y_CELLS = 512, 64  # the ratio to 2e-4, the volume far better

FINE_STEP = 0.001  # of the sweep, as the paper's
COARSE_STEP = 0.005  # where a plane of designs is integrated one by one
_ACTIVE = 2e-4  # a bound nearer than this is active [m]
_WINDOW = 3  # steps about the sweep's best in which to refine

Tick = Callable[[int], None]  # called with the number of designs done


class Objective(NamedTuple):
    """A figure of merit: a closed form of arrays of designs, or one of a workspace measured."""

    description: str
    unit: str
    closed_form: Callable[[np.ndarray, np.ndarray, Requirements], np.ndarray] | None = None
    merit: Callable[[Workspace], float] = lambda of: of.volume

    def evaluate(
        self, designs: np.ndarray, need: Requirements, tick: Tick = lambda count: None
    ) -> np.ndarray:
        """Return the merit of every design, of which l and b are the first dimension."""
        length, half = designs
        if self.closed_form:
            tick(length.size)
            return self.closed_form(length, half, need)
        values = np.empty(length.shape)
        for place in np.ndindex(length.shape):
            values[place] = self.merit(measure(
                need.geometry(float(length[place]), float(half[place])), need.threshold,
                need.characteristic_length, THETA_NODES, Y_CELLS))
            tick(1)
        return values


OBJECTIVES = {
    'area': Objective(
        'area at theta = 0', 'm2', lambda length, half, need: section_area(
            length, half, need.stroke_length, need.carriage_gap)),
    'good_area': Objective(
        'area at theta = 0 with a good index', 'm2', lambda length, half, need: section_area(
            length, half, need.stroke_length, need.carriage_gap, need.threshold,
            need.characteristic_length)),
    'volume': Objective('volume over x, y and theta before N = 0', 'm2 rad',
                        merit=lambda of: of.volume - of.beyond),
    'ratio': Objective('good share of the volume', '',
                       merit=lambda of: of.ratio if of.volume else 0.0),
}


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
    return _designs(_objective(objective), need).shape[1]


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
    designs = _designs(merit, need)
    length, half = designs
    of = margins(length, half, need)
    allowed = feasible(of, length)
    if not allowed.any():
        raise conflict(of, length, half, need)
    values = np.full(allowed.shape, -np.inf)
    values[allowed] = merit.evaluate(designs[:, allowed], need, tick)
    best = np.argmax(values)
    design, value = _refine(merit, need, designs[:, best], float(values[best]))
    return Optimum(
        objective, float(design[0]), float(design[1]), value,
        {name: float(one.evaluate(design, need)) for name, one in OBJECTIVES.items()},
        _active(need, design), values.size)


def _objective(name: str) -> Objective:
    if name not in OBJECTIVES:
        raise ParameterError(f'objective = {name!r} is not one of {", ".join(OBJECTIVES)}')
    return OBJECTIVES[name]


def _designs(merit: Objective, need: Requirements) -> np.ndarray:
    """Return the designs of the sweep, shape (2, n): a line where the sum is given, or the box."""
    if need.length_sum:
        lower = max(need.link_range[0], need.length_sum - need.platform_range[1])
        upper = min(need.link_range[1], need.length_sum - need.platform_range[0])
        length = _steps(lower, upper, FINE_STEP)
        return np.stack([length, need.length_sum - length])
    step = _step(merit, need)
    return np.stack(np.meshgrid(
        _steps(*need.link_range, step), _steps(*need.platform_range, step), indexing='ij')
    ).reshape(2, -1)


def _step(merit: Objective, need: Requirements) -> float:
    closed_form = merit.closed_form and not need.min_theta
    return FINE_STEP if need.length_sum or closed_form else COARSE_STEP


def _steps(lower: float, upper: float, step: float) -> np.ndarray:
    """Return lengths from `lower` to `upper`, both included."""
    count = max(1, round((upper - lower) / step))
    return np.unique(np.round(np.linspace(lower, upper, count + 1), 9))


def _refine(
    merit: Objective, need: Requirements, design: np.ndarray, value: float
) -> tuple[np.ndarray, float]:
    """Improve the sweep's best within a few steps of it; keep it where nothing is better."""
    from scipy.optimize import minimize, minimize_scalar

    def cost(design: np.ndarray) -> float:
        lacking = sum(max(0.0, -float(margin)) for margin in _margins(design, need).values())
        return lacking / 1e-3 * value - float(merit.evaluate(design, need))

    def of_length(length: float) -> np.ndarray:
        return np.array([length, need.length_sum - length])

    window = _WINDOW * _step(merit, need)
    box = [(max(bound[0], at - window), min(bound[1], at + window))
           for bound, at in zip((need.link_range, need.platform_range), design, strict=True)]
    if need.length_sum:
        ends = (max(box[0][0], need.length_sum - box[1][1]),
                min(box[0][1], need.length_sum - box[1][0]))
        found = minimize_scalar(lambda length: cost(of_length(length)), bounds=ends,
                                method='bounded', options={'xatol': 1e-6})
        refined = of_length(found.x)
    else:
        found = minimize(cost, design, bounds=box, method='Nelder-Mead',
                         options={'xatol': 1e-6, 'fatol': 1e-12})
        refined = found.x
    improved = -found.fun > value and feasible(_margins(refined, need), refined[0])
    return (refined, float(merit.evaluate(refined, need))) if improved else (design, value)


def _margins(design: np.ndarray, need: Requirements) -> dict[str, np.ndarray]:
    """Return the margins of one design."""
    length, half = design
    return margins(length, half, need)


def _active(need: Requirements, design: np.ndarray) -> tuple[str, ...]:
    """Name what the optimum leans on."""
    length, half = design
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
    of = margins(length, half, need)
    return (*names, *(
        f'{requirement.name} = {requirement.asked(need):.4g} {requirement.unit}'
        for requirement in REQUIREMENTS
        if requirement.name in of and of[requirement.name] <= requirement.tolerance))
